//! The prior of smooth rotation: a ball's spin changes little between two frames.
//!
//! The spin `w` is a random walk with the density `q` (white angular acceleration), so that over the
//! time `t` the orientation and the spin move by
//!
//! ```text
//! r = log(exp(-w t) R' R^-1),   s = w' - w,   cov(r, s) = q | t^3/3  t^2/2 |
//!                                                           | t^2/2  t     |
//! ```
//!
//! (the constant-velocity model of Kalman filters: Y. Bar-Shalom et al., "Estimation with applications
//! to tracking and navigation", 2001, Sec. 6.2.2). `q` is learned from the second differences of the
//! orientations that the dots alone give. Where frames are too far apart to say how the ball turned
//! between them, and no single spin explains them, there is no such prior.
//!
//! A hand takes the ball anew, or a clip is cut: then the ball turns abruptly. An interval is that with the
//! probability [`ABRUPT`], and then any rotation is as likely as another and the spin is another one of the
//! clip's. Of such a mixture
//!
//! ```text
//! p(r, s) = (1 - e) N(r, s; 0, cov(r, s)) + e N(s; 0, v I) / 8 pi^2
//! ```
//!
//! an interval counts by the probabilities of its two parts, as in expectation maximization.
//!
//! An uneven ball's spin changes without any torque. Where the frames show a precession
//! ([`crate::spin::precession`]), the turn `q` that is fixed in the ball is taken off: `R exp([q]x t)`
//! stands for `R`, `w` is the part that is fixed in space, and times are those of a clock that slows
//! down as the spin decays.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, SMatrix, SVector};

use super::schur::{BLOCK, Block, NormalEquations};
use crate::geometry::{Rotation, Vec3, left_jacobian};
use crate::spin::motion::decayed_time;
use crate::spin::precession::{PrecessionOutcome, fit_precession};
use crate::spin::robust::SpinConfig;
use crate::spin::{MIN_INTERVAL_S, Measurement};
use crate::stats::median;

/// Frame to frame turns up to this median angle, radians, are taken as they are: the shorter way.
const SLOW_RAD: f64 = 0.8;
/// Minimum share of the frames that one spin must explain to be the motion of faster ones.
const MIN_AGREEING: f64 = 0.7;
/// Minimum number of frames with a neighbor on both sides from which the density is learned.
const MIN_TRIPLES: usize = 5;
/// Squared median of the length of a normal vector in space, over its variance per axis.
const CHI2_3_MEDIAN: f64 = 2.366;
/// The density never falls below the one that bends a path over so many frames by one standard
/// deviation of a frame: no ball turns evenly without end.
const EVEN_FRAMES: f64 = 8.0;
/// Numbers of frames over which the change of the rate is measured.
const SPANS: [usize; 4] = [1, 2, 4, 8];
/// Probability that the ball turns abruptly between two frames.
const ABRUPT: f64 = 0.01;
/// Start of the orientation and of the spin within a frame's block.
const TURN: usize = 0;
/// See [`TURN`].
pub(super) const SPIN: usize = 6;

/// How a ball moves between its frames.
#[derive(Debug, Clone)]
pub(super) struct MotionPrior {
    /// Time from each frame to the next, seconds.
    intervals: Vec<f64>,
    /// Density of the angular acceleration, rad^2/s^3.
    density: f64,
    /// Variance per axis of the spin's change where the ball turns abruptly, rad^2/s^2.
    abrupt_variance: f64,
    /// Spin at each frame to start from, less `body_rate`, rad/s.
    pub spins: Vec<Vec3>,
    /// The turn that is fixed in the ball, pattern frame, rad/s.
    body_rate: Vec3,
}

/// A frame as the dots alone give it.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimedPose {
    pub time_s: f64,
    /// Pattern to camera.
    pub rotation: Rotation,
    /// Mean variance per axis, rad^2.
    pub variance: f64,
}

