//! Simulated sequences of orientations: truth to test estimators against.
//!
//! A ball turns about a fixed axis, its rate constant or decaying as `|w|(t) = |w0| exp(-c t)`, so
//! the angle turned since t0 is `|w0| (1 - exp(-c (t - t0))) / c`. Each measured orientation is
//! `exp([e]x) R(t)` with `e ~ N(0, sigma^2 I)` per axis, in the camera frame; an outlier is a
//! rotation uniform on SO(3). Times may jitter, frames may be dropped.
//!
//! Sequence number `i` of a seed is drawn from stream `i` of a ChaCha8 generator with that seed, so
//! it is the same whichever thread draws it, and whatever others are drawn.

use std::f64::consts::TAU;

use nalgebra::{Matrix6, Vector2};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::Measurement;
pub use super::motion::decayed_time;
use super::motion::{ConstantSpin, PrecessingSpin};
use super::shared::{SharedError, ViewTurn};
use crate::error::{Error, Result, require};
use crate::geometry::{Rotation, Vec3, random_direction, random_rotation};

/// Maximum number of frames of a sequence: eight hours at 350 fps.
const MAX_FRAMES: usize = 10_000_000;

/// Waves of a [`SharedField`].
const FEATURES: usize = 60;

/// Which frames never arrive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drops {
    /// Each frame is lost with this probability, independently.
    Probability(f64),
    /// Exactly this many frames remain, chosen at random.
    Keep(usize),
}

/// A simulated camera and orientation estimator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scenario {
    /// Frames taken, before any are dropped.
    pub frames: usize,
    /// Frame rate, 1/s.
    pub fps: f64,
    /// Standard deviation of a frame's time about the even grid, as a fraction of the interval;
    /// the measured time is the true one. Limited to a third of an interval, so that order is kept.
    pub jitter: f64,
    /// Orientation noise per axis, radians.
    pub sigma_rad: f64,
    /// Probability that an orientation is an outlier.
    pub outliers: f64,
    /// Frames lost.
    pub drops: Drops,
    /// Decay rate c of the spin, 1/s.
    pub decay_per_s: f64,
}

impl Default for Scenario {
    /// Ten frames at 350 frames per second, 2 deg per axis, 7 % outliers (the paper's camera, its
    /// orientation error and its rate of wrong identifications).
    fn default() -> Self {
        Self {
            frames: 10,
            fps: super::DEFAULT_FPS,
            jitter: 0.0,
            sigma_rad: 2f64.to_radians(),
            outliers: 0.07,
            drops: Drops::Probability(0.0),
            decay_per_s: 0.0,
        }
    }
}

/// A ball before a camera whose orientations come from drawn dots, with all that is wrong about them: 1 to 100 revolutions per second
/// at 350 frames per second, noise of 0.4 to 2 deg per axis that differs by a third between frames, errors of 0.1 to 0.8 deg that
/// frames share, 7 % wrong orientations, a tenth of the frames missing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DrawnScenario {
    /// Frames taken.
    pub frames: usize,
    /// Rate at which the spin decays, 1/s.
    pub decay_per_s: f64,
    /// The rotation that is fixed in the ball over that fixed in space.
    pub body_share: f64,
    /// Without the errors that frames share.
    pub exact_dots: bool,
}

/// A sequence of a [`DrawnScenario`].
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnSequence {
    /// The true motion.
    pub truth: PrecessingSpin,
    /// What was measured, in order of time; the noise of the frames is known relative to each other.
    pub measurements: Vec<Measurement>,
    /// Noise of a typical frame per axis, radians.
    pub sigma_rad: f64,
    /// The error that the frames share.
    pub shared: SharedError,
}

impl DrawnScenario {
    /// Sequence number `index` of `seed`.
    pub fn sequence(&self, seed: u64, index: u64) -> DrawnSequence {
        let mut rng = stream(seed, index);
        let (sigma_rad, shared, field) = drawn_errors(self.exact_dots, &mut rng);
        let rate = TAU * rng.random_range(1.0..100.0);
        let truth = PrecessingSpin {
            space: ConstantSpin {
                time_s: 0.0,
                orientation: random_rotation(&mut rng),
                spin: random_direction(&mut rng) * rate,
            },
            body_rate: random_direction(&mut rng) * (rate * self.body_share),
            decay_per_s: self.decay_per_s,
        };
        let seen = (0..self.frames).map(|k| {
            let time_s = k as f64 / super::DEFAULT_FPS;
            (time_s, truth.at(time_s))
        });
        DrawnSequence {
            truth,
            measurements: drawn(seen, sigma_rad, &field, &mut rng),
            sigma_rad,
            shared,
        }
    }
}

