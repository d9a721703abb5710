//! The robust recognizer: it finds the rotation that the whole set of dots supports best.
//!
//! # Search
//! Pairs of observed dots, the best conditioned first, are aligned with every ordered pair of
//! pattern dots of similar angle. Each such rotation is screened. Those near the best are refined
//! by Gauss-Newton on their inliers and scored by the full model ([`RobustConfig`] holds its
//! parameters). A pass over one pair covers every explanation in which both of its dots are real.
//! The pairs are disjoint as long as that is possible: an explanation that `k` such passes have not
//! covered leaves out at least `k` dots, which bounds its evidence. The search stops when the best
//! explanation so far is certain, or when no other can be better.
//!
//! # Confidence
//! The confidence is the best explanation's share of the total evidence: of all explanations found,
//! of their near alternatives, of the mirrored pattern, and of the null hypothesis "these are not
//! the pattern's dots". A pattern with symmetries has several poses of equal evidence: the
//! confidence is then low, and [`RobustRecognizer::explanation`] returns them all.
//!
//! # Rotation
//! The reported rotation is the most likely one for the assignment, with the dots weighted by the
//! distribution of their noise ([`NoiseShape`]). For a Gaussian this is least squares. For the
//! peaked noise of the paper's protocols its error is a quarter below that of least squares, so the
//! least-squares bound does not apply.
//!
//! # Mirrored images
//! A view that remains in doubt ([`RobustConfig::mirror_doubt`]) is searched again mirrored. Where the mirrored pattern is certain,
//! the answer is [`RecognizerRejection::Mirrored`]: an axis of the image is flipped.
//!
//! # Unknown conditions
//! Where noise, misses and false dots are not known, [`ConditionsPosterior`] learns them from the
//! frames ([`RobustRecognizer::conditions_evidence`]), and
//! [`RobustRecognizer::with_conditions`] expects what was learned. As long as only a few frames have
//! had a say, the explanations are compared by their evidence over all conditions.
//!
//! # Hint
//! A prior orientation ([`Hint`]) is tried before the search. With it two dots are enough. A wrong
//! hint costs one refinement; the search follows.
//!
//! What it does not guarantee: that no better explanation exists. The validation measures how often
//! the best one found is correct.

mod conditions;
mod config;
mod hint;
mod marginal;
mod model;
mod pairs;
mod posterior;
mod refine;
mod screen;
mod search;

pub use conditions::{Conditions, ConditionsPosterior, ConditionsPrior, FrameEvidence};
pub use config::{NoiseShape, RobustConfig};
pub use hint::Hint;
pub use search::RobustWorkspace;

use std::sync::Arc;

use nalgebra::Rotation3;

use super::{Identification, ObservedDot, Recognizer, RecognizerRejection};
use crate::error::{Result, require};
use crate::geometry::{Rotation, Vec3, angle_between};
use crate::pattern::Pattern;
use hint::Prior;
use model::Model;
use pairs::PatternPairs;
use posterior::{Explanation, NullHypothesis};
use refine::UNASSIGNED;
use screen::ScreenModel;

/// Minimum number of dots that can be identified without a hint, and with one.
const MIN_DOTS: usize = 3;
const MIN_DOTS_HINTED: usize = 2;
/// The same where no frame has shown anything of the conditions: three dots anywhere then fit some pose.
const MIN_DOTS_BLIND: usize = 4;
/// Minimum probability at which a view counts as mirrored.
const MIRROR_SURE: f64 = 0.9;

/// The default recognizer. See the module's documentation.
#[derive(Debug, Clone)]
pub struct RobustRecognizer {
    dots: Vec<Vec3>,
    pairs: PatternPairs,
    model: Model,
    screen: ScreenModel,
    null: NullHypothesis,
    /// See [`refine::View::spread`].
    spread: Vec<f64>,
    config: RobustConfig,
    /// The conditions, as long as they are uncertain.
    uncertain: Option<Arc<ConditionsPosterior>>,
}

