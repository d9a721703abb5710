//! Rendered frames and sequences of a camera, read by the whole estimator.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use super::conditions::CameraConditions;
use super::frames::FrameOutcome;
use super::sequences::{SpinOutcome, SpinRates};
use crate::concurrency;
use crate::error::{Error, Result, require};
use crate::pattern::Pattern;
use crate::synth::Rendering;
use crate::synth::dataset::SynthSequence;
use crate::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};

/// Maximum number of frames, and of sequences.
pub(super) const MAX_TRIALS: u64 = 1_000_000;
/// Frames of a sequence, at most.
const MAX_SEQUENCE: usize = 10_000;
/// Frames that one task works on: a workspace serves them all.
const CHUNK: u64 = 8;

/// Frames of a camera on which patterns are tried.
#[derive(Debug, Clone, Copy)]
pub struct CameraTrials {
    /// The camera.
    pub conditions: CameraConditions,
    /// The estimator that reads the frames.
    pub estimator: EstimatorConfig,
    /// Seed of the scenes.
    pub seed: u64,
}

impl CameraTrials {
    /// The usual estimator before this camera.
    pub fn new(conditions: CameraConditions, seed: u64) -> Self {
        Self {
            conditions,
            estimator: EstimatorConfig::default(),
            seed,
        }
    }

    /// The same scenes with dots of this diameter, over that of the ball.
    #[must_use]
    pub fn with_dot_diameter(self, dot_diameter: f64) -> Self {
        Self {
            conditions: CameraConditions {
                dot_diameter,
                ..self.conditions
            },
            ..self
        }
    }

    /// The outcomes of these frames, in their order. Frame `k` shows the same scene whatever the pattern:
    /// only the dots differ. `done` learns how many more frames are read.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for conditions or numbers outside their domain.
    pub fn frames(
        &self,
        pattern: &Pattern,
        frames: Range<u64>,
        done: &(dyn Fn(u64) + Sync),
    ) -> Result<Vec<FrameOutcome>> {
        self.frames_until(pattern, frames, None, done)
    }

    /// As [`Self::frames`], which setting `stop` ends.
    ///
    /// # Errors
    /// As [`Self::frames`]; [`crate::Error::Stopped`].
    pub(super) fn frames_until(
        &self,
        pattern: &Pattern,
        frames: Range<u64>,
        stop: Option<&AtomicBool>,
        done: &(dyn Fn(u64) + Sync),
    ) -> Result<Vec<FrameOutcome>> {
        self.each_frame(pattern, frames, stop, done, |rendering, found| {
            FrameOutcome::of(found, &rendering.rotation)
        })
    }