impl DrawnSequence {
    /// The same ball as it crosses the picture of a camera that is not known: its orientations were brought into one view frame by turns of
    /// 5 to 25 deg over the time, of which the error is known to be 10 to 40 %.
    #[must_use]
    pub fn crossing(mut self, seed: u64, index: u64) -> Self {
        let mut rng = stream(seed, index);
        let whole_rad = rng.random_range(5f64..25.0).to_radians();
        let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
        let share = rng.random_range(0.1..0.4);
        let error = share * normal(&mut rng);
        let times = self.measurements.iter().map(|m| m.time_s);
        let last_s = times.fold(f64::MIN_POSITIVE, f64::max);
        let turn_rad = |time_s: f64| {
            // Of the tangent of the ball's direction, as its place in the picture.
            let aside = (time_s / last_s - 0.5) * whole_rad.tan();
            Vector2::new(cos, sin) * aside.atan()
        };
        for m in &mut self.measurements {
            let off = turn_rad(m.time_s) * error;
            let off = Rotation::from_scaled_axis(Vec3::new(off.x, off.y, 0.0));
            m.orientation = off * m.orientation;
        }
        let turns = self.measurements.iter().map(|m| {
            let turn_rad = turn_rad(m.time_s);
            let turn_rad = Vec3::new(turn_rad.x, turn_rad.y, 0.0);
            let none = Vec3::zeros();
            let turn = ViewTurn {
                turn_rad,
                shared_rad: [turn_rad * share, none, none],
            };
            (m.time_s, turn)
        });
        self.shared = SharedError::with_turns(Some(self.shared), turns).unwrap_or(self.shared);
        self
    }
}

/// A ball that is pushed: 0.2 to 3 revolutions per second at 60 frames per second, and three swings of its spin with periods of
/// 0.5 to 4 seconds, each of up to half the spin in any direction; seen as in a [`DrawnScenario`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PushedScenario {
    /// Frames taken.
    pub frames: usize,
    /// Without the errors that frames share.
    pub exact_dots: bool,
}

/// A sequence of a [`PushedScenario`].
#[derive(Debug, Clone, PartialEq)]
pub struct PushedSequence {
    /// A spin, and the amplitude, frequency in rad/s and phase of each of its swings.
    swings: (Vec3, [(Vec3, f64, f64); SWINGS]),
    /// As in a [`DrawnSequence`].
    pub measurements: Vec<Measurement>,
    /// Noise of a typical frame per axis, radians.
    pub sigma_rad: f64,
    /// The error that the frames share.
    pub shared: SharedError,
}

/// Swings of a pushed ball's spin, the camera's rate, and steps of a frame in which its turns are added up.
const SWINGS: usize = 3;
const PUSHED_FPS: f64 = 60.0;
const SUBSTEPS: usize = 32;

impl PushedScenario {
    /// Sequence number `index` of `seed`.
    pub fn sequence(&self, seed: u64, index: u64) -> PushedSequence {
        let mut rng = stream(seed, index);
        let (sigma_rad, shared, field) = drawn_errors(self.exact_dots, &mut rng);
        let rate = TAU * rng.random_range(0.2..3.0);
        let spin = random_direction(&mut rng) * rate;
        let swing = |rng: &mut ChaCha8Rng| {
            let amplitude = random_direction(rng) * (rate * rng.random_range(0.0..0.5));
            let frequency = TAU / rng.random_range(0.5..4.0);
            (amplitude, frequency, rng.random_range(0.0..TAU))
        };
        let swings = [(); SWINGS].map(|()| swing(&mut rng));
        let mut sequence = PushedSequence {
            swings: (spin, swings),
            measurements: Vec::new(),
            sigma_rad,
            shared,
        };
        let mut orientation = random_rotation(&mut rng);
        let seen = (0..self.frames).map(|k| {
            let time_s = k as f64 / PUSHED_FPS;
            let now = orientation;
            let step_s = 1.0 / (PUSHED_FPS * SUBSTEPS as f64);
            for i in 0..SUBSTEPS {
                let middle_s = time_s + (i as f64 + 0.5) * step_s;
                let turn = sequence.spin(middle_s) * step_s;
                orientation = Rotation::from_scaled_axis(turn) * orientation;
            }
            (time_s, now)
        });
        let seen: Vec<(f64, Rotation)> = seen.collect();
        sequence.measurements = drawn(seen.into_iter(), sigma_rad, &field, &mut rng);
        sequence
    }
}