impl MotionPrior {
    /// Learns the prior; `None` where there is none (see the module's head).
    pub fn learn(poses: &[TimedPose]) -> Option<Self> {
        let apart = |w: &[TimedPose]| w[1].time_s - w[0].time_s;
        if poses.len() < MIN_TRIPLES + 2 || poses.windows(2).any(|w| apart(w) < MIN_INTERVAL_S) {
            return None;
        }
        let Reference {
            spin,
            body_rate,
            decay,
        } = Reference::of(poses)?;
        // On this clock a spin that decays is constant.
        let clock = |p: &TimedPose| decayed_time(p.time_s - poses[0].time_s, decay);
        let intervals: Vec<f64> = poses
            .windows(2)
            .map(|w| clock(&w[1]) - clock(&w[0]))
            .collect();
        let rates: Vec<Vec3> = poses
            .windows(2)
            .zip(&intervals)
            .map(|(w, t)| {
                let from = w[0].rotation * Rotation::from_scaled_axis(body_rate * *t);
                spin + turn_beyond(&spin, *t, &from, &w[1].rotation) / *t
            })
            .collect();
        let density = density(poses, &intervals, &rates);
        // A frame's spin: the mean of those before and after.
        let mut spins = Vec::with_capacity(poses.len());
        for k in 0..poses.len() {
            let before = k.checked_sub(1).map(|i| rates[i]);
            let after = rates.get(k).copied();
            spins.push(match (before, after) {
                (Some(a), Some(b)) => 0.5 * (a + b),
                (a, b) => a.or(b)?,
            });
        }
        // Another spin of the clip's: the variance of both.
        let squares = rates.iter().map(Vec3::norm_squared).sum::<f64>();
        let abrupt_variance = 2.0 / 3.0 * squares / rates.len() as f64;
        let usual = density * median(&mut intervals.clone());
        Some(Self {
            intervals,
            density,
            abrupt_variance: abrupt_variance.max(usual),
            spins,
            body_rate,
        })
    }

    /// Residual, and its derivatives by the blocks of frame `k` and of the next.
    fn residual(
        &self,
        k: usize,
        rotations: [&Rotation; 2],
        spins: [&Vec3; 2],
    ) -> (SVector<f64, 6>, [SMatrix<f64, 6, BLOCK>; 2]) {
        let t = self.intervals[k];
        // A turn of R on the left is one of R exp(q t).
        let from = rotations[0] * Rotation::from_scaled_axis(self.body_rate * t);
        let turn = turn_beyond(spins[0], t, &from, rotations[1]);
        let mut residual = SVector::<f64, 6>::zeros();
        residual.fixed_rows_mut::<3>(0).copy_from(&turn);
        residual
            .fixed_rows_mut::<3>(3)
            .copy_from(&(spins[1] - spins[0]));
        let mut here = SMatrix::<f64, 6, BLOCK>::zeros();
        let mut next = SMatrix::<f64, 6, BLOCK>::zeros();
        // exp(-(w + dw) t) exp(x') R' R^-1 exp(-x): to first order, for a small residual.
        let back = -spins[0] * t;
        let turned = Rotation::from_scaled_axis(back).to_rotation_matrix();
        here.fixed_view_mut::<3, 3>(0, TURN)
            .copy_from(&-Matrix3::identity());
        here.fixed_view_mut::<3, 3>(0, SPIN)
            .copy_from(&(left_jacobian(&back) * -t));
        next.fixed_view_mut::<3, 3>(0, TURN)
            .copy_from(turned.matrix());
        here.fixed_view_mut::<3, 3>(3, SPIN)
            .copy_from(&-Matrix3::identity());
        next.fixed_view_mut::<3, 3>(3, SPIN)
            .copy_from(&Matrix3::identity());
        (residual, [here, next])
    }

    /// Inverse covariance of the residual over interval `k` where the ball turns smoothly.
    fn smooth_information(&self, k: usize) -> SMatrix<f64, 6, 6> {
        let (t, q) = (self.intervals[k], self.density);
        let mut information = SMatrix::<f64, 6, 6>::zeros();
        for axis in 0..3 {
            information[(axis, axis)] = 12.0 / (q * t.powi(3));
            information[(axis, axis + 3)] = -6.0 / (q * t * t);
            information[(axis + 3, axis)] = -6.0 / (q * t * t);
            information[(axis + 3, axis + 3)] = 4.0 / (q * t);
        }
        information
    }

