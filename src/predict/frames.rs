//! Single frames of a pattern before a camera: answered correctly, wrongly, not at all, and how far
//! off the orientation is.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::conditions::CameraConditions;
use super::lasting::Variates;
use super::model::{DetectionModel, Terms};
use crate::concurrency;
use crate::error::{Error, Result};
use crate::geometry::Rotation;
use crate::pattern::Pattern;
use crate::stats::{PairedDifference, Pairs, Proportion, quantile};
use crate::synth::Scene;
use crate::synth::dataset::frame_rng;
use crate::validate::ORIENTATION_FAILURE_RAD;
use crate::vision::detect::NoDetector;
use crate::vision::estimator::{
    Estimator, EstimatorConfig, EstimatorWorkspace, FrameEstimate, OutlineMethod,
};

/// Maximum number of frames of a prediction.
pub const MAX_FRAMES: u64 = 10_000_000;
/// Stream of a scene's detections, apart from those that drew the scene.
pub(super) const DETECTIONS: u64 = 1 << 62;

/// What is predicted, and from how many frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictConfig {
    /// Frames, each of another ball. Default: 2000.
    pub frames: u64,
    /// Their seed. Default: 0.
    pub seed: u64,
    /// The estimator that reads them.
    pub estimator: EstimatorConfig,
}

impl Default for PredictConfig {
    fn default() -> Self {
        Self {
            frames: 2000,
            seed: 0,
            estimator: EstimatorConfig::default(),
        }
    }
}

/// The outcome of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameOutcome {
    /// No answer.
    Unanswered,
    /// An answer, off by this angle, radians.
    Answered {
        /// Orientation error, radians.
        error_rad: f64,
    },
}

impl FrameOutcome {
    /// The outcome of a pose against the truth, both pattern to view frame.
    pub fn of(frame: &FrameEstimate, truth: &Rotation) -> Self {
        frame
            .pose()
            .map_or(Self::Unanswered, |pose| Self::Answered {
                error_rad: pose.rotation.angle_to(truth),
            })
    }

    /// Whether it is an answer off by less than 20 degrees.
    pub fn is_right(self) -> bool {
        matches!(self, Self::Answered { error_rad } if error_rad < ORIENTATION_FAILURE_RAD)
    }

    /// Whether it is an answer off by 20 degrees or more.
    pub fn is_wrong(self) -> bool {
        matches!(self, Self::Answered { error_rad } if error_rad >= ORIENTATION_FAILURE_RAD)
    }
}

/// How single frames of a pattern are answered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameRates {
    /// Orientation error under 20 degrees.
    pub right: Proportion,
    /// An answer that is off by more.
    pub wrong: Proportion,
    /// No answer.
    pub unanswered: Proportion,
    /// Mean orientation error of the right answers, degrees.
    pub mean_error_deg: f64,
    /// Its median.
    pub median_error_deg: f64,
    /// Its root mean square.
    pub rms_error_deg: f64,
}

impl FrameRates {
    /// The rates of these outcomes.
    pub fn of(outcomes: &[FrameOutcome]) -> Self {
        let n = outcomes.len() as u64;
        let mut errors: Vec<f64> = outcomes
            .iter()
            .filter_map(|o| match o {
                FrameOutcome::Answered { error_rad } if o.is_right() => {
                    Some(error_rad.to_degrees())
                }
                _ => None,
            })
            .collect();
        errors.sort_unstable_by(f64::total_cmp);
        let wrong = outcomes.iter().filter(|o| o.is_wrong()).count() as u64;
        let right = errors.len() as u64;
        let count = errors.len().max(1) as f64;
        Self {
            right: Proportion::new(right, n),
            wrong: Proportion::new(wrong, n),
            unanswered: Proportion::new(n - right - wrong, n),
            mean_error_deg: errors.iter().sum::<f64>() / count,
            median_error_deg: quantile(&errors, 0.5),
            rms_error_deg: (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt(),
        }
    }
}

/// The difference of the shares of right answers, those of `others` less those of `first`, on the
/// same scenes.
pub fn paired(first: &[FrameOutcome], others: &[FrameOutcome]) -> PairedDifference {
    let mut pairs = Pairs::default();
    for (a, b) in first.iter().zip(others) {
        match (a.is_right(), b.is_right()) {
            (true, true) => pairs.both += 1,
            (false, true) => pairs.gained += 1,
            (true, false) => pairs.lost += 1,
            (false, false) => pairs.neither += 1,
        }
    }
    PairedDifference::new(pairs)
}

/// How single frames of a pattern are answered, predicted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FramePrediction {
    /// The rates.
    #[serde(flatten)]
    pub rates: FrameRates,
    /// Share of the frames that lie within what the detection model was learned from.
    pub covered: f64,
    /// Seed of the frames.
    pub seed: u64,
}

/// Frames worked on by one task: a workspace serves them all.
const CHUNK: u64 = 16;