impl PushedSequence {
    /// The true spin at a time, rad/s.
    pub fn spin(&self, time_s: f64) -> Vec3 {
        let (spin, swings) = &self.swings;
        let swing = |(a, f, phase): &(Vec3, f64, f64)| a * (f * time_s + phase).sin();
        spin + swings.iter().map(swing).sum::<Vec3>()
    }

    /// The true mean spin between two times, rad/s.
    pub fn mean_spin(&self, [from_s, to_s]: [f64; 2]) -> Vec3 {
        let (spin, swings) = &self.swings;
        let swing = |(a, f, phase): &(Vec3, f64, f64)| {
            let [from, to] = [from_s, to_s].map(|t| (f * t + phase).cos());
            a * ((from - to) / (f * (to_s - from_s)))
        };
        spin + swings.iter().map(swing).sum::<Vec3>()
    }
}

/// The noise of a sequence of drawn dots, and the error that its frames share.
fn drawn_errors(exact_dots: bool, rng: &mut ChaCha8Rng) -> (f64, SharedError, SharedField) {
    let sigma_rad = rng.random_range(0.4f64..2.0).to_radians();
    let off_rad = rng.random_range(0.1f64..0.8).to_radians();
    let shared = SharedError {
        sigma_rad: if exact_dots { 0.0 } else { off_rad },
        correlation_rad: 0.7,
        turning: Matrix6::zeros(),
    };
    let field = SharedField::random(&shared, rng);
    (sigma_rad, shared, field)
}

/// What is measured of true orientations at their times.
fn drawn(
    seen: impl Iterator<Item = (f64, Rotation)>,
    sigma_rad: f64,
    field: &SharedField,
    rng: &mut ChaCha8Rng,
) -> Vec<Measurement> {
    let measured = seen.filter_map(|(time_s, seen)| {
        let drawn = field.at(&(seen.inverse() * Vec3::z()));
        let sigma_scale = (0.3 * normal(rng)).exp();
        let noise = Vec3::from_fn(|_, _| normal(rng)) * (sigma_rad * sigma_scale);
        let stray = random_rotation(rng);
        let is_wrong = rng.random::<f64>() < 0.07;
        let is_missing = rng.random::<f64>() < 0.1;
        let real = Rotation::from_scaled_axis(noise) * seen * Rotation::from_scaled_axis(drawn);
        (!is_missing).then_some(Measurement {
            sigma_scale,
            ..Measurement::new(time_s, if is_wrong { stray } else { real })
        })
    });
    measured.collect()
}

/// A draw of the errors that frames share ([`SharedError`]): a smooth random field of vectors over the sides of the ball, by random
/// Fourier features; its correlation is `exp(-|v - w|^2 / (2 l^2))` (A. Rahimi, B. Recht, NIPS 2007).
#[derive(Debug, Clone)]
pub struct SharedField {
    /// Wave vector, phase, and amplitude in radians.
    waves: Vec<(Vec3, f64, Vec3)>,
}

impl SharedField {
    /// A field of this deviation and correlation.
    pub fn random<R: Rng + ?Sized>(shared: &SharedError, rng: &mut R) -> Self {
        let scale = shared.sigma_rad * (2.0 / FEATURES as f64).sqrt();
        let wave = |rng: &mut R| {
            let vector = Vec3::from_fn(|_, _| normal(rng)) / shared.correlation_rad;
            let phase = rng.random_range(0.0..TAU);
            let amplitude = Vec3::from_fn(|_, _| normal(rng)) * scale;
            (vector, phase, amplitude)
        };
        Self {
            waves: (0..FEATURES).map(|_| wave(rng)).collect(),
        }
    }

