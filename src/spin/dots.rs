//! The last refinement of a spin: directly on all dots of all frames.
//!
//! An orientation per frame, taken as equally uncertain about every axis, discards the directions
//! in which its few visible dots determine it badly. Here the motion is fitted to the dots
//! themselves: dot `a` of the pattern is expected at `p = exp([w]x (t - t0)) R(t0) a`, and observed
//! at an angle `e` from there (a vector in the tangent plane, two components of noise sigma each)
//! with probability `p_right`, else anywhere on the visible half of the sphere, whose area is 2 pi.
//! A rotation of the prediction by `x` moves the dot by `(I - p p^T) x` as a rotation vector, so
//! that with the frame's Jacobian `J` of [`super::robust`]'s fit the information is
//!
//! ```text
//! sum over dots  p(right) J^T (I - p p^T) J / sigma^2
//! ```
//!
//! It starts from a spin that is correct up to noise and climbs to the nearest maximum of the
//! likelihood. It neither searches for other spins nor changes the identities of dots.

use nalgebra::{Matrix3, Matrix6, SVector};

use super::refine::{MAX_NOISE, Residual, axis_and_rate, jacobian};
use super::{Fit, MIN_FRAMES, Motion, SpinRejection};
use crate::geometry::{Rotation, Vec3};
use crate::pattern::Pattern;

/// Maximum number of steps: from a good start three or four do.
const MAX_STEPS: usize = 30;
/// A step shorter than this many standard deviations ends the iteration.
const CONVERGED: f64 = 1e-4;

/// An identified dot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenDot {
    /// Its index in the pattern.
    pub dot: usize,
    /// Where it was seen: a unit vector in the camera frame.
    pub direction: Vec3,
}

/// The identified dots of one image.
#[derive(Debug, Clone, PartialEq)]
pub struct DotFrame {
    /// Time, seconds, in the time base of the spin to refine.
    pub time_s: f64,
    /// The dots; those without an identity are left out.
    pub dots: Vec<SeenDot>,
}

/// Settings of [`refine_on_dots`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DotRefineConfig {
    /// Noise of a dot's direction per tangential axis, radians: a first guess.
    pub sigma_rad: f64,
    /// Weight of the first guess, in degrees of freedom; infinite: the noise is known and fixed.
    pub sigma_degrees: f64,
    /// Probability that a dot's identity is correct.
    pub right: f64,
}

impl Default for DotRefineConfig {
    /// 2 deg per axis (the paper's rotation by 3 deg about a random axis moves a dot by 1.7 deg per
    /// axis), worth four degrees of freedom; nineteen identities in twenty correct.
    fn default() -> Self {
        Self {
            sigma_rad: 2f64.to_radians(),
            sigma_degrees: 4.0,
            right: 0.95,
        }
    }
}

/// Fits the motion to the dots, from the motion of `start`.
///
/// The result's reference time is that of `start`; `inliers` counts the frames most of whose dots
/// are inliers.
///
/// # Errors
/// A [`SpinRejection`] where a dot is not in the pattern, or fewer than three frames agree.
pub fn refine_on_dots(
    pattern: &Pattern,
    frames: &[DotFrame],
    start: &Fit,
    options: &DotRefineConfig,
) -> Result<Fit, SpinRejection> {
    check(pattern, frames)?;
    let rejected = |agreeing| SpinRejection::NoConsensus {
        agreeing,
        frames: frames.len(),
        max_rps: start.motion.rps(),
    };
    let mut motion = start.motion;
    let mut sigma = options.sigma_rad;
    let mut degrees = options.sigma_degrees;
    let mut sums = Sums::new(pattern, frames, &motion, sigma, options.right);
    for _ in 0..MAX_STEPS {
        let solved = sums.information.cholesky();
        let change = solved.ok_or(rejected(sums.inliers))?.solve(&sums.gradient);
        let length = change.dot(&sums.gradient);
        let turn = Rotation::from_scaled_axis(change.fixed_rows::<3>(0).into_owned());
        motion.orientation = Rotation::new_normalize((turn * motion.orientation).into_inner());
        motion.spin += change.fixed_rows::<3>(3);
        let mut drift = 0.0;
        if options.sigma_degrees.is_finite() {
            degrees = options.sigma_degrees + (2.0 * sums.support - 6.0).max(0.0);
            let squares = options.sigma_degrees * options.sigma_rad.powi(2) + sums.squares;
            let next = (squares / degrees)
                .sqrt()
                .min(MAX_NOISE * options.sigma_rad);
            drift = (next / sigma - 1.0).abs();
            sigma = next;
        }
        sums = Sums::new(pattern, frames, &motion, sigma, options.right);
        if length < CONVERGED * CONVERGED && drift < CONVERGED {
            break;
        }
    }
    let solved = sums.information.cholesky().ok_or(rejected(sums.inliers))?;
    if sums.inliers < MIN_FRAMES {
        return Err(rejected(sums.inliers));
    }
    let widening = match degrees {
        d if d.is_finite() => d / (d - 2.0).max(1.0),
        _ => 1.0,
    };
    Ok(Fit {
        motion,
        spin_covariance: Some(solved.inverse().fixed_view::<3, 3>(3, 3) * widening),
        sigma_rad: Some(sigma),
        log_likelihood: Some(sums.log_likelihood),
        inliers: sums.inliers,
    })
}

