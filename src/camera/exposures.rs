//! What a pattern gives in exposures with several flashes, as a launch monitor takes them: rendered, read by the whole estimator, and
//! compared with their truth.
//!
//! A spin is right where the whole vector is within 2 % of its magnitude or 60 rpm. Patterns race by the error of the turn from the
//! first flash to the last, `|w - w_true| (t_n - t_1)`, radians, as they do by that of an orientation (see [`super::race`]).

use std::f64::consts::TAU;
use std::ops::Range;
use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use super::frames::FrameOutcome;
use super::racing::{RaceConfig, race};
use super::trials::MAX_TRIALS;
use crate::clip::balls::{BallEstimate, BallsEstimator};
use crate::clip::strobe::{Strobe, StrobeHypothesis};
use crate::concurrency;
use crate::error::{Result, require};
use crate::geometry::{CameraFrame, Vec3};
use crate::pattern::{NamedPattern, Pattern};
use crate::spin::golf::{self, GolfFlight};
use crate::spin::robust::SpinConfig;
use crate::stats::{Proportion, median_or_nan, or_nan};
use crate::synth::SynthConfig;
use crate::synth::dataset::{BallTruth, SynthFrame, strobed_frame};
use crate::synth::several::StrobeConfig;
use crate::validate::ORIENTATION_FAILURE_RAD;
use crate::vision::frame::config::CameraModel;
use crate::vision::{Budget, Camera, DetectorName, Estimator, EstimatorConfig};

/// rad/s in revolutions per minute.
const RPM: f64 = 60.0 / TAU;
/// A spin counts as right within this part of it, or so many rpm.
const RIGHT: (f64, f64) = (0.02, 60.0);
/// An image is found within so many radii of its center, and so far off its radius, as ln.
const FOUND: (f64, f64) = (0.3, 0.2);

/// The exposures on which patterns are tried: of a camera whose intrinsics and direction of flight are known.
#[derive(Debug, Clone)]
pub struct ExposureTrials {
    /// Balls, light and sensor.
    pub synth: SynthConfig,
    /// The flashes and the flight.
    pub strobe: StrobeConfig,
    /// Seed of the exposures.
    pub seed: u64,
}

impl ExposureTrials {
    /// A launch monitor's exposures by flashes at these times, s.
    pub fn golf(times_s: Vec<f64>, seed: u64) -> Self {
        Self {
            synth: SynthConfig::golf(),
            strobe: StrobeConfig::new(times_s).with_golf_spin(),
            seed,
        }
    }

    /// Exposure `k`: the same scene for every pattern but for its dots.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for a configuration out of its domain.
    pub fn frame(&self, pattern: &Pattern, k: u64) -> Result<SynthFrame> {
        strobed_frame(pattern, &self.synth, &self.strobe, self.seed, k as usize)
    }

    /// The flashes of an exposure, with the direction of its flight.
    ///
    /// # Errors
    /// As [`Strobe::new`].
    pub fn flashes(&self, truth: &[BallTruth]) -> Result<Strobe> {
        let spin = SpinConfig {
            max_rps: golf::MAX_RPS,
            ..SpinConfig::default()
        };
        let flight = match truth {
            [first, second, ..] => Some(GolfFlight::of_motion([
                second.center.u - first.center.u,
                0.0,
            ])),
            _ => None,
        };
        Strobe::new(self.strobe.times_s.clone(), flight, spin)
    }