    /// The error of an orientation that shows this side (the direction towards the camera, pattern frame): a rotation vector in
    /// the pattern's frame, radians, that is applied first.
    pub fn at(&self, side: &Vec3) -> Vec3 {
        let wave = |(wave, phase, amplitude): &(Vec3, f64, Vec3)| {
            amplitude * (wave.dot(side) + phase).cos()
        };
        self.waves.iter().map(wave).sum()
    }
}

/// A simulated sequence and its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedSequence {
    /// The true motion at the first frame's nominal time, 0 s.
    pub truth: ConstantSpin,
    /// What was measured, in order of time.
    pub measurements: Vec<Measurement>,
    /// For each measurement, whether it is an outlier.
    pub outlier: Vec<bool>,
}

impl Scenario {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the field.
    pub fn check(&self) -> Result<()> {
        let within = |name: &'static str, range: std::ops::RangeInclusive<f64>, value: f64| {
            let expected = format!("{} to {}", range.start(), range.end());
            require(range.contains(&value), name, &expected, value)
        };
        let frames = format!("1 to {MAX_FRAMES}");
        require(
            (1..=MAX_FRAMES).contains(&self.frames),
            "frames",
            &frames,
            self.frames,
        )?;
        within("fps", 1e-3..=1e7, self.fps)?;
        within("jitter", 0.0..=1.0, self.jitter)?;
        within("sigma_rad", 0.0..=std::f64::consts::PI, self.sigma_rad)?;
        within("outliers", 0.0..=1.0, self.outliers)?;
        within("decay", 0.0..=1e3, self.decay_per_s)?;
        match self.drops {
            Drops::Probability(p) => within("drops", 0.0..=1.0, p),
            Drops::Keep(n) if n > self.frames => Err(Error::argument(
                "drops",
                format!("cannot keep {n} of {} frames", self.frames),
            )),
            Drops::Keep(_) => Ok(()),
        }
    }

    /// Simulates a ball with the given spin at time 0 (camera frame, rad/s).
    pub fn simulate<R: Rng + ?Sized>(&self, spin: Vec3, rng: &mut R) -> SimulatedSequence {
        let truth = ConstantSpin {
            time_s: 0.0,
            orientation: random_rotation(rng),
            spin,
        };
        let mut sequence = SimulatedSequence {
            truth,
            measurements: Vec::with_capacity(self.frames),
            outlier: Vec::with_capacity(self.frames),
        };
        for k in 0..self.frames {
            let shift: f64 = normal(rng);
            let shift = (self.jitter * shift).clamp(-1.0 / 3.0, 1.0 / 3.0);
            let time_s = (k as f64 + shift) / self.fps;
            let noise = Vec3::from_fn(|_, _| normal(rng)) * self.sigma_rad;
            let stray = random_rotation(rng);
            let is_outlier = rng.random::<f64>() < self.outliers;
            let dropped = rng.random::<f64>();
            let elapsed = decayed_time(time_s, self.decay_per_s);
            let real = Rotation::from_scaled_axis(noise)
                * Rotation::from_scaled_axis(spin * elapsed)
                * truth.orientation;
            if matches!(self.drops, Drops::Probability(p) if dropped < p) {
                continue;
            }
            let orientation = if is_outlier { stray } else { real };
            sequence
                .measurements
                .push(Measurement::new(time_s, orientation));
            sequence.outlier.push(is_outlier);
        }
        if let Drops::Keep(n) = self.drops {
            while sequence.measurements.len() > n {
                let victim = rng.random_range(0..sequence.measurements.len());
                sequence.measurements.remove(victim);
                sequence.outlier.remove(victim);
            }
        }
        sequence
    }

    /// Sequence number `index` of `seed`: magnitude uniform in `rps` (revolutions per second), axis
    /// uniform on the sphere.
    pub fn sequence(&self, rps: (f64, f64), seed: u64, index: u64) -> SimulatedSequence {
        let mut rng = stream(seed, index);
        let magnitude = rps.0 + (rps.1 - rps.0) * rng.random::<f64>();
        let spin = random_direction(&mut rng) * (magnitude * TAU);
        self.simulate(spin, &mut rng)
    }
}

/// The generator of sequence `index` of `seed`.
pub fn stream(seed: u64, index: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(index);
    rng
}

fn normal<R: Rng + ?Sized>(rng: &mut R) -> f64 {
    StandardNormal.sample(rng)
}
