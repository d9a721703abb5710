//! Whether the frames believe a motion: its evidence against that of no motion at these times.
//!
//! A sure orientation that does not follow a motion speaks against the motion, or against the times. Three hypotheses explain `n`
//! orientations, each of them wrong (uniform on SO(3), see `spin::mixture`) with the probability `1 - c_i`:
//!
//! | hypothesis | density of a right orientation |
//! |---|---|
//! | the motion | `N3(e_i; sigma^2)`, `e_i` from where the ball is at the frame's time |
//! | one axis, at no times | `N2(d_i; sigma^2) / 2 pi`, `d_i` from the circle of all orientations that a turn about the axis leads to |
//! | nothing | `1 / 8 pi^2` |
//!
//! The second is what frames make that are lost, repeated, out of order or stamped at random while the ball turns steadily. Rotations
//! about one axis from a start are the unit quaternions of a plane, which is fitted by expectation-maximization, from the motion's own.
//! Beyond what it shares with that plane the motion has a phase and a rate, for which it pays by Laplace's method (R. E. Kass, A.
//! E. Raftery, "Bayes factors", J. Am. Stat. Assoc. 90, 1995): the phase is uniform over a turn, the rate by the prior of
//! [`SpinConfig::ln_prior`], about the axis either way; each rate beyond them costs half the logarithm of the errors' number.
//!
//! Guaranteed: no motion is believed whose evidence is less than that of another of these. Not guaranteed: that there is no motion
//! where none is believed.

use std::f64::consts::TAU;

use nalgebra::{Matrix4, Quaternion, SymmetricEigen, Vector4};

use super::mixture::{NoiseVariance, ROTATION_VOLUME};
use super::motion::{LocalFrame, Motion};
use super::robust::SpinConfig;
use super::{Measurement, SpinRejection};
use crate::geometry::{Rotation, Vec3};

/// Rounds of expectation and maximization of the circle: from the motion's own it moves by less than its noise.
const ROUNDS: usize = 8;
/// They end where one gains less, natural logarithm.
const SETTLED: f64 = 0.1;
/// Orientations whose pairs span the circles that are tried, with each gap, and the least sine of half the angle between two.
const MAX_STARTS: usize = 16;
const MIN_APART: f64 = 0.03;
/// Right orientations whose errors along and across the turn are compared, and errors that are none. Frames near in time err together:
/// of windows of twelve rendered ones a third are off along the turn by more than three times as much as across it.
const MIN_COMPARED: f64 = 14.0;
const EXACT_RAD: f64 = 1e-5;
/// A sure orientation is wrong with this probability: none of 332 of real frames was (the 95 % interval ends at 1.1 %).
const MIN_WRONG: f64 = 0.01;

/// Natural logarithms of evidences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Belief {
    /// That of the motion.
    pub motion: f64,
    /// That of turns about one axis that these times say nothing of.
    pub axis: f64,
    /// That of orientations that have nothing to do with each other.
    pub nothing: f64,
    /// How far right orientations are off the motion along its axis over how far they are off its circle, per axis.
    pub along_over_across: f64,
    /// Orientations that follow the motion, of all.
    pub agreeing: usize,
    pub frames: usize,
}

impl Belief {
    /// What the measurements say of a motion with the noise `sigma_rad` that so many of them follow.
    pub fn of<M: Motion<P>, const P: usize>(
        measurements: &[Measurement],
        motion: &M,
        (sigma_rad, agreeing): (f64, usize),
        config: &SpinConfig,
    ) -> Self {
        let n = measurements.len() as f64;
        let own = Circle::fitted(measurements, motion, config.noise());
        // Where some do not follow the motion, they may be nearer to another circle.
        let other = match agreeing < measurements.len() {
            true => Circle::searched(measurements, config.noise()),
            false => None,
        };
        let circle = match other {
            Some(other) if other.ln_likelihood > own.ln_likelihood => other,
            _ => own,
        };
        Self {
            motion: ln_motion(measurements, motion, sigma_rad, config),
            axis: circle.ln_likelihood,
            nothing: -n * ROTATION_VOLUME.ln(),
            along_over_across: along_over_across(measurements, motion, sigma_rad, &circle),
            agreeing,
            frames: measurements.len(),
        }
    }

    /// The logarithm of the odds for the motion against turns about one axis at no times.
    pub fn gain(&self) -> f64 {
        self.motion - self.axis
    }

