//! The spin that sequences of a pattern before a camera give, and how far off it is.

use serde::{Deserialize, Serialize};

use super::conditions::CameraConditions;
use super::frames::{DETECTIONS, Predictor};
use super::lasting::Variates;
use crate::concurrency;
use crate::error::{Result, require};
use crate::geometry::{Vec3, angle_between};
use crate::pattern::Pattern;
use crate::stats::{Proportion, quantile};
use crate::synth::Scene;
use crate::synth::dataset::{Sequence, frame_rng};
use crate::vision::DetectorName;
use crate::vision::detect::DotDetector;
use crate::vision::estimator::{
    Budget, Estimator, EstimatorConfig, EstimatorWorkspace, FrameEstimate, Prior, SequenceConfig,
    estimate_spin, track_sequence,
};

/// A spin vector off by less than this part of its magnitude is right (SpinDOE Sec. IV-C).
pub const SPIN_TOLERANCE: f64 = 0.2;
/// Frames of a sequence, at most.
const MAX_FRAMES: usize = 10_000;

/// The spins of sequences.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpinPrediction {
    /// Frames of a sequence.
    pub frames: usize,
    /// A spin is given.
    pub reported: Proportion,
    /// The spin vector is off by less than 20 % of its magnitude; of all sequences.
    pub right: Proportion,
    /// Median error of the spin vector of the right ones, revolutions per second.
    pub median_error_rps: f64,
    /// Median error of their magnitude, revolutions per second.
    pub median_magnitude_error_rps: f64,
    /// Median angle between their axis and the true one, degrees.
    pub median_axis_error_deg: f64,
    /// Mean share of the frames with an orientation.
    pub frames_answered: f64,
    /// Seed of the sequences.
    pub seed: u64,
}

/// A sequence's outcome.
struct Outcome {
    truth: Vec3,
    spin: Option<Vec3>,
    answered: usize,
}

impl Predictor<'_> {
    /// Predicts the spins of `sequences` sequences, each of another ball, of `frames` frames.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for conditions or numbers outside their domain.
    pub fn spins(
        &self,
        conditions: &CameraConditions,
        seed: u64,
        sequences: u64,
        frames: usize,
    ) -> Result<SpinPrediction> {
        let size = SequencesSize { sequences, frames };
        spins(self.pattern, conditions, seed, size, |k, watched| {
            let mut rng = frame_rng(seed, k | DETECTIONS);
            let lasting = Variates::draw(&mut rng);
            let mut ws = self.workspace();
            watched.read(|scene| {
                let (_, frame, _) = self.read(scene, Some(&lasting), &mut rng, &mut ws)?;
                Ok(frame.unwrap_or_default())
            })?;
            Ok(watched.outcome(&self.estimator, &mut ws.estimator))
        })
    }
}

/// The spins of `sequences` rendered sequences, each of another ball, of `frames` frames that the whole
/// estimator reads.
///
/// # Errors
/// [`crate::Error::Argument`] for conditions or numbers outside their domain.
pub fn rendered_spins(
    pattern: &Pattern,
    conditions: &CameraConditions,
    config: EstimatorConfig,
    seed: u64,
    sequences: u64,
    frames: usize,
) -> Result<SpinPrediction> {
    let estimator = Estimator::new(pattern, config, DetectorName::Cnn.build()?)?;
    let size = SequencesSize { sequences, frames };
    spins(pattern, conditions, seed, size, |_, watched| {
        let mut ws = estimator.workspace();
        watched.read(|scene| {
            let mut found = FrameEstimate::default();
            estimator.estimate(
                &scene.render()?.image,
                &Prior::default(),
                &Budget::default(),
                &mut ws,
                &mut found,
            );
            Ok(found)
        })?;
        Ok(watched.outcome(&estimator, &mut ws))
    })
}

/// How many sequences of how many frames.
#[derive(Debug, Clone, Copy)]
struct SequencesSize {
    sequences: u64,
    frames: usize,
}