    /// What a residual over interval `k` says of it.
    fn judge(&self, k: usize, residual: &SVector<f64, 6>) -> Interval {
        let (t, q, v) = (self.intervals[k], self.density, self.abrupt_variance);
        let information = self.smooth_information(k);
        let smooth_squared = residual.dot(&(information * residual));
        let abrupt_squared = residual.fixed_rows::<3>(3).norm_squared() / v;
        // Densities at a residual of zero, the abrupt over the smooth: det cov(r, s) = (q^2 t^4 / 12)^3.
        let peaks = TAU.powf(1.5) * (q * q * t.powi(4) / (12.0 * v)).powf(1.5) / (8.0 * PI * PI);
        let odds = ABRUPT / (1.0 - ABRUPT) * peaks;
        let [smooth, abrupt] = [-0.5 * smooth_squared, odds.ln() - 0.5 * abrupt_squared];
        let smooth_share = 1.0 / (1.0 + (abrupt - smooth).exp());
        let mut mixed = information * smooth_share;
        for axis in 3..6 {
            mixed[(axis, axis)] += (1.0 - smooth_share) / v;
        }
        let likelier = smooth.max(abrupt);
        let other = smooth.min(abrupt);
        Interval {
            smooth_share,
            smooth_squared,
            information: mixed,
            // Zero at a residual of zero.
            cost: odds.ln_1p() - likelier - (other - likelier).exp().ln_1p(),
        }
    }

    fn intervals(&self, rotations: &[Rotation], spins: &[Vec3]) -> impl Iterator<Item = Interval> {
        (0..self.intervals.len()).map(move |k| {
            let at = k + 1;
            let (r, _) = self.residual(k, [&rotations[k], &rotations[at]], [&spins[k], &spins[at]]);
            self.judge(k, &r)
        })
    }

    /// Weakens the prior where its residuals, of what turns smoothly, are larger than it allows; whether that was so.
    pub fn relax(&mut self, rotations: &[Rotation], spins: &[Vec3]) -> bool {
        // Six residuals an interval, each of which would have a square of 1.
        let (mut squares, mut count) = (0.0, 0.0);
        for interval in self.intervals(rotations, spins) {
            squares += interval.smooth_share * interval.smooth_squared;
            count += 6.0 * interval.smooth_share;
        }
        let too_strong = squares > count;
        if too_strong {
            self.density *= squares / count;
        }
        too_strong
    }

    /// The negative logarithm of the density of all residuals, over that of none.
    pub fn cost(&self, rotations: &[Rotation], spins: &[Vec3]) -> f64 {
        self.intervals(rotations, spins).map(|i| i.cost).sum()
    }

    /// Adds the prior to the normal equations.
    pub fn add_to(&self, equations: &mut NormalEquations, rotations: &[Rotation], spins: &[Vec3]) {
        for k in 0..self.intervals.len() {
            let at = k + 1;
            let (residual, [here, next]) =
                self.residual(k, [&rotations[k], &rotations[at]], [&spins[k], &spins[at]]);
            let information = self.judge(k, &residual).information;
            let weighted: [SMatrix<f64, BLOCK, 6>; 2] = [
                here.transpose() * information,
                next.transpose() * information,
            ];
            equations.diagonal[k] += weighted[0] * here;
            equations.diagonal[at] += weighted[1] * next;
            let coupling: Block = weighted[0] * next;
            equations.coupling[k] += coupling;
            equations.gradient[k] -= weighted[0] * residual;
            equations.gradient[at] -= weighted[1] * residual;
        }
    }
}

/// What the residual over the time between two frames says.
struct Interval {
    /// Probability that the ball turns smoothly.
    smooth_share: f64,
    /// Squared Mahalanobis length, if it does.
    smooth_squared: f64,
    /// Expected inverse covariance.
    information: SMatrix<f64, 6, 6>,
    /// See [`MotionPrior::cost`].
    cost: f64,
}

/// The motion from which the rates are taken.
struct Reference {
    /// The part of the spin that is fixed in space, and that fixed in the ball, rad/s.
    spin: Vec3,
    body_rate: Vec3,
    /// Rate of decay, 1/s.
    decay: f64,
}