    /// What is read of these exposures, in their order. `done` learns how many more are read.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for a configuration out of its domain.
    pub fn outcomes(
        &self,
        pattern: &Pattern,
        exposures: Range<u64>,
        done: &(dyn Fn(u64) + Sync),
    ) -> Result<Vec<ExposureOutcome>> {
        let count = self.strobe.times_s.len();
        let outcomes = concurrency::map_range(exposures, |k| {
            let frame = self.frame(pattern, k)?;
            let camera = frame.truth.intrinsics.map(Camera::Perspective);
            let config = EstimatorConfig {
                camera: camera.map_or(CameraModel::default(), CameraModel::Known),
                ..EstimatorConfig::default()
            };
            let single = Estimator::new(pattern, config, DetectorName::Cnn.build()?)?;
            let estimator = BallsEstimator::new(vec![single], Some(count))?;
            let mut ws = estimator.workspace()?;
            let strobe = self.flashes(&frame.truth.balls)?;
            let gray = frame.image.to_gray();
            let budget = Budget::default();
            let balls = estimator.estimate_strobed(&gray, None, &strobe, &budget, &mut ws);
            let read = strobe.read(&balls, CameraFrame::default());
            done(1);
            Ok(ExposureOutcome::of(
                &frame.truth.balls,
                &balls,
                &read,
                false,
            ))
        });
        outcomes.into_iter().collect()
    }
}

/// What is read of an exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct ExposureOutcome {
    /// The part of the diameter that the two nearest images share.
    pub overlap: f64,
    /// Images of the ball.
    pub images: usize,
    /// Images at which an outline was found.
    pub found: usize,
    /// Images with a pose.
    pub posed: usize,
    /// Poses that are off by 20 degrees or more.
    pub wrong: usize,
    /// Poses where there is no image.
    pub invented: usize,
    /// Orientation errors of the right poses, radians.
    pub errors_rad: Vec<f64>,
    /// The true spin, rpm.
    pub true_rpm: f64,
    /// Time from the first flash to the last, s.
    pub span_s: f64,
    /// The spin of the likeliest hypothesis; none without one.
    pub spin: Option<ExposureSpin>,
}

/// How far off the spin of an exposure is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExposureSpin {
    /// Of the whole vector, rpm.
    pub error_rpm: f64,
    /// Of its magnitude, rpm.
    pub rate_error_rpm: f64,
    /// Of backspin or sidespin, the larger, rpm.
    pub golf_error_rpm: f64,
    /// Squared error over its stated covariance, of three degrees of freedom; NaN without one.
    pub chi2: f64,
    /// Probability of the hypothesis.
    pub probability: f64,
    /// Number of hypotheses.
    pub hypotheses: usize,
}

impl ExposureOutcome {
    /// Of an exposure with these images, the balls that were found and what they were read as. Orientations are in the view frame or in
    /// the camera's.
    pub fn of(
        truth: &[BallTruth],
        balls: &[BallEstimate],
        read: &[StrobeHypothesis],
        in_view: bool,
    ) -> Self {
        let mut this = Self {
            overlap: overlap(truth),
            images: truth.len(),
            found: 0,
            posed: 0,
            wrong: 0,
            invented: 0,
            errors_rad: Vec::with_capacity(truth.len()),
            true_rpm: 0.0,
            span_s: truth
                .first()
                .zip(truth.last())
                .map_or(0.0, |(a, b)| b.time_s - a.time_s),
            spin: None,
        };
        for image in truth {
            let there = balls.iter().filter(|b| is_at(b, image));
            let best = there.max_by_key(|b| b.frame.pose().is_some());
            this.found += usize::from(best.is_some());
            let Some(pose) = best.and_then(|b| b.frame.pose()) else {
                continue;
            };
            this.posed += 1;
            let rotation = match in_view {
                true => image.orientation(),
                false => image.camera_orientation(),
            };
            match pose.rotation.angle_to(&rotation) {
                error if error < ORIENTATION_FAILURE_RAD => this.errors_rad.push(error),
                _ => this.wrong += 1,
            }
        }
        let posed = balls.iter().filter(|b| b.frame.pose().is_some());
        this.invented = posed.filter(|b| !truth.iter().any(|t| is_at(b, t))).count();
        let spin = truth
            .first()
            .map_or(Vec3::zeros(), |t| Vec3::from(t.spin_rad_s));
        this.true_rpm = RPM * spin.norm();
        let best = read.first();
        this.spin = best.and_then(|best| ExposureSpin::of(best, &spin, read.len()));
        this
    }

