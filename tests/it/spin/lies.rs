//! Clips of orientations from closed forms: true ones, ones whose times lie, and ones without a motion; and what became of
//! them. `bench spin-lies` measures what the tests sample.
//!
//! A clip has 24 orientations at 350 frames per second, 10 to 120 revolutions per second about any axis, noise of 0.4 deg per
//! axis, all identified with certainty. An answer is right within 5 % of the spin vector, or four of its standard deviations.

use std::f64::consts::TAU;

use nalgebra::Quaternion;
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use spindoe::geometry::{Rotation, Vec3, random_direction, random_rotation};
use spindoe::spin::clock::Clock;
use spindoe::spin::estimate::{MotionModel, SpinEstimate};
use spindoe::spin::robust::SpinConfig;
use spindoe::spin::{Measurement, SpinRejection};

/// Orientations of a clip, and its camera.
const FRAMES: usize = 24;
const FPS: f64 = 350.0;
/// Noise per axis, degrees.
pub const NOISE_DEG: f64 = 0.4;
/// That an orientation is right, as the recognizer says it of a good view.
const CONFIDENCE: f64 = 0.999;

/// One clip: what its maker did, and what a user hands over.
#[derive(Debug, Clone)]
pub struct Clip {
    /// The true spin, rad/s.
    pub spin: Vec3,
    pub measurements: Vec<Measurement>,
}

/// A rotation about a unit axis by an angle, by its definition.
pub fn about(axis: &Vec3, angle: f64) -> Rotation {
    let (sin, cos) = (0.5 * angle).sin_cos();
    let vector = axis * sin;
    Rotation::new_unchecked(Quaternion::new(cos, vector.x, vector.y, vector.z))
}

fn normal<R: Rng>(rng: &mut R) -> f64 {
    let (u, v): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
    (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
}

/// Orientations of a steady ball at these times.
pub fn turning<R: Rng>(rng: &mut R, rps: f64, noise_deg: f64, times_s: &[f64]) -> Clip {
    let axis = random_direction(rng);
    let start = random_rotation(rng);
    let orientation = |t: f64, rng: &mut R| {
        let off = Vec3::from_fn(|_, _| normal(rng)) * noise_deg.to_radians();
        let noise = about(&off.normalize(), off.norm());
        noise * about(&axis, TAU * rps * t) * start
    };
    let measurements = times_s.iter().map(|&t| Measurement {
        confidence: CONFIDENCE,
        ..Measurement::new(t, orientation(t, rng))
    });
    Clip {
        spin: axis * (TAU * rps),
        measurements: measurements.collect(),
    }
}

/// `count` times at the usual rate.
fn even(count: usize) -> Vec<f64> {
    (0..count).map(|k| k as f64 / FPS).collect()
}

/// A clip of the usual camera.
fn usual<R: Rng>(rng: &mut R, count: usize) -> Clip {
    let rps = rng.random_range(10.0..120.0);
    turning(rng, rps, NOISE_DEG, &even(count))
}

impl Clip {
    /// The same orientations, as if the camera had taken them one after another.
    fn renumbered(mut self) -> Self {
        for (m, time_s) in self.measurements.iter_mut().zip(even(1 << 10)) {
            m.time_s = time_s;
        }
        self
    }

    fn without(mut self, is_lost: impl Fn(usize) -> bool) -> Self {
        let mut k = 0;
        self.measurements.retain(|_| {
            k += 1;
            !is_lost(k - 1)
        });
        self
    }

    /// Whether a spin is that of the clip, with its deviation.
    fn is_right(&self, estimate: &SpinEstimate) -> bool {
        let fit = estimate.at(estimate.middle_s());
        let error = fit.motion.spin - self.spin;
        let normalized = fit
            .spin_covariance
            .and_then(|c| Some(c.cholesky()?.solve(&error).dot(&error)));
        error.norm() < 0.05 * self.spin.norm()
            || normalized.is_some_and(|square| square < 3.0 * 16.0)
    }
}

/// What makes a clip.
pub type Maker = fn(&mut ChaCha8Rng) -> Clip;

/// What is true.
pub const TRUTHS: [(&str, Maker); 8] = [
    ("as it is", |rng| usual(rng, FRAMES)),
    ("10 frames, 2 deg", |rng| {
        let rps = rng.random_range(10.0..120.0);
        turning(rng, rps, 2.0, &even(10))
    }),
    ("one frame in five missing, times right", |rng| {
        let clip = usual(rng, FRAMES);
        let lost: Vec<bool> = (0..FRAMES).map(|_| rng.random::<f64>() < 0.2).collect();
        clip.without(|k| lost[k])
    }),
    ("one orientation in ten wrong, confidence 0.9", |rng| {
        let mut clip = usual(rng, FRAMES);
        for m in &mut clip.measurements {
            m.confidence = 0.9;
            if rng.random::<f64>() < 0.1 {
                m.orientation = random_rotation(rng);
            }
        }
        clip
    }),
    ("two frames swapped", |rng| {
        let mut clip = usual(rng, FRAMES);
        let k = rng.random_range(0..FRAMES - 1);
        let kept = clip.measurements[k].orientation;
        clip.measurements[k].orientation = clip.measurements[k + 1].orientation;
        clip.measurements[k + 1].orientation = kept;
        clip
    }),
    ("one frame twice", |rng| {
        let mut clip = usual(rng, FRAMES);
        let k = rng.random_range(1..FRAMES - 1);
        clip.measurements.insert(k, clip.measurements[k]);
        clip.renumbered()
    }),
    ("one frame lost", |rng| {
        let k = rng.random_range(1..FRAMES);
        usual(rng, FRAMES + 1).without(|i| i == k).renumbered()
    }),
    ("0.5 to 3 rps at 30 fps, 60 frames", |rng| {
        let rps = rng.random_range(0.5..3.0);
        let times: Vec<f64> = (0..60).map(|k| f64::from(k) / 30.0).collect();
        turning(rng, rps, NOISE_DEG, &times)
    }),
];

/// What lies, and how that is named.
pub const LIES: [(&str, Maker, Name); 7] = [
    (
        "every third frame lost",
        |rng| usual(rng, FRAMES).without(|k| k % 3 == 2).renumbered(),
        |told| told.slipped,
    ),
    (
        "every frame twice",
        |rng| {
            let mut clip = usual(rng, FRAMES);
            let twice = clip.measurements.iter().flat_map(|m| [*m, *m]).collect();
            clip.measurements = twice;
            clip.renumbered()
        },
        |told| told.repeated,
    ),
    (
        "shuffled",
        |rng| {
            let mut clip = usual(rng, FRAMES);
            clip.measurements.shuffle(rng);
            clip.renumbered()
        },
        |told| told.ordered,
    ),
    (
        "times rounded to 1 ms",
        |rng| {
            let mut clip = usual(rng, FRAMES);
            for m in &mut clip.measurements {
                m.time_s = (m.time_s * 1e3).round() * 1e-3;
            }
            clip
        },
        |told| told.rounded,
    ),
    (
        "jitter of 1 ms",
        |rng| {
            let mut clip = usual(rng, FRAMES);
            for m in &mut clip.measurements {
                m.time_s += 1e-3 * normal(rng);
            }
            clip.measurements
                .sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
            clip.measurements
                .dedup_by(|b, a| b.time_s - a.time_s < 1e-5);
            clip
        },
        |told| told.scattered,
    ),
    (
        "no motion: orientations at random",
        |rng| {
            let mut clip = usual(rng, FRAMES);
            for m in &mut clip.measurements {
                m.orientation = random_rotation(rng);
            }
            clip
        },
        |_| true,
    ),
    (
        "no motion: one axis, angles at random",
        |rng| {
            let clip = usual(rng, FRAMES);
            let mut times = even(FRAMES);
            for t in &mut times {
                *t = rng.random_range(0.0..1.0);
            }
            let told = clip.measurements;
            let mut clip = turning(rng, 50.0, NOISE_DEG, &times);
            for (m, own) in clip.measurements.iter_mut().zip(told) {
                m.time_s = own.time_s;
            }
            clip
        },
        |_| true,
    ),
];

/// What is said of a clip's times.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Told {
    pub slipped: bool,
    pub repeated: bool,
    pub ordered: bool,
    pub rounded: bool,
    pub scattered: bool,
}

