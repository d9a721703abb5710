//! The hash table: a pattern, its features, a search tree over them, and their origin.
//!
//! The features are in one contiguous array in the order of [`PairRule::features`]. The tree
//! (kiddo) holds their positions in it. Only the metadata's notes of a table can change once it is
//! built.

use std::num::NonZeroUsize;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix2, Matrix3};
use serde::{Deserialize, Serialize};

use super::features::{Basis, PairRule};
use crate::error::{Error, Result, require};
use crate::geometry::{Vec3, tangent_frame};
use crate::pattern::{KeepOut, Pattern};

/// Version of the file format of a table whose dots are where the pattern has them.
pub const FORMAT_VERSION: u32 = 1;
/// Version of the file format of a table whose dots were measured on a ball: it has their covariances,
/// which readers of the first version do not know.
pub const CALIBRATED_VERSION: u32 = 2;
/// A variance beyond this is no measurement, rad^2.
const MAX_VARIANCE: f64 = 1.0;

/// Parameters of the recognizer that a table was designed and validated for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecognizerConfig {
    /// Standard deviation of an observed dot's angular error, radians.
    pub sigma_rad: f64,
    /// Concentration of the Kent density.
    pub kappa: f64,
    /// Ovalness of the Kent density, `0 <= 2 beta < kappa`.
    pub beta: f64,
    /// Standard deviation of `|x|` about 1 in the paper's score, without unit.
    pub alpha: f64,
    /// Minimum z (camera frame, ball of radius 1) of a visible dot.
    pub visibility_limit: f64,
}

impl Default for RecognizerConfig {
    /// The paper's values: 3 degrees, kappa 500, beta 0, alpha 0.03, half the ball visible.
    fn default() -> Self {
        Self {
            sigma_rad: 3f64.to_radians(),
            kappa: 500.0,
            beta: 0.0,
            alpha: 0.03,
            visibility_limit: 0.0,
        }
    }
}

impl RecognizerConfig {
    /// Checks the fields' domains.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the field.
    pub fn check(&self) -> Result<()> {
        let fail = |name: &str, expected: &str, found: f64| {
            let problem = format!("expected {expected}, found {found}");
            Err(Error::argument(format!("recognizer.{name}"), problem))
        };
        let positive = |x: f64| x.is_finite() && x > 0.0;
        if !positive(self.sigma_rad) {
            return fail("sigma_rad", "a positive number", self.sigma_rad);
        }
        if !(self.kappa.is_finite() && self.kappa >= 0.0) {
            return fail("kappa", "a number not below 0", self.kappa);
        }
        if !(self.beta == 0.0 || (self.beta > 0.0 && 2.0 * self.beta < self.kappa)) {
            return fail("beta", "0 <= 2 beta < kappa", self.beta);
        }
        if !positive(self.alpha) {
            return fail("alpha", "a positive number", self.alpha);
        }
        if !(-1.0..1.0).contains(&self.visibility_limit) {
            return fail(
                "visibility_limit",
                "a number in [-1, 1)",
                self.visibility_limit,
            );
        }
        Ok(())
    }
}

/// The objective that a pattern was optimized for, and its value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectiveRecord {
    /// The objective's name.
    pub name: String,
    /// Its value for this pattern.
    pub value: f64,
}

/// How the dots of a calibrated table were measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationRecord {
    /// [`Pattern::sha256`] of the nominal pattern; `None` where the pattern was built from images alone.
    pub nominal_sha256: Option<String>,
    /// For each dot its number in the nominal pattern; `None` for a mark that the pattern lacks.
    pub nominal_numbers: Vec<Option<u16>>,
    /// Number of frames that saw each dot; 0 for one that is where the nominal pattern has it.
    pub views: Vec<u32>,
}

/// A table's metadata (the `meta` array of the file, as JSON).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TableMeta {
    /// Version of the file format, [`FORMAT_VERSION`] or [`CALIBRATED_VERSION`].
    pub format_version: u32,
    /// [`Pattern::sha256`] of the dots.
    pub pattern_sha256: String,
    /// The recognizer's parameters; files of version 0.1 spell the key `recogniser`.
    #[serde(alias = "recogniser")]
    pub recognizer: RecognizerConfig,
    /// The rule that selected the table's pairs.
    pub pair_rule: PairRule,
    /// The objective's value, where the pattern was optimized.
    #[serde(default)]
    pub objective: Option<ObjectiveRecord>,
    /// The validation result that the table shipped with.
    #[serde(default)]
    pub validation: Option<serde_json::Value>,
    /// How the dots were measured, in a table of [`CALIBRATED_VERSION`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<CalibrationRecord>,
    /// The pattern's zones without dots.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub keep_out: Vec<KeepOut>,
}

/// A feature found near a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Position in [`HashTable::features`].
    pub index: usize,
    /// Squared Euclidean distance in hash space.
    pub distance_squared: f64,
}

/// A pattern's features with their search tree.
#[derive(Debug)]
pub struct HashTable {
    pattern: Pattern,
    features: Vec<[f64; 3]>,
    bases: Vec<Basis>,
    feature_dots: Vec<u16>,
    tree: ImmutableKdTree<f64, 3>,
    /// Of a calibrated table.
    dot_covariances: Option<Vec<Matrix3<f64>>>,
    meta: TableMeta,
}