    /// Whether the whole vector is right.
    pub fn is_right(&self) -> bool {
        self.is_within(|s| s.error_rpm)
    }

    /// Whether the magnitude is right.
    pub fn is_rate_right(&self) -> bool {
        self.is_within(|s| s.rate_error_rpm)
    }

    /// Whether backspin and sidespin are right.
    pub fn is_golf_right(&self) -> bool {
        self.is_within(|s| s.golf_error_rpm)
    }

    fn is_within(&self, error_rpm: impl Fn(&ExposureSpin) -> f64) -> bool {
        let most = (RIGHT.0 * self.true_rpm).max(RIGHT.1);
        self.spin.is_some_and(|s| error_rpm(&s) <= most)
    }

    /// The turn from the first flash to the last as the orientation of a frame.
    fn turn(&self) -> FrameOutcome {
        self.spin
            .map_or(FrameOutcome::Unanswered, |s| FrameOutcome::Answered {
                error_rad: s.error_rpm / RPM * self.span_s,
            })
    }
}

impl ExposureSpin {
    fn of(hypothesis: &StrobeHypothesis, truth: &Vec3, hypotheses: usize) -> Option<Self> {
        let (fit, _) = hypothesis.spin.as_ref().ok()?;
        let off = fit.motion.spin - truth;
        let inverse = fit.spin_covariance.and_then(|c| c.try_inverse());
        Some(Self {
            error_rpm: RPM * off.norm(),
            rate_error_rpm: RPM * (fit.motion.spin.norm() - truth.norm()).abs(),
            // Seen from the side, backspin is about the view's axis and sidespin about the vertical.
            golf_error_rpm: RPM * off.z.abs().max(off.y.abs()),
            chi2: inverse.map_or(f64::NAN, |inverse| off.dot(&(inverse * off))),
            probability: hypothesis.probability,
            hypotheses,
        })
    }
}

/// Whether a ball was found where an image is: its center within three tenths of the radius, the radius within a fifth.
pub fn is_at(ball: &BallEstimate, image: &BallTruth) -> bool {
    ball.circle().is_some_and(|c| {
        let apart = (c.center.u - image.center.u).hypot(c.center.v - image.center.v);
        // An ellipse has its shorter half axis for a radius.
        let radius = c.radius / (1.0 - c.eccentricity.norm_squared()).powf(0.25);
        apart < FOUND.0 * image.radius_px && (radius / image.radius_px).ln().abs() < FOUND.1
    })
}

/// The share of the diameter that the two nearest images have in common.
fn overlap(truth: &[BallTruth]) -> f64 {
    let apart = truth.windows(2).map(|w| {
        let [a, b] = [w[0].center, w[1].center];
        (a.u - b.u).hypot(a.v - b.v) / (w[0].radius_px + w[1].radius_px)
    });
    1.0 - apart.fold(f64::INFINITY, f64::min)
}

/// How exposures of a pattern are read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ExposureRates {
    /// Images at which an outline was found.
    pub found: Proportion,
    /// Images with a pose.
    pub posed: Proportion,
    /// Poses that are off by 20 degrees or more, or where there is no image.
    pub wrong: Proportion,
    /// Median orientation error of the right poses, degrees; NaN without any, which JSON has as null.
    #[serde(deserialize_with = "or_nan")]
    pub median_error_deg: f64,
    /// Exposures whose spin is right: the whole vector, within 2 % of its magnitude or 60 rpm.
    pub right: Proportion,
    /// The same of its magnitude.
    pub rate_right: Proportion,
    /// The same of backspin and of sidespin.
    pub golf_right: Proportion,
    /// Median error of the whole vector where there is a spin, rpm; NaN without any, which JSON has as null.
    #[serde(deserialize_with = "or_nan")]
    pub median_error_rpm: f64,
    /// Seed of the exposures.
    pub seed: u64,
}