    /// Whether the motion has at least the evidence of anything else.
    ///
    /// # Errors
    /// [`SpinRejection::NotAtTheseTimes`] or [`SpinRejection::NoMotion`] where it has less.
    pub fn check(&self) -> Result<(), SpinRejection> {
        let (agreeing, frames) = (self.agreeing, self.frames);
        if self.motion >= self.axis.max(self.nothing) {
            return Ok(());
        }
        Err(match self.axis > self.nothing {
            true => SpinRejection::NotAtTheseTimes {
                agreeing,
                frames,
                in_order_rps: None,
            },
            false => SpinRejection::NoMotion { agreeing, frames },
        })
    }
}

/// The probability that an orientation is right.
fn trusted(m: &Measurement) -> f64 {
    m.confidence.clamp(MIN_WRONG, 1.0 - MIN_WRONG)
}

/// Probability that an orientation is right whose density were it so is `right`, and the mixture's density.
fn posterior(m: &Measurement, right: f64) -> (f64, f64) {
    let c = trusted(m);
    let total = c * right + (1.0 - c) / ROTATION_VOLUME;
    (c * right / total, total)
}

/// How much farther the right orientations are off the motion along its axis than off its circle.
fn along_over_across<M: Motion<P>, const P: usize>(
    measurements: &[Measurement],
    motion: &M,
    sigma_rad: f64,
    circle: &Circle,
) -> f64 {
    let jacobian = motion.jacobian();
    let (mut along, mut across, mut right) = (0.0, 0.0, 0.0);
    for m in measurements {
        let error = jacobian(m).0;
        let scale = m.sigma_scale * m.sigma_scale;
        let variance = sigma_rad * sigma_rad * scale;
        let density =
            (-0.5 * error.norm_squared() / variance).exp() / (TAU * variance).powi(3).sqrt();
        let (p, _) = posterior(m, density);
        along += p * error.z * error.z / scale;
        across += p * circle.square_off(m) / scale;
        right += p;
    }
    // Less what the circle's four numbers and the turn's two take.
    if right < MIN_COMPARED {
        return 1.0;
    }
    let (along, across) = (along / (right - 2.0), across / (2.0 * right - 4.0));
    (along / across.max(EXACT_RAD * EXACT_RAD)).sqrt()
}

/// The evidence of a motion.
fn ln_motion<M: Motion<P>, const P: usize>(
    measurements: &[Measurement],
    motion: &M,
    sigma_rad: f64,
    config: &SpinConfig,
) -> f64 {
    let jacobian = motion.jacobian();
    let (mut ln, mut weight, mut moment, mut square) = (0.0, 0.0, 0.0, 0.0);
    let (start, mut right) = (measurements[0].time_s, 0.0);
    for m in measurements {
        let variance = (sigma_rad * m.sigma_scale).powi(2);
        let off = jacobian(m).0.norm_squared();
        let density = (-0.5 * off / variance).exp() / (TAU * variance).powi(3).sqrt();
        let (p, density) = posterior(m, density);
        let (w, t) = (p / variance, m.time_s - start);
        ln += density.ln();
        right += p;
        weight += w;
        moment += w * t;
        square += w * t * t;
    }
    let spread = square - moment * moment / weight;
    let std = spread.max(f64::MIN_POSITIVE).sqrt().recip();
    let rate = motion.local_frame().rate.max(std);
    let phase = (TAU.sqrt() / (weight.sqrt() * TAU)).min(1.0);
    let share = TAU.sqrt() * std * 0.5 * config.rate_density(rate);
    let beyond = 0.5 * (P - 3) as f64 * (3.0 * right).max(1.0).ln();
    ln + phase.ln() + share.min(1.0).ln() - beyond
}

/// The orientations that turns about one axis lead to: a plane of quaternions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Circle {
    /// Two quaternions at right angles that span it.
    pub plane: [Vector4<f64>; 2],
    /// Noise per axis across it, radians.
    pub sigma_rad: f64,
    /// Of all orientations, each at any angle.
    pub ln_likelihood: f64,
}

impl Circle {
    /// The circle nearest to a motion's own.
    pub fn fitted<M: Motion<P>, const P: usize>(
        measurements: &[Measurement],
        motion: &M,
        noise: NoiseVariance,
    ) -> Self {
        let LocalFrame { basis, .. } = motion.local_frame();
        let middle = 0.5 * (measurements[0].time_s + measurements[measurements.len() - 1].time_s);
        let start = motion.predict(middle).into_inner();
        let axis = Quaternion::from_parts(0.0, basis.column(2).into_owned());
        let circle = Self {
            plane: [start.coords, (axis * start).coords],
            sigma_rad: noise.sigma_rad,
            ln_likelihood: f64::NEG_INFINITY,
        };
        circle.settled(measurements, noise)
    }