impl RobustRecognizer {
    /// Prepares the recognizer for a pattern.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a parameter outside its domain.
    pub fn new(pattern: &Pattern, config: RobustConfig) -> Result<Self> {
        Self::build(pattern, config, 1.0)
    }

    /// Prepares the recognizer for what the frames so far have shown of the conditions; `base` holds
    /// what they do not cover.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a parameter outside its domain.
    pub fn with_conditions(
        pattern: &Pattern,
        base: &RobustConfig,
        conditions: &Arc<ConditionsPosterior>,
    ) -> Result<Self> {
        let expected = conditions.expected();
        // Before any frame has had a say the defaults search better than what is expected.
        let known = if conditions.frames() == 0 {
            Self::build(pattern, *base, 1.0)?
        } else {
            Self::build(pattern, expected.config(base), expected.noise_scale)?
        };
        Ok(Self {
            uncertain: (!conditions.is_settled()).then(|| Arc::clone(conditions)),
            ..known
        })
    }

    fn build(pattern: &Pattern, config: RobustConfig, noise_scale: f64) -> Result<Self> {
        config.check()?;
        let dots = pattern.dots().to_vec();
        let pairs = PatternPairs::new(&dots);
        let model = Model::new(&config, noise_scale);
        Ok(Self {
            screen: ScreenModel::new(&config, &model, dots.len(), &pairs),
            null: NullHypothesis::new(&config, dots.len()),
            dots,
            pairs,
            model,
            spread: Vec::new(),
            config,
            uncertain: None,
        })
    }

    /// States for each dot of the pattern how uncertain its place is beyond what the observed dots'
    /// uncertainties already hold: a variance per tangent axis, rad^2. A dot that was never measured
    /// then counts less than one that was.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for another number of variances than dots, or one
    /// below 0 or not finite.
    pub fn with_dot_variances(mut self, variances_rad2: Vec<f64>) -> Result<Self> {
        let (found, n) = (variances_rad2.len(), self.dots.len());
        require(found == n, "dot_variances", &format!("{n} of them"), found)?;
        for &variance in &variances_rad2 {
            let inside = (0.0..1.0).contains(&variance);
            require(inside, "dot_variances", "0 to 1 rad^2", variance)?;
        }
        self.spread = variances_rad2;
        Ok(self)
    }

    /// The parameters in use.
    pub fn config(&self) -> &RobustConfig {
        &self.config
    }

    /// As [`Recognizer::identify_into`], with prior knowledge of the orientation. The rotation in
    /// the answer depends on the dots; the hint only helps to decide which dot is which.
    ///
    /// # Errors
    /// A [`RecognizerRejection`]; [`RecognizerRejection::Degenerate`] also for an invalid
    /// covariance of the hint.
    pub fn identify_hinted(
        &self,
        dots: &[ObservedDot],
        hint: &Hint,
        ws: &mut RobustWorkspace,
        out: &mut Identification,
    ) -> std::result::Result<(), RecognizerRejection> {
        let prior = Prior::new(hint).ok_or(RecognizerRejection::Degenerate)?;
        self.identify_with(dots, Some(prior), ws, out)
    }

    /// Writes the explanation of this rank (0 the best) of the last view of `ws` into `out`, with
    /// its own probability; `false` if the search found fewer. Explanations differ in their
    /// rotation; the search remembers those near the best, not all.
    pub fn explanation(&self, rank: usize, ws: &RobustWorkspace, out: &mut Identification) -> bool {
        let found = ws.found.ranked(rank);
        if let Some(explanation) = found {
            self.report(explanation, ws, out);
        }
        found.is_some()
    }

    /// The explanation to which `rotation` leads, written into `out`: how well a pose from another
    /// source explains the dots. Returns its log-evidence against "these are not the pattern's
    /// dots"; `None` if hardly any dot supports it. Its confidence is relative to the assignments
    /// near this rotation alone.
    pub fn evidence_near(
        &self,
        dots: &[ObservedDot],
        rotation: &Rotation,
        ws: &mut RobustWorkspace,
        out: &mut Identification,
    ) -> Option<f64> {
        ws.clear(dots.len());
        self.prepare(dots, ws).ok()?;
        self.refine_from(rotation, ws);
        let best = ws.found.best()?;
        self.report(best, ws, out);
        Some(best.refined.ln_evidence - self.null.ln_evidence(dots.len()))
    }

