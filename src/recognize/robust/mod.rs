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
//! confidence is then low, and [`Explanations::rivals`] lists them.
//!
//! # Rotation
//! The reported rotation is the most likely one for the assignment, with the dots weighted by the
//! distribution of their noise ([`NoiseShape`](crate::view::NoiseShape)). For a Gaussian this is least squares. For the
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

mod config;
mod hint;
mod marginal;
mod matching;
mod model;
mod naming;
mod pairs;
mod posterior;
mod refine;
mod screen;
mod search;
mod workspace;

pub use config::RobustConfig;
pub use workspace::RobustWorkspace;

use std::sync::Arc;

use super::explanations::{MAX_RIVALS, MIN_RIVAL};
use super::learn::ConditionsPosterior;
use super::{
    Explanations, Hint, Identification, ORIENTATION_FAILURE_RAD, ObservedDot, Recognizer,
    RecognizerRejection,
};
use crate::ball::Ball;
use crate::error::{Result, require};
use crate::geometry::{Rotation, Vec3, angle_between, rotation_angle, to_rotation};
use crate::pattern::Pattern;
use crate::view::ViewModel;
use hint::HintPrior;
use model::{PreparedDot, SEARCH_WEIGHT, ViewTables};
use pairs::PatternPairs;
use posterior::{Confidence, Explanation, FoundInView, NullHypothesis};
use refine::{RefinedExplanation, UNASSIGNED};
use screen::ScreenModel;

/// Minimum number of dots that can be identified without a hint, and with one.
const MIN_DOTS: usize = 3;
const MIN_DOTS_HINTED: usize = 2;
/// The same where no frame has shown anything of the conditions: three dots anywhere then fit some pose.
const MIN_DOTS_BLIND: usize = 4;
/// Nats behind the best explanation from which on others count for nothing.
const NEGLIGIBLE: f64 = 14.0;
/// Nats behind the best explanation up to which others are integrated over their rotations, where there is
/// doubt ([`RobustConfig::integrated_below`]).
const INTEGRATED: f64 = 5.0;
/// Minimum probability at which a view counts as mirrored.
const MIRROR_SURE: f64 = 0.9;

/// The default recognizer. See the module's documentation.
#[derive(Debug, Clone)]
pub struct RobustRecognizer {
    dots: Vec<Vec3>,
    pairs: PatternPairs,
    model: ViewTables,
    screen: ScreenModel,
    null: NullHypothesis,
    /// See [`refine::ComparedDots::spread`].
    spread: Vec<f64>,
    config: RobustConfig,
    /// The conditions, as long as they are uncertain.
    uncertain: Option<Arc<ConditionsPosterior>>,
}

/// A pose with its support.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupportedPose {
    /// Rotation from the pattern's frame to the camera's.
    pub rotation: Rotation,
    /// Log-evidence against "these are not the pattern's dots".
    pub ln_evidence: f64,
}

impl RobustRecognizer {
    /// Prepares the recognizer for a pattern.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a parameter outside its domain.
    pub fn new(pattern: &Pattern, config: RobustConfig) -> Result<Self> {
        config.check()?;
        let dots = pattern.dots().to_vec();
        let pairs = PatternPairs::new(&dots);
        let model = ViewTables::new(&config.view, dots.len());
        Ok(Self {
            screen: ScreenModel::new(&config.view, &model, dots.len(), &pairs),
            null: NullHypothesis::new(&config.view, dots.len()),
            dots,
            pairs,
            model,
            spread: Vec::new(),
            config,
            uncertain: None,
        })
    }

    /// Prepares the recognizer for a ball. Where its dots were measured, those that are less certain
    /// than the others count less ([`Placement::beyond_rad2`](crate::ball::Placement)); what all of
    /// them have in common is the observed dots' to state.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a parameter outside its domain.
    pub fn for_ball(ball: &Ball, config: RobustConfig) -> Result<Self> {
        let recognizer = Self::new(ball.pattern(), config)?;
        match ball.placement() {
            Some(placement) => recognizer.with_dot_variances(placement.beyond_rad2),
            None => Ok(recognizer),
        }
    }