impl HashTable {
    /// Computes the features of `pattern` under `rule` and builds the search tree (paper, Alg. 1).
    ///
    /// # Errors
    /// [`Error::Argument`] where the rule or the parameters are outside their domains, or where the
    /// rule excludes every pair.
    pub fn build(pattern: Pattern, rule: PairRule, recognizer: RecognizerConfig) -> Result<Self> {
        rule.check()?;
        recognizer.check()?;
        let mut arrays = Arrays::default();
        for f in rule.features(pattern.dots()) {
            arrays.features.push(f.value);
            arrays.bases.push(f.basis);
            arrays.feature_dots.push(f.dot);
        }
        let meta = TableMeta {
            format_version: FORMAT_VERSION,
            pattern_sha256: pattern.sha256(),
            recognizer,
            pair_rule: rule,
            objective: None,
            validation: None,
            calibration: None,
            keep_out: pattern.keep_out().to_vec(),
        };
        Self::assemble(pattern, arrays, meta)
    }

    /// Builds the search tree over arrays that belong to `pattern`.
    pub(super) fn assemble(pattern: Pattern, arrays: Arrays, meta: TableMeta) -> Result<Self> {
        if arrays.features.is_empty() {
            return Err(Error::argument(
                "pair_rule",
                "leaves out every pair of the pattern's dots",
            ));
        }
        let tree = ImmutableKdTree::new_from_slice(&arrays.features)
            .map_err(|e| Error::Internal(format!("the search tree cannot be built: {e:?}")))?;
        Ok(Self {
            pattern,
            features: arrays.features,
            bases: arrays.bases,
            feature_dots: arrays.feature_dots,
            tree,
            dot_covariances: None,
            meta,
        })
    }

    /// The table of a ball whose dots were measured, with their covariances (rad^2, pattern frame).
    ///
    /// # Errors
    /// [`Error::Argument`] where the record or the covariances are not those of as many dots, or a
    /// covariance is not one.
    pub fn with_calibration(
        mut self,
        covariances: Vec<Matrix3<f64>>,
        record: CalibrationRecord,
    ) -> Result<Self> {
        let n = self.pattern.len();
        for (name, found) in [
            ("dot_covariances", covariances.len()),
            ("nominal_numbers", record.nominal_numbers.len()),
            ("views", record.views.len()),
        ] {
            require(found == n, name, &format!("{n} of them"), found)?;
        }
        let dots = self.pattern.dots().iter().zip(&covariances);
        if let Some(j) = dots
            .map(|(d, c)| is_covariance(d, c))
            .position(|good| !good)
        {
            let problem = format!(
                "dot {j}: expected a covariance in the plane across the dot, found {:?}",
                covariances[j].as_slice()
            );
            return Err(Error::argument("dot_covariances", problem));
        }
        self.meta.format_version = CALIBRATED_VERSION;
        self.meta.calibration = Some(record);
        self.dot_covariances = Some(covariances);
        Ok(self)
    }

    /// Covariance of each dot's direction, rad^2, pattern frame, singular along the dot; `None` where
    /// the dots were not measured on a ball.
    pub fn dot_covariances(&self) -> Option<&[Matrix3<f64>]> {
        self.dot_covariances.as_deref()
    }

    /// The pattern.
    pub fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    /// All hash values, in the order of [`PairRule::features`].
    pub fn features(&self) -> &[[f64; 3]] {
        &self.features
    }

    /// The basis of each feature.
    pub fn bases(&self) -> &[Basis] {
        &self.bases
    }

    /// The third dot of each feature.
    pub fn feature_dots(&self) -> &[u16] {
        &self.feature_dots
    }

    /// The table's metadata.
    pub fn meta(&self) -> &TableMeta {
        &self.meta
    }

    /// Records what the pattern was optimized for.
    pub fn set_objective(&mut self, objective: Option<ObjectiveRecord>) {
        self.meta.objective = objective;
    }

    /// Records the validation result that the table ships with.
    pub fn set_validation(&mut self, validation: Option<serde_json::Value>) {
        self.meta.validation = validation;
    }

    /// The `k` features nearest to `value` (all, where there are fewer), nearest first.
    ///
    /// A `value` that is not finite has no neighbors.
    pub fn nearest(&self, value: &[f64; 3], k: NonZeroUsize) -> impl Iterator<Item = Neighbor> {
        let finite = value.iter().all(|x| x.is_finite());
        let found = finite.then(|| {
            self.tree
                .query(value)
                .nearest_n::<SquaredEuclidean<f64>>(k)
                .execute()
        });
        found.into_iter().flatten().map(|item| Neighbor {
            index: item.item as usize,
            distance_squared: item.distance,
        })
    }

    /// Distance from each feature to the nearest other one in hash space, in the features' order.
    pub fn nearest_distances(&self) -> Vec<f64> {
        const TWO: NonZeroUsize = NonZeroUsize::new(2).unwrap();
        self.features
            .iter()
            .map(|f| {
                // The nearest is the feature itself, or one at the same place.
                self.nearest(f, TWO)
                    .map(|n| n.distance_squared.sqrt())
                    .fold(0.0, f64::max)
            })
            .collect()
    }
}

/// Whether this is a covariance of a direction: symmetric, of positive variance in the plane across it,
/// of none along it.
fn is_covariance(direction: &Vec3, covariance: &Matrix3<f64>) -> bool {
    let scale = covariance.trace();
    let [e1, e2] = tangent_frame(direction);
    let across = Matrix2::new(
        e1.dot(&(covariance * e1)),
        e1.dot(&(covariance * e2)),
        e2.dot(&(covariance * e1)),
        e2.dot(&(covariance * e2)),
    );
    let small = 1e-6 * scale;
    // A NaN fails the first comparison.
    scale > 0.0
        && scale <= MAX_VARIANCE
        && (covariance - covariance.transpose()).amax() <= small
        && (covariance * direction).amax() <= small
        && across.determinant() > 0.0
}

/// The columns of a table.
#[derive(Debug, Default)]
pub(super) struct Arrays {
    pub features: Vec<[f64; 3]>,
    pub bases: Vec<Basis>,
    pub feature_dots: Vec<u16>,
}