    fn identify_with(
        &self,
        dots: &[ObservedDot],
        prior: Option<Prior>,
        ws: &mut RobustWorkspace,
        out: &mut Identification,
    ) -> std::result::Result<(), RecognizerRejection> {
        let is_blind = self.uncertain.as_ref().is_some_and(|c| c.frames() == 0);
        let needed = match prior {
            Some(_) => MIN_DOTS_HINTED,
            None if is_blind => MIN_DOTS_BLIND,
            None => MIN_DOTS,
        };
        ws.clear(dots.len());
        if dots.len() < needed {
            return Err(RecognizerRejection::TooFewDots {
                found: dots.len(),
                needed,
            });
        }
        self.prepare(dots, ws)?;
        self.search(prior.as_ref(), ws)?;
        if let Some(conditions) = &self.uncertain {
            self.marginalize(conditions, ws);
        }
        let null = ws.null.unwrap_or(self.null);
        let sure = ws.found.best().is_some_and(|best| {
            ws.found.confidence(best, &null, f64::NEG_INFINITY).pose > self.config.mirror_doubt
        });
        if !sure && self.is_mirrored(ws) {
            return Err(RecognizerRejection::Mirrored);
        }
        self.polish_best(ws)
            .ok_or(RecognizerRejection::NoHypothesis)?;
        let best = ws.found.best().ok_or(RecognizerRejection::NoHypothesis)?;
        self.report(best, ws, out);
        Ok(())
    }

    /// Searches the mirrored view; returns whether it explains the dots beyond doubt.
    fn is_mirrored(&self, ws: &mut RobustWorkspace) -> bool {
        self.search_mirrored(ws);
        let rivals = ws.found.ln_evidence();
        let Some(best) = ws.mirrored.best() else {
            return false;
        };
        // From the mirrored side the pattern as it is counts as the rival, at its own prior.
        let confidence = ws.mirrored.confidence(
            best,
            &self.null.of_mirrored(),
            rivals - posterior::MIRROR_LN_ODDS,
        );
        confidence.pose > MIRROR_SURE
    }

    /// Writes an explanation into `out`.
    fn report(&self, explanation: &Explanation, ws: &RobustWorkspace, out: &mut Identification) {
        let mirrored = ws.mirrored.ln_evidence() + posterior::MIRROR_LN_ODDS;
        let null = ws.null.unwrap_or(self.null);
        let confidence = ws.found.confidence(explanation, &null, mirrored);
        let rotation = explanation.refined.rotation;
        let (mut squared, mut matched) = (0.0, 0usize);
        out.assignment.clear();
        for (dot, &j) in ws.dots.iter().zip(ws.found.assignment(explanation)) {
            out.assignment.push((j != UNASSIGNED).then_some(j));
            if j != UNASSIGNED {
                let q = rotation * self.dots[usize::from(j)];
                squared += angle_between(&q, &dot.direction).powi(2);
                matched += 1;
            }
        }
        out.rotation = Rotation::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        out.residual_rad = (squared / matched.max(1) as f64).sqrt();
        out.confidence = confidence.identity;
        out.pose_confidence = confidence.pose;
    }
}

impl Recognizer for RobustRecognizer {
    type Workspace = RobustWorkspace;

    fn workspace(&self) -> RobustWorkspace {
        RobustWorkspace::with_capacity_for(&self.pairs, self.dots.len())
    }

    fn min_dots(&self) -> usize {
        MIN_DOTS
    }

    fn identify_into(
        &self,
        dots: &[ObservedDot],
        ws: &mut RobustWorkspace,
        out: &mut Identification,
    ) -> std::result::Result<(), RecognizerRejection> {
        self.identify_with(dots, None, ws, out)
    }
}