    /// Prepares the recognizer for a ball and what the frames so far have shown of the conditions;
    /// `base` holds what they do not cover.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a parameter outside its domain.
    pub fn with_conditions(
        ball: &Ball,
        base: &RobustConfig,
        conditions: &Arc<ConditionsPosterior>,
    ) -> Result<Self> {
        let expected = conditions.expected(&base.view);
        let view = if conditions.frames() > 0 {
            expected
        } else {
            // The defaults search better than what is expected before any frame has had a say.
            ViewModel {
                foreign_share: expected.foreign_share,
                mirrored_share: expected.mirrored_share,
                ..base.view
            }
        };
        let known = Self::for_ball(ball, RobustConfig { view, ..*base })?;
        Ok(Self {
            uncertain: (!conditions.is_settled()).then(|| Arc::clone(conditions)),
            ..known
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

    /// The pattern's dots, unit vectors in its frame.
    pub fn dots(&self) -> &[Vec3] {
        &self.dots
    }

    /// The parameters in use.
    pub fn config(&self) -> &RobustConfig {
        &self.config
    }

    /// The explanation to which `rotation` leads: how well a pose from another source explains the
    /// dots; `None` if hardly any dot supports it.
    pub fn explain_near(
        &self,
        dots: &[ObservedDot],
        rotation: &Rotation,
        ws: &mut RobustWorkspace,
    ) -> Option<SupportedPose> {
        ws.clear(dots.len());
        self.prepare(dots, ws).ok()?;
        self.refine_from(rotation, ws);
        let RefinedExplanation {
            rotation,
            ln_evidence,
            ..
        } = ws.found.best()?.refined;
        Some(SupportedPose {
            rotation: to_rotation(&rotation),
            ln_evidence: ln_evidence - self.null.ln_evidence(dots.len()),
        })
    }

    /// As [`Recognizer::explain`], without the mirrored view, which takes longer than the view itself where that shows no pose:
    /// [`RecognizerRejection::Mirrored`] does not occur, and what the mirror image explains as well is not doubted.
    pub fn explain_directly<'w>(
        &self,
        dots: &[ObservedDot],
        hint: Option<&Hint>,
        ws: &'w mut RobustWorkspace,
    ) -> std::result::Result<&'w Explanations, RecognizerRejection> {
        self.explain_below(0.0, dots, hint, ws)
    }

    /// Explains the dots, and where no pose is likelier than `mirror_doubt` looks at the mirrored view as well.
    fn explain_below<'w>(
        &self,
        mirror_doubt: f64,
        dots: &[ObservedDot],
        hint: Option<&Hint>,
        ws: &'w mut RobustWorkspace,
    ) -> std::result::Result<&'w Explanations, RecognizerRejection> {
        let prior = match hint {
            Some(hint) => Some(HintPrior::new(hint).ok_or(RecognizerRejection::Degenerate)?),
            None => None,
        };
        self.search_all(dots, prior.as_ref(), mirror_doubt, ws)?;
        self.list(ws).ok_or(RecognizerRejection::NoHypothesis)?;
        Ok(&ws.explanations)
    }

    /// Finds the explanations, in `ws.found`, or the reason for a rejection.
    fn search_all(
        &self,
        dots: &[ObservedDot],
        prior: Option<&HintPrior>,
        mirror_doubt: f64,
        ws: &mut RobustWorkspace,
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
        self.search(prior, ws)?;
        self.weigh(prior, f64::NEG_INFINITY, ws);
        if let Some(conditions) = &self.uncertain {
            self.marginalize(conditions, ws);
        }
        let null = ws.null.unwrap_or(self.null);
        let sure = ws.found.best().is_some_and(|best| {
            ws.found.confidence(best, &null, f64::NEG_INFINITY).pose > mirror_doubt
        });
        let can_be_mirrored = mirror_doubt > 0.0 && self.config.view.mirrored_share > 0.0;
        if !sure && can_be_mirrored && self.is_mirrored(ws) {
            return Err(RecognizerRejection::Mirrored);
        }
        self.polish_best(ws)
            .ok_or(RecognizerRejection::NoHypothesis)
    }

    /// Weighs the explanations found with all assignments near them: by their evidence at their own
    /// rotations, and where that leaves doubt integrated over the rotations. What is far behind the best, or behind the log-evidence `rival` of
    /// another view, is not.
    fn weigh(&self, prior: Option<&HintPrior>, rival: f64, ws: &mut RobustWorkspace) {
        let Some(best) = ws.found.best() else {
            return;
        };
        let least = best.refined.ln_evidence.max(rival) - NEGLIGIBLE;
        let RobustWorkspace {
            dots,
            matching,
            refiner,
            found,
            ..
        } = ws;
        let view = self.view(dots, prior);
        found.weigh(least, |_, refined, assignment| {
            Some(matching.at_rotation(&view, refined, assignment))
        });
        let Some(best) = found.best() else {
            return;
        };
        let is_clear = found
            .confidence(best, &self.null, f64::NEG_INFINITY)
            .identity
            > self.config.integrated_below;
        if self.uncertain.is_some() || is_clear {
            return;
        }
        let least = best.refined.ln_evidence.max(rival) - INTEGRATED;
        matching.clear_sampled();
        for (number, explanation) in found.explanations().iter().enumerate() {
            let RefinedExplanation {
                rotation,
                ln_evidence,
                ..
            } = explanation.refined;
            if ln_evidence < least {
                continue;
            }
            let assignment = found.assignment(explanation);
            if let Some((information, _)) = refiner.fit(&view, &rotation, assignment, SEARCH_WEIGHT)
            {
                matching.sample(number, &rotation, &information);
            }
        }
        found.weigh(least, |number, refined, assignment| {
            matching.integrate(&view, number, refined, assignment)
        });
    }

    /// Searches the mirrored view; returns whether it explains the dots beyond doubt.
    fn is_mirrored(&self, ws: &mut RobustWorkspace) -> bool {
        self.search_mirrored(ws);
        let rivals = ws.found.ln_evidence();
        let Some(best) = ws.mirrored.best() else {
            return false;
        };
        // From the mirrored side the pattern as it is counts as the rival, at its own prior.
        let null = self.null.of_mirrored();
        let rivals = rivals + null.ln_mirrored_odds();
        let confidence = ws.mirrored.confidence(best, &null, rivals);
        confidence.pose > MIRROR_SURE
    }

    /// Writes the best explanation and its rivals into `ws.explanations`.
    fn list(&self, ws: &mut RobustWorkspace) -> Option<()> {
        let mirrored = ws.mirrored.ln_evidence() + self.null.ln_mirrored_odds();
        let null = ws.null.unwrap_or(self.null);
        let RobustWorkspace {
            dots,
            found,
            explanations,
            ..
        } = ws;
        let best = found.best()?;
        let confidence = found.confidence(best, &null, mirrored);
        self.report(best, confidence, found, dots, explanations.begin());
        for rank in 0.. {
            let Some(rival) = found.ranked(rank) else {
                break;
            };
            let rotation = to_rotation(&rival.refined.rotation);
            let is_same = |listed: &Identification| {
                rotation_angle(&listed.rotation, &rotation) < ORIENTATION_FAILURE_RAD
            };
            if is_same(explanations.best()) || explanations.rivals().iter().any(is_same) {
                continue;
            }
            if explanations.rivals().len() == MAX_RIVALS {
                break;
            }
            let confidence = found.confidence(rival, &null, mirrored);
            if confidence.pose < MIN_RIVAL {
                break;
            }
            self.report(rival, confidence, found, dots, explanations.next_rival());
        }
        Some(())
    }

    /// Writes an explanation into `out`.
    fn report(
        &self,
        explanation: &Explanation,
        confidence: Confidence,
        found: &FoundInView,
        dots: &[PreparedDot],
        out: &mut Identification,
    ) {
        let rotation = explanation.refined.rotation;
        let (mut squared, mut matched) = (0.0, 0usize);
        out.assignment.clear();
        for (dot, &j) in dots.iter().zip(found.assignment(explanation)) {
            out.assignment.push((j != UNASSIGNED).then_some(j));
            if j != UNASSIGNED {
                let q = rotation * self.dots[usize::from(j)];
                squared += angle_between(&q, &dot.direction).powi(2);
                matched += 1;
            }
        }
        out.rotation = to_rotation(&rotation);
        out.residual_rad = (squared / matched.max(1) as f64).sqrt();
        out.dots_confidence = confidence.identity;
        out.confidence = confidence.pose;
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

    /// [`RecognizerRejection::Degenerate`] also for an invalid covariance of the hint.
    fn explain<'w>(
        &self,
        dots: &[ObservedDot],
        hint: Option<&Hint>,
        ws: &'w mut RobustWorkspace,
    ) -> std::result::Result<&'w Explanations, RecognizerRejection> {
        self.explain_below(self.config.mirror_doubt, dots, hint, ws)
    }
}