/// The results of `work` on the frames `0..frames`, in their order.
pub(super) fn each_frame<W, T: Send>(
    frames: u64,
    workspace: impl Fn() -> W + Sync + Send,
    work: impl Fn(u64, &mut W) -> Result<T> + Sync + Send,
) -> Result<Vec<T>> {
    let chunks = concurrency::map_range(0..frames.div_ceil(CHUNK), |chunk| {
        let mut ws = workspace();
        (chunk * CHUNK..((chunk + 1) * CHUNK).min(frames))
            .map(|k| work(k, &mut ws))
            .collect::<Result<Vec<_>>>()
    });
    let mut results = Vec::with_capacity(frames as usize);
    for chunk in chunks {
        results.extend(chunk?);
    }
    Ok(results)
}

/// A pattern before a camera.
#[derive(Debug)]
pub struct Predictor<'a> {
    model: &'a DetectionModel,
    pub(super) pattern: &'a Pattern,
    pub(super) estimator: Estimator<NoDetector>,
}

/// Working memory of a [`Predictor`], one a thread.
#[derive(Debug)]
pub(super) struct Workspace {
    pub estimator: EstimatorWorkspace<()>,
    terms: Terms,
}

impl<'a> Predictor<'a> {
    /// A predictor for balls with this pattern.
    ///
    /// # Errors
    /// [`Error::Argument`] for a setting of the estimator outside its domain.
    pub fn new(
        model: &'a DetectionModel,
        pattern: &'a Pattern,
        config: EstimatorConfig,
    ) -> Result<Self> {
        let config = EstimatorConfig {
            // The outline comes from the model.
            outline: OutlineMethod::Edges,
            ..config
        };
        Ok(Self {
            model,
            pattern,
            estimator: Estimator::new(pattern, config, NoDetector)?,
        })
    }

    pub(super) fn workspace(&self) -> Workspace {
        Workspace {
            estimator: self.estimator.workspace(),
            terms: Terms::default(),
        }
    }

    /// Detects and identifies a scene's dots; the outcome, the frame, and whether the model covers it. `sequence` is
    /// what its sequence shares, `None` for a single frame.
    pub(super) fn read(
        &self,
        scene: &Scene,
        sequence: Option<&Variates>,
        rng: &mut ChaCha8Rng,
        ws: &mut Workspace,
    ) -> Result<(FrameOutcome, Option<FrameEstimate>, bool)> {
        let ball = scene.seen()?;
        let covers = self.model.covers(&ball);
        let Some(mut first) = self.model.detect(&ball, sequence, &mut ws.terms, rng) else {
            let is_wrong = rng.random::<f64>() < self.model.wrong_without_outline;
            let outcome = if is_wrong {
                FrameOutcome::Answered {
                    error_rad: std::f64::consts::FRAC_PI_2,
                }
            } else {
                FrameOutcome::Unanswered
            };
            return Ok((outcome, None, covers));
        };
        let identify = |frame: &mut FrameEstimate, ws: &mut Workspace| {
            self.estimator.estimate_pose(None, &mut ws.estimator, frame);
        };
        identify(&mut first.frame, ws);
        let frame = if first.frame.is_settled() {
            first.frame
        } else {
            let mut again = self.model.look_again(&ball, first, &mut ws.terms, rng);
            identify(&mut again, ws);
            again
        };
        let outcome = FrameOutcome::of(&frame, &ball.rotation);
        Ok((outcome, Some(frame), covers))
    }

    /// The outcomes of the frames `0..frames` of a seed, in their order, and the share that the
    /// model covers.
    ///
    /// # Errors
    /// [`Error::Argument`] for conditions outside their domain.
    pub fn outcomes(
        &self,
        conditions: &CameraConditions,
        seed: u64,
        frames: u64,
    ) -> Result<(Vec<FrameOutcome>, f64)> {
        conditions.check()?;
        if !(1..=MAX_FRAMES).contains(&frames) {
            let problem = format!("expected 1 to {MAX_FRAMES}, found {frames}");
            return Err(Error::argument("frames", problem));
        }
        let read = each_frame(
            frames,
            || self.workspace(),
            |k, ws| {
                let scene = conditions.scene(self.pattern, seed, k)?;
                let mut rng = frame_rng(seed, k | DETECTIONS);
                let (outcome, _, covers) = self.read(&scene, None, &mut rng, ws)?;
                Ok((outcome, covers))
            },
        )?;
        let covered = read.iter().filter(|(_, covers)| *covers).count();
        let outcomes = read.into_iter().map(|(outcome, _)| outcome).collect();
        Ok((outcomes, covered as f64 / frames as f64))
    }

    /// Predicts how single frames are answered.
    ///
    /// # Errors
    /// As [`Predictor::outcomes`].
    pub fn frames(
        &self,
        conditions: &CameraConditions,
        seed: u64,
        frames: u64,
    ) -> Result<FramePrediction> {
        let (outcomes, covered) = self.outcomes(conditions, seed, frames)?;
        Ok(FramePrediction {
            rates: FrameRates::of(&outcomes),
            covered,
            seed,
        })
    }
}