/// Whether what is told is the lie's name.
pub type Name = fn(&Told) -> bool;

impl Told {
    fn by(clock: &Clock) -> Self {
        Self {
            slipped: clock.slipped > 0,
            repeated: clock.repeated > 0,
            ordered: false,
            rounded: clock.grid_s.is_some(),
            scattered: clock.scatter_s.is_some(),
        }
    }

    /// Whether anything is told.
    pub fn anything(&self) -> bool {
        *self != Self::default()
    }
}

/// What became of a clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fate {
    /// A spin, the right one.
    Right,
    /// A wrong spin.
    Wrong,
    /// No spin.
    Rejected,
}

/// What the estimate says of a clip.
#[derive(Debug, Clone)]
pub struct Judged {
    pub fate: Fate,
    pub told: Told,
    /// Length of the error over that of the spin; NaN without an answer.
    pub error: f64,
    /// The answer in words.
    pub words: String,
}

/// Estimates a clip.
pub fn judge(clip: &Clip) -> Judged {
    match SpinEstimate::fit(
        &clip.measurements,
        MotionModel::Auto,
        &SpinConfig::default(),
    ) {
        Err(rejection) => Judged {
            fate: Fate::Rejected,
            told: Told {
                ordered: matches!(
                    rejection,
                    SpinRejection::NotAtTheseTimes {
                        in_order_rps: Some(_),
                        ..
                    }
                ),
                ..Told::default()
            },
            error: f64::NAN,
            words: rejection.to_string(),
        },
        Ok(estimate) => {
            let fit = estimate.at(estimate.middle_s());
            Judged {
                fate: if clip.is_right(&estimate) {
                    Fate::Right
                } else {
                    Fate::Wrong
                },
                told: Told::by(&estimate.clock),
                error: (fit.motion.spin - clip.spin).norm() / clip.spin.norm(),
                words: format!(
                    "{:.3} rps for {:.3}, {} of {} follow, {}; {:?}",
                    fit.motion.rps(),
                    clip.spin.norm() / TAU,
                    fit.inliers,
                    clip.measurements.len(),
                    estimate.motion.model(),
                    estimate.clock,
                ),
            }
        }
    }
}