impl ExposureRates {
    /// The rates of these outcomes of exposures of this seed.
    pub fn of<'a>(outcomes: impl IntoIterator<Item = &'a ExposureOutcome>, seed: u64) -> Self {
        let all: Vec<&ExposureOutcome> = outcomes.into_iter().collect();
        let sum = |count: fn(&ExposureOutcome) -> usize| -> u64 {
            all.iter().map(|o| count(o) as u64).sum()
        };
        let share = |is: fn(&ExposureOutcome) -> bool| {
            let successes = all.iter().filter(|o| is(o)).count();
            Proportion::new(successes as u64, all.len() as u64)
        };
        let middle = |mut values: Vec<f64>| {
            values.sort_unstable_by(f64::total_cmp);
            median_or_nan(&values)
        };
        let errors = all.iter().flat_map(|o| &o.errors_rad);
        let off = all.iter().filter_map(|o| o.spin.map(|s| s.error_rpm));
        let images = sum(|o| o.images);
        let poses = sum(|o| o.posed + o.invented);
        Self {
            found: Proportion::new(sum(|o| o.found), images),
            posed: Proportion::new(sum(|o| o.posed), images),
            wrong: Proportion::new(sum(|o| o.wrong + o.invented), poses),
            median_error_deg: middle(errors.map(|e| e.to_degrees()).collect()),
            right: share(ExposureOutcome::is_right),
            rate_right: share(ExposureOutcome::is_rate_right),
            golf_right: share(ExposureOutcome::is_golf_right),
            median_error_rpm: middle(off.collect()),
            seed,
        }
    }
}

/// What a pattern gives in exposures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ExposureAdvice {
    /// Its name.
    pub name: String,
    /// Number of dots.
    pub dots: usize,
    /// Their diameter over that of the ball.
    pub dot_diameter: f64,
    /// How exposures are read that no race has seen; few, where it is clearly worse than the best.
    pub rates: ExposureRates,
}

/// Advice on these patterns, each with dots of a diameter over that of the ball, the best first: they race on the same exposures,
/// and are measured on others ([`race`]). `done` learns how many more exposures are read or, at the end, were spared:
/// [`RaceConfig::frames`] of each in all.
///
/// # Errors
/// [`crate::Error::Argument`] for a configuration out of its domain, or no pattern.
pub fn advise_exposures(
    trials: &ExposureTrials,
    patterns: &[(&NamedPattern, f64)],
    config: &RaceConfig,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Vec<ExposureAdvice>> {
    let is_possible = (1..=MAX_TRIALS).contains(&config.frames());
    require(is_possible, "frames", "1 to 1000000", config.frames())?;
    // Of each pattern, those of the last frames that are read.
    let mut last: Vec<Vec<ExposureOutcome>> = vec![Vec::new(); patterns.len()];
    let never = AtomicBool::new(false);
    let results = race(patterns.len(), config, &never, |entry, exposures| {
        let (named, dot_diameter) = patterns[entry];
        let own = ExposureTrials {
            synth: SynthConfig {
                dot_radius_rad: [dot_diameter; 2],
                ..trials.synth.clone()
            },
            ..trials.clone()
        };
        let outcomes = own.outcomes(&named.pattern, exposures, done)?;
        let turns = outcomes.iter().map(ExposureOutcome::turn).collect();
        last[entry] = outcomes;
        Ok(turns)
    })?;
    done(results.iter().map(|result| result.spared(config)).sum());
    let advice = results.iter().map(|result| {
        let (named, dot_diameter) = patterns[result.entry];
        ExposureAdvice {
            name: named.name.clone(),
            dots: named.pattern.len(),
            dot_diameter,
            rates: ExposureRates::of(&last[result.entry], trials.seed),
        }
    });
    Ok(advice.collect())
}