impl Reference {
    /// The motion that all frames share, or none where they turn little from one to the next; `None`
    /// for neither.
    fn of(poses: &[TimedPose]) -> Option<Self> {
        let angles = poses
            .windows(2)
            .map(|w| w[0].rotation.angle_to(&w[1].rotation));
        if median(&mut angles.collect::<Vec<_>>()) < SLOW_RAD {
            return Some(Self {
                spin: Vec3::zeros(),
                body_rate: Vec3::zeros(),
                decay: 0.0,
            });
        }
        let measurements: Vec<Measurement> = poses
            .iter()
            .map(|p| Measurement::new(p.time_s, p.rotation))
            .collect();
        let (inliers, reference) = match fit_precession(&measurements, &SpinConfig::default()) {
            Ok(PrecessionOutcome::Found { fit, .. }) => {
                let reference = Self {
                    spin: fit.motion.space.spin,
                    body_rate: fit.motion.body_rate,
                    decay: fit.motion.decay_per_s,
                };
                (fit.inliers, reference)
            }
            Ok(PrecessionOutcome::Constant { fit, .. }) => {
                let reference = Self {
                    spin: fit.motion.spin,
                    body_rate: Vec3::zeros(),
                    decay: 0.0,
                };
                (fit.inliers, reference)
            }
            Err(_) => return None,
        };
        let enough = inliers as f64 >= MIN_AGREEING * poses.len() as f64;
        enough.then_some(reference)
    }
}

/// `log(exp(-w t) R' R^-1)`: the turn beyond that of the spin `w`.
fn turn_beyond(spin: &Vec3, t: f64, from: &Rotation, to: &Rotation) -> Vec3 {
    (Rotation::from_scaled_axis(-spin * t) * to * from.inverse()).scaled_axis()
}

