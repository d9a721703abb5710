//! Comparison of patterns: the same trials, orientation bounds, separations, feature distances.
//!
//! All patterns see the same rotations and the same random numbers, trial by trial, so a difference
//! of rates is evaluated on pairs ([`PairedDifference`]). The intervals do not correct for several
//! comparisons.

use serde::Serialize;

use crate::ball::Ball;
use crate::design::objective::bound::BoundSummary;
use crate::design::{Objective, ObjectiveName, OrientationBound};
use crate::error::{Error, Result};
use crate::geometry::angle_between;
use crate::pattern::{Pattern, PatternSummary};
use crate::recognize::RecognizerName;
use crate::recognize::paper::FeatureTree;
use crate::stats::{PairedDifference, Pairs};
use crate::validate::{TrialResult, Validation, ValidationConfig, check_samples};
use crate::view::{Protocol, ProtocolName};

/// A pattern in a comparison.
#[derive(Debug)]
pub struct Entry {
    /// Its name in tables and plots.
    pub name: String,
    /// Its table.
    pub ball: Ball,
}

/// Values of a pattern that need no trials.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PatternMeasures {
    /// The pattern's name.
    pub name: String,
    /// SHA-256 of the dots.
    pub sha256: String,
    /// Separations and visibility.
    pub summary: PatternSummary,
    /// Spread of the neighbors' distances.
    pub neighbors: NeighborSpread,
    /// Each objective's value, on the `sparse` protocol's views, where it can be computed.
    pub objectives: Vec<ObjectiveScore>,
    /// Mean distance from each feature of the table to the nearest other one, without unit.
    pub mean_feature_distance: f64,
    /// The orientation bound of the visible dots, in units of the dots' noise.
    pub orientation_bound: BoundSummary,
}

/// An objective's value.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ObjectiveScore {
    /// Its name.
    pub name: ObjectiveName,
    /// Its value.
    pub value: f64,
}

/// The distribution criterion for marks on a ball of US 2023/0218952: how unlike the distances of
/// each mark to its three nearest neighbors are, over all marks and relative to their mean.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NeighborSpread {
    /// Mean of the distances (angles), radians.
    pub mean_rad: f64,
    /// Their standard deviation over their mean.
    pub relative_std: f64,
    /// The minimum of them over their mean.
    pub relative_min: f64,
}

impl NeighborSpread {
    /// The criterion's values for a pattern.
    pub fn of(pattern: &Pattern) -> Self {
        let dots = pattern.dots();
        let mut all = Vec::with_capacity(3 * dots.len());
        for (i, d) in dots.iter().enumerate() {
            let mut angles: Vec<f64> = dots
                .iter()
                .enumerate()
                .filter(|(j, _)| *j != i)
                .map(|(_, other)| angle_between(d, other))
                .collect();
            angles.sort_unstable_by(f64::total_cmp);
            all.extend(angles.iter().take(3));
        }
        let n = all.len() as f64;
        let mean = all.iter().sum::<f64>() / n;
        let variance = all.iter().map(|a| (a - mean).powi(2)).sum::<f64>() / n;
        Self {
            mean_rad: mean,
            relative_std: variance.sqrt() / mean,
            relative_min: all.iter().copied().fold(f64::INFINITY, f64::min) / mean,
        }
    }
}

/// The rates of one pattern in one protocol.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Contest {
    /// The pattern's name.
    pub name: String,
    /// The recognizer.
    pub recognizer: RecognizerName,
    /// The rates.
    #[serde(flatten)]
    pub validation: Validation,
    /// Rate of all dots right, of all views, less that of the first pattern; for the first itself it is 0.
    pub identity_difference: PairedDifference,
    /// Rate of right orientations, of all views, less that of the first pattern.
    pub answered_difference: PairedDifference,
}

/// Result of a comparison.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Trials per protocol.
    pub samples: u64,
    /// Their seed.
    pub seed: u64,
    /// Values of each pattern that need no trials.
    pub patterns: Vec<PatternMeasures>,
    /// Rates, by recognizer, protocol and pattern.
    pub contests: Vec<Contest>,
}