    /// What `look` makes of each of these frames, given its truth and what the estimator answers; see
    /// [`Self::frames`].
    ///
    /// # Errors
    /// As [`Self::frames`]; [`crate::Error::Stopped`] once `stop` is set.
    pub fn each_frame<T: Send>(
        &self,
        pattern: &Pattern,
        frames: Range<u64>,
        stop: Option<&AtomicBool>,
        done: &(dyn Fn(u64) + Sync),
        look: impl Fn(&Rendering, &FrameEstimate) -> T + Sync + Send,
    ) -> Result<Vec<T>> {
        let is_possible = !frames.is_empty() && frames.end <= MAX_TRIALS;
        require(is_possible, "frames", "1 to 1000000", frames.end)?;
        let estimator = self.estimator(pattern)?;
        let count = frames.end - frames.start;
        let chunks: Vec<Result<Vec<T>>> =
            concurrency::map_range(0..count.div_ceil(CHUNK), |chunk| {
                let mut ws = estimator.workspace();
                let mut found = FrameEstimate::default();
                let first = frames.start + chunk * CHUNK;
                let frames = first..(first + CHUNK).min(frames.end);
                let results = frames.clone().map(|k| {
                    if stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
                        return Err(Error::Stopped);
                    }
                    let rendering = self.conditions.scene(pattern, self.seed, k)?.render()?;
                    let (prior, budget) = (Prior::default(), Budget::default());
                    estimator.estimate(&rendering.image, &prior, &budget, &mut ws, &mut found);
                    Ok(look(&rendering, &found))
                });
                let results = results.collect::<Result<Vec<T>>>()?;
                done(frames.end - frames.start);
                Ok(results)
            });
        let mut results = Vec::with_capacity(count as usize);
        for chunk in chunks {
            results.append(&mut chunk?);
        }
        Ok(results)
    }

    /// The spins of `sequences` sequences of `frames` frames, each of another ball.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for conditions or numbers outside their domain.
    pub fn spins(
        &self,
        pattern: &Pattern,
        sequences: u64,
        frames: usize,
        done: &(dyn Fn(u64) + Sync),
    ) -> Result<SpinRates> {
        let expected = "1 to 1000000";
        let is_possible = (1..=MAX_TRIALS).contains(&sequences);
        require(is_possible, "sequences", expected, sequences)?;
        let inside = (crate::spin::MIN_FRAMES..=MAX_SEQUENCE).contains(&frames);
        let expected = format!("{} to {MAX_SEQUENCE}", crate::spin::MIN_FRAMES);
        require(inside, "sequence_frames", &expected, frames)?;
        let estimator = self.estimator(pattern)?;
        let outcomes = concurrency::map_range(0..sequences, |k| {
            let first = self.conditions.scene(pattern, self.seed, k)?;
            let fps = self.conditions.fps;
            let sequence = SynthSequence::of_scene(first, fps, self.seed, frames);
            let outcome = SpinOutcome::of(&estimator, &sequence, fps, frames)?;
            done(frames as u64);
            Ok(outcome)
        });
        let outcomes = outcomes.into_iter().collect::<Result<Vec<_>>>()?;
        Ok(SpinRates::of(&outcomes, frames, self.seed))
    }

    fn estimator(&self, pattern: &Pattern) -> Result<Estimator> {
        self.conditions.check()?;
        Estimator::new(pattern, self.estimator, DetectorName::Cnn.build()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec3;

    fn pattern(turned: f64) -> Pattern {
        let dot = |k: u32| {
            let z = 1.0 - (2.0 * f64::from(k) + 1.0) / 14.0;
            let (s, c) = (2.4 * f64::from(k) + turned).sin_cos();
            Vec3::new(c, s, z / (1.0 - z * z).sqrt()).normalize()
        };
        Pattern::new((0..14).map(dot).collect()).expect("dots that are apart")
    }

    #[test]
    fn a_frame_shows_every_pattern_in_the_same_scene() {
        let conditions = CameraConditions::default();
        for k in 0..8 {
            let scene = |p: &Pattern| conditions.scene(p, 5, k).expect("valid conditions");
            let (one, other) = (scene(&pattern(0.0)), scene(&pattern(0.1)));
            assert_eq!(one.spin, other.spin);
            assert_eq!(one.shift_px, other.shift_px);
            assert_eq!(one.sensor.defocus_px, other.sensor.defocus_px);
            let rotation = |s: &crate::synth::Scene| s.signal().expect("a ball").rotation;
            assert!(rotation(&one).angle_to(&rotation(&other)) < 1e-12);
        }
    }

    #[cfg(feature = "native")]
    #[test]
    fn outcomes_depend_on_the_frame_alone() {
        let ball = pattern(0.0);
        let trials = CameraTrials::new(CameraConditions::default(), 3);
        let tried = |frames: Range<u64>| trials.frames(&ball, frames, &|_| ());
        let pool = |threads| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads")
        };
        let all = pool(1).install(|| tried(0..20)).expect("frames");
        assert_eq!(pool(3).install(|| tried(0..20)).expect("frames"), all);
        let mut parts = tried(0..7).expect("frames");
        parts.extend(tried(7..20).expect("frames"));
        assert_eq!(parts, all);
        assert!(tried(4..4).is_err());
        assert!(tried(0..MAX_TRIALS + 1).is_err());
    }
}