    /// Squared angle between an orientation and the circle, rad^2.
    pub fn square_off(&self, m: &Measurement) -> f64 {
        let q = m.orientation.coords;
        let [a, b] = self.plane.map(|axis| axis.dot(&q));
        let off = (1.0 - a * a - b * b).clamp(0.0, 1.0).sqrt();
        (2.0 * off.asin()).powi(2)
    }

    /// Density of a right orientation.
    fn density(&self, m: &Measurement) -> f64 {
        let variance = (self.sigma_rad * m.sigma_scale).powi(2);
        (-0.5 * self.square_off(m) / variance).exp() / (TAU * variance) / TAU
    }

    /// The circle that the orientations lie nearest to, of those through two of them.
    pub fn searched(measurements: &[Measurement], noise: NoiseVariance) -> Option<Self> {
        let n = measurements.len();
        let through = |(i, j): (usize, usize)| {
            let [a, b] = [i, j].map(|k| measurements[k].orientation.coords);
            let off = b - a * a.dot(&b);
            let plane = [a, off.try_normalize(MIN_APART)?];
            let circle = Self {
                plane,
                sigma_rad: noise.sigma_rad,
                ln_likelihood: f64::NEG_INFINITY,
            };
            let ln = |m: &Measurement| posterior(m, circle.density(m)).1.ln();
            Some(Self {
                ln_likelihood: measurements.iter().map(ln).sum(),
                ..circle
            })
        };
        let gaps = [1, 2, 3, 5, 8, n / 3, n / 2];
        let pairs = gaps.into_iter().flat_map(|gap| {
            let starts = n.saturating_sub(gap.max(1));
            let stride = starts.div_ceil(MAX_STARTS).max(1);
            (0..starts)
                .step_by(stride)
                .map(move |i| (i, i + gap.max(1)))
        });
        let best = pairs.filter_map(through);
        let best = best.max_by(|a, b| a.ln_likelihood.total_cmp(&b.ln_likelihood))?;
        Some(best.settled(measurements, noise))
    }

    /// The circle that it leads to.
    fn settled(mut self, measurements: &[Measurement], noise: NoiseVariance) -> Self {
        for _ in 0..ROUNDS {
            let before = self.ln_likelihood;
            self = self.improved(measurements, noise);
            if self.ln_likelihood - before < SETTLED {
                break;
            }
        }
        self
    }

    /// Whether an orientation is rather on the circle than wrong.
    pub fn is_on(&self, m: &Measurement) -> bool {
        posterior(m, self.density(m)).0 > 0.5
    }

    /// The angle of an orientation on the circle.
    pub fn angle(&self, m: &Measurement) -> f64 {
        let [x, y] = self.plane.map(|axis| axis.dot(&m.orientation.coords));
        2.0 * y.atan2(x)
    }

    /// The orientation at an angle.
    pub fn at(&self, angle: f64) -> Rotation {
        let (sin, cos) = (0.5 * angle).sin_cos();
        let [a, b] = self.plane;
        Rotation::new_normalize(Quaternion::from_vector(a * cos + b * sin))
    }

    /// The axis that angles are about.
    pub fn axis(&self) -> Vec3 {
        let [a, b] = self.plane.map(Quaternion::from_vector);
        (b * a.conjugate()).imag()
    }

    fn improved(&self, measurements: &[Measurement], noise: NoiseVariance) -> Self {
        let mut products = Matrix4::zeros();
        let (mut ln, mut right, mut squares) = (0.0, 0.0, 0.0);
        for m in measurements {
            let (p, density) = posterior(m, self.density(m));
            let scale = m.sigma_scale * m.sigma_scale;
            let q = m.orientation.coords;
            products += q * q.transpose() * (p / scale);
            squares += p * self.square_off(m) / scale;
            right += p;
            ln += density.ln();
        }
        let eigen = SymmetricEigen::new(products);
        let mut order = [0, 1, 2, 3];
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let [first, second, ..] = order;
        let axis = |i: usize| eigen.eigenvectors.column(i).into_owned();
        Self {
            plane: [axis(first), axis(second)],
            sigma_rad: noise.of_circle(right, squares),
            ln_likelihood: ln,
        }
    }
}