fn measures(entry: &Entry) -> Result<PatternMeasures> {
    let pattern = entry.ball.pattern();
    let sparse = ProtocolName::Sparse.view();
    let objectives: Result<Vec<_>> = ObjectiveName::ALL
        .into_iter()
        .filter(|name| name.suits(pattern.len()))
        .map(|name| {
            let objective = Objective::for_views(name, &[sparse], pattern.len())?.sharpened();
            let value = objective.evaluate_at(pattern.dots())?.value;
            Ok(ObjectiveScore { name, value })
        })
        .collect();
    Ok(PatternMeasures {
        name: entry.name.clone(),
        sha256: pattern.sha256(),
        summary: pattern.summary(),
        neighbors: NeighborSpread::of(pattern),
        objectives: objectives?,
        mean_feature_distance: FeatureTree::new(&entry.ball)?.mean_nearest_distance(),
        orientation_bound: OrientationBound::default().summary(pattern.dots()),
    })
}

/// Identity and orientation of a trial; one with too few dots failed in both.
fn passed(result: &TrialResult) -> [bool; 2] {
    match result {
        TrialResult::Skipped => [false, false],
        TrialResult::Judged {
            identity,
            error_rad,
            ..
        } => [
            *identity,
            *error_rad < crate::validate::ORIENTATION_FAILURE_RAD,
        ],
    }
}

impl Comparison {
    /// The same without times, so that the same seed gives the same bytes.
    #[must_use]
    pub fn untimed(mut self) -> Self {
        for contest in &mut self.contests {
            contest.validation = contest.validation.clone().untimed();
        }
        self
    }
}

/// Counts pairs: success `which` of `results` against that of `first`.
fn difference(first: &[TrialResult], results: &[TrialResult], which: usize) -> PairedDifference {
    let mut pairs = Pairs::default();
    for (a, b) in first.iter().zip(results) {
        let count = match (passed(a)[which], passed(b)[which]) {
            (true, true) => &mut pairs.both,
            (false, true) => &mut pairs.gained,
            (true, false) => &mut pairs.lost,
            (false, false) => &mut pairs.neither,
        };
        *count += 1;
    }
    PairedDifference::new(pairs)
}

/// Compares patterns on `samples` trials of every protocol, with these recognizers; `says` receives
/// the name of each measurement.
///
/// # Errors
/// [`Error::Argument`] for fewer than two patterns; as [`ValidationConfig::results`].
pub fn compare(
    entries: &[Entry],
    recognizers: &[RecognizerName],
    seed: u64,
    samples: u64,
    says: &mut dyn FnMut(&str),
) -> Result<Comparison> {
    if entries.len() < 2 {
        let found = entries.len();
        let problem = format!("expected at least two, found {found}");
        return Err(Error::argument("patterns", problem));
    }
    check_samples(samples)?;
    let patterns: Result<Vec<_>> = entries.iter().map(measures).collect();
    let mut contests = Vec::new();
    for &recognizer in recognizers {
        for name in ProtocolName::ALL {
            let config = ValidationConfig {
                recognizer,
                protocol: Protocol::standard(name),
                seed,
                samples,
            };
            let mut first: Option<Vec<TrialResult>> = None;
            for entry in entries {
                says(&format!("{}: {name}, recognizer {recognizer}", entry.name));
                let results = config.results(&entry.ball, &|_| {})?;
                let validation = config.summary(&entry.ball, &results).validation;
                let against_first = |which| match &first {
                    Some(first) => difference(first, &results, which),
                    None => PairedDifference::with_itself(validation.samples),
                };
                contests.push(Contest {
                    name: entry.name.clone(),
                    recognizer,
                    identity_difference: against_first(0),
                    answered_difference: against_first(1),
                    validation,
                });
                first.get_or_insert(results);
            }
        }
    }
    Ok(Comparison {
        samples,
        seed,
        patterns: patterns?,
        contests,
    })
}