fn check(pattern: &Pattern, frames: &[DotFrame]) -> Result<(), SpinRejection> {
    for (index, frame) in frames.iter().enumerate() {
        if !frame.time_s.is_finite() {
            let time_s = frame.time_s;
            return Err(SpinRejection::Times { index, time_s });
        }
        for seen in &frame.dots {
            let problem = if seen.dot >= pattern.len() {
                "expected dots of the pattern"
            } else if (seen.direction.norm_squared() - 1.0).abs() >= 1e-6 {
                "expected unit vectors"
            } else {
                continue;
            };
            return Err(SpinRejection::Measurement { index, problem });
        }
    }
    if frames.len() < MIN_FRAMES {
        let (found, needed) = (frames.len(), MIN_FRAMES);
        return Err(SpinRejection::TooFewFrames { found, needed });
    }
    Ok(())
}

/// The sums of one Gauss-Newton step.
struct Sums {
    information: Matrix6<f64>,
    gradient: SVector<f64, 6>,
    support: f64,
    squares: f64,
    log_likelihood: f64,
    inliers: usize,
}

impl Sums {
    fn new(
        pattern: &Pattern,
        frames: &[DotFrame],
        motion: &Motion,
        sigma: f64,
        p_right: f64,
    ) -> Self {
        let mut sums = Self {
            information: Matrix6::zeros(),
            gradient: SVector::zeros(),
            support: 0.0,
            squares: 0.0,
            log_likelihood: 0.0,
            inliers: 0,
        };
        let (axis, rate) = axis_and_rate(&motion.spin);
        for frame in frames {
            let predicted = motion.at(frame.time_s);
            let elapsed = frame.time_s - motion.time_s;
            // Only the Jacobian is wanted: the prediction against itself.
            let own = Residual::after(elapsed, &motion.orientation, &axis, rate, &predicted);
            let (mut matrix, mut vector, mut right) = (Matrix3::zeros(), Vec3::zeros(), 0.0);
            for seen in &frame.dots {
                let p = predicted * pattern.dots()[seen.dot];
                let error = rotation_between(&p, &seen.direction);
                let e2 = error.norm_squared();
                let (weight, log_likelihood) = posterior(p_right, e2, sigma * sigma);
                matrix += (Matrix3::identity() - p * p.transpose()) * weight;
                vector += error * weight;
                right += weight;
                sums.squares += weight * e2;
                sums.log_likelihood += log_likelihood;
            }
            let j = jacobian(&axis, &own);
            let inverse = 1.0 / (sigma * sigma);
            sums.information += j.transpose() * matrix * j * inverse;
            sums.gradient += j.transpose() * vector * inverse;
            sums.support += right;
            sums.inliers += usize::from(right > 0.5 * frame.dots.len() as f64);
        }
        sums
    }
}

/// The shortest rotation vector that takes one unit vector to another.
fn rotation_between(from: &Vec3, to: &Vec3) -> Vec3 {
    let cross = from.cross(to);
    let sine = cross.norm();
    let angle = sine.atan2(from.dot(to));
    // Equal directions have no axis and need none; opposite ones are outliers whatever their axis.
    cross * if sine > 1e-12 { angle / sine } else { 1.0 }
}

/// Probability that a dot at squared angle `e2` is an inlier, and the log of the mixture's density.
fn posterior(p_right: f64, e2: f64, variance: f64) -> (f64, f64) {
    let area = std::f64::consts::TAU;
    let good = p_right / (area * variance) * (-0.5 * e2 / variance).exp();
    let total = good + (1.0 - p_right) / area;
    (good / total, total.ln())
}