/// Spins of sequences that `work` reads, given their numbers.
fn spins(
    pattern: &Pattern,
    conditions: &CameraConditions,
    seed: u64,
    size: SequencesSize,
    work: impl Fn(u64, &mut Watched) -> Result<Outcome> + Sync + Send,
) -> Result<SpinPrediction> {
    let SequencesSize { sequences, frames } = size;
    conditions.check()?;
    let expected = "1 to 1000000";
    require(
        (1..=1_000_000).contains(&sequences),
        "sequences",
        expected,
        sequences,
    )?;
    let inside = (crate::spin::MIN_FRAMES..=MAX_FRAMES).contains(&frames);
    let expected = format!("{} to {MAX_FRAMES}", crate::spin::MIN_FRAMES);
    require(inside, "frames", &expected, frames)?;
    let outcomes = concurrency::map_range(0..sequences, |k| {
        work(k, &mut Watched::new(pattern, conditions, seed, k, frames)?)
    });
    let outcomes = outcomes.into_iter().collect::<Result<Vec<_>>>()?;
    Ok(summary(&outcomes, frames, seed))
}

/// A sequence and what is read of it.
struct Watched {
    sequence: Sequence,
    times: Vec<f64>,
    estimates: Vec<FrameEstimate>,
    truth: Vec3,
}

impl Watched {
    fn new(
        pattern: &Pattern,
        conditions: &CameraConditions,
        seed: u64,
        k: u64,
        count: usize,
    ) -> Result<Self> {
        let first = conditions.scene(pattern, seed, k)?;
        Ok(Self {
            sequence: Sequence::of_scene(first, conditions.fps, seed, count),
            times: (0..count).map(|i| i as f64 / conditions.fps).collect(),
            estimates: Vec::with_capacity(count),
            truth: Vec3::zeros(),
        })
    }

    fn read(&mut self, mut frame: impl FnMut(&Scene) -> Result<FrameEstimate>) -> Result<()> {
        for i in 0..self.times.len() {
            let (scene, _) = self.sequence.scene(i);
            if i == 0 {
                // An observer without intrinsics sees the spin in the view frame.
                self.truth = scene.to_view()? * scene.spin;
            }
            self.estimates.push(frame(&scene)?);
        }
        Ok(())
    }

    /// The spin of the frames as a sequence.
    fn outcome<D: DotDetector>(
        &mut self,
        estimator: &Estimator<D>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
    ) -> Outcome {
        let config = SequenceConfig::default();
        track_sequence(estimator, &config, &self.times, &mut self.estimates, ws);
        let answered = |f: &&FrameEstimate| f.pose().is_some();
        Outcome {
            truth: self.truth,
            spin: estimate_spin(&config, &self.times, &self.estimates)
                .ok()
                .map(|fit| fit.motion.spin),
            answered: self.estimates.iter().filter(answered).count(),
        }
    }
}

fn summary(outcomes: &[Outcome], frames: usize, seed: u64) -> SpinPrediction {
    let n = outcomes.len() as u64;
    let mut errors: [Vec<f64>; 3] = Default::default();
    let mut reported = 0;
    for outcome in outcomes {
        let Some(spin) = outcome.spin else { continue };
        reported += 1;
        let (off, magnitude) = ((spin - outcome.truth).norm(), outcome.truth.norm());
        if off >= SPIN_TOLERANCE * magnitude {
            continue;
        }
        errors[0].push(off / std::f64::consts::TAU);
        errors[1].push((spin.norm() - magnitude).abs() / std::f64::consts::TAU);
        errors[2].push(angle_between(&spin, &outcome.truth).to_degrees());
    }
    for errors in &mut errors {
        errors.sort_unstable_by(f64::total_cmp);
    }
    let answered: usize = outcomes.iter().map(|o| o.answered).sum();
    let [error, magnitude, axis] = errors.each_ref().map(|e| quantile(e, 0.5));
    SpinPrediction {
        frames,
        reported: Proportion::new(reported, n),
        right: Proportion::new(errors[0].len() as u64, n),
        median_error_rps: error,
        median_magnitude_error_rps: magnitude,
        median_axis_error_deg: axis,
        frames_answered: answered as f64 / (n.max(1) as f64 * frames as f64),
        seed,
    }
}