/// Density of the angular acceleration, from the changes of the mean rate between successive spans of
/// one and more frames: a steady acceleration shows over the long ones only. The largest counts, so that
/// the prior is rather too weak than too strong. A change over the spans `a` and `b` has the variance
/// `q (a + b) / 3` beyond that of the poses.
fn density(poses: &[TimedPose], intervals: &[f64], rates: &[Vec3]) -> f64 {
    let mut largest = 0.0f64;
    for span in SPANS {
        let mut densities = Vec::with_capacity(rates.len());
        let mut floors = Vec::with_capacity(rates.len());
        for start in 0..(rates.len() + 1).saturating_sub(2 * span) {
            let [first, second] = [start, start + span].map(|from| {
                let steps = from..from + span;
                let time: f64 = intervals[steps.clone()].iter().sum();
                let turn: Vec3 = steps.map(|k| rates[k] * intervals[k]).sum();
                (time, turn / time)
            });
            let (a, b) = (first.0, second.0);
            let middle = poses[start + span].variance;
            let noise = poses[start].variance / (a * a)
                + middle * (1.0 / a + 1.0 / b).powi(2)
                + poses[start + 2 * span].variance / (b * b);
            let measured = (second.1 - first.1).norm_squared() / CHI2_3_MEDIAN;
            densities.push((measured - noise) * 3.0 / (a + b));
            let even = EVEN_FRAMES * 0.5 * (a + b) / span as f64;
            floors.push(3.0 * middle / even.powi(3));
        }
        if densities.len() >= MIN_TRIPLES {
            largest = largest.max(median(&mut densities)).max(median(&mut floors));
        }
    }
    largest
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_derivatives_are_those_of_differences() {
        let prior = MotionPrior {
            intervals: vec![0.02],
            density: 1.0,
            abrupt_variance: 1.0,
            spins: Vec::new(),
            body_rate: Vec3::new(3.0, -8.0, 5.0),
        };
        let spin = Vec3::new(40.0, -60.0, 20.0);
        let from = Rotation::from_scaled_axis(Vec3::new(0.3, 1.0, -0.4));
        // Exactly the predicted orientation: the linearization is about a residual of 0.
        let to = Rotation::from_scaled_axis(spin * 0.02)
            * from
            * Rotation::from_scaled_axis(prior.body_rate * 0.02);
        let (_, jacobians) = prior.residual(0, [&from, &to], [&spin, &spin]);
        let step = 1e-6;
        for (which, jacobian) in jacobians.iter().enumerate() {
            for column in (0..3).chain(SPIN..BLOCK) {
                let mut moved = [(from, spin), (to, spin)];
                let mut delta = Vec3::zeros();
                delta[column % 3] = step;
                let (rotation, spin) = &mut moved[which];
                if column < 3 {
                    *rotation = Rotation::from_scaled_axis(delta) * *rotation;
                } else {
                    *spin += delta;
                }
                let [a, b] = &moved;
                let (residual, _) = prior.residual(0, [&a.0, &b.0], [&a.1, &b.1]);
                let found = residual / step;
                let off = (found - jacobian.column(column)).norm();
                assert!(off < 1e-4, "frame {which}, column {column}: {off}");
            }
        }
    }

    #[test]
    fn an_abrupt_turn_is_none_of_the_prior_s() {
        let turn = |k: u32| match k {
            0..=30 => Rotation::from_scaled_axis(Vec3::y() * 0.14 * f64::from(k)),
            _ => {
                Rotation::from_scaled_axis(Vec3::x() * 0.14 * f64::from(k - 30))
                    * Rotation::from_scaled_axis(Vec3::y() * 4.2)
            }
        };
        let pose = |k: u32| TimedPose {
            time_s: f64::from(k) / 30.0,
            rotation: turn(k),
            variance: 1e-6,
        };
        let poses: Vec<TimedPose> = (0..61).map(pose).collect();
        let mut prior = MotionPrior::learn(&poses).unwrap();
        let (density, spins) = (prior.density, prior.spins.clone());
        let rotations: Vec<Rotation> = poses.iter().map(|p| p.rotation).collect();
        for (k, interval) in prior.intervals(&rotations, &spins).enumerate() {
            // The spin at the turn's frame is that between.
            let is_smooth = k != 29 && k != 30;
            let share = interval.smooth_share;
            match is_smooth {
                true => assert!(share > 0.99, "{k}: {share}"),
                false => assert!(share < 0.01, "{k}: {share}"),
            }
        }
        assert!(!prior.relax(&rotations, &spins));
        assert_eq!(prior.density, density);
    }

    #[test]
    fn the_cost_is_the_mixture_s() {
        let prior = MotionPrior {
            intervals: vec![0.02],
            density: 3.0,
            abrupt_variance: 50.0,
            spins: Vec::new(),
            body_rate: Vec3::zeros(),
        };
        let normal = |r: &SVector<f64, 6>| {
            let covariance = prior.smooth_information(0).try_inverse().unwrap();
            let volume = (TAU.powi(6) * covariance.determinant()).sqrt();
            let squared = r.dot(&(prior.smooth_information(0) * r));
            let of_spin = r.fixed_rows::<3>(3).norm_squared() / prior.abrupt_variance;
            let of_spin = (-0.5 * of_spin).exp() / (TAU * prior.abrupt_variance).powf(1.5);
            // The volume of all rotations is 8 pi^2.
            [
                (1.0 - ABRUPT) * (-0.5 * squared).exp() / volume,
                ABRUPT * of_spin / (8.0 * PI * PI),
            ]
        };
        let none: f64 = normal(&SVector::zeros()).iter().sum();
        for scale in [0.0, 0.3, 1.0, 3.0, 10.0] {
            let r = SVector::<f64, 6>::new(0.001, 0.0, -0.002, 0.1, 0.3, -0.2) * scale;
            let [smooth, abrupt] = normal(&r);
            let of = prior.judge(0, &r);
            let cost = (none / (smooth + abrupt)).ln();
            assert!((of.cost - cost).abs() < 1e-9 * (1.0 + cost), "{scale}");
            let share = smooth / (smooth + abrupt);
            assert!((of.smooth_share - share).abs() < 1e-9, "{scale}");
        }
    }

    #[test]
    fn the_density_of_a_made_motion_is_found_within_a_factor() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let (q, t, sigma) = (4.0f64, 0.01, 0.002);
        let mut normal = || Vec3::from_fn(|_, _| StandardNormal.sample(&mut rng));
        let mut spin = Vec3::new(10.0, 0.0, 3.0);
        let mut rotation = Rotation::identity();
        let poses: Vec<TimedPose> = (0..400)
            .map(|k| {
                let noise: Vec3 = normal() * sigma;
                let pose = TimedPose {
                    time_s: f64::from(k) * t,
                    rotation: Rotation::from_scaled_axis(noise) * rotation,
                    variance: sigma * sigma,
                };
                // Ten steps of the walk within a frame.
                for _ in 0..10 {
                    let kick: Vec3 = normal() * (q * t / 10.0).sqrt();
                    spin += kick;
                    rotation = Rotation::from_scaled_axis(spin * (t / 10.0)) * rotation;
                }
                pose
            })
            .collect();
        let prior = MotionPrior::learn(&poses).unwrap();
        assert!(
            (q / 2.0..q * 2.0).contains(&prior.density),
            "{}",
            prior.density
        );
    }
}
