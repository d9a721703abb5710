//! The paper's spin regression: QuateRA with RANSAC (T. Gossard et al., "SpinDOE", arXiv
//! 2303.03879, Sec. II-D; M. Almeida et al., "QuateRA: the quaternion regression algorithm", J.
//! Guid. Control Dyn. 43, 2020). The baseline, kept as it is; [`super::robust`] is the better
//! estimator.
//!
//! With a constant spin the quaternions `q(t) = exp(n phi(t) / 2) q0` lie in a plane through the
//! origin of R^4: `q = cos(phi/2) u1 + sin(phi/2) u2` with `u2 = n u1`, hence `n = u2 u1*`, without
//! a sign to be found by trial. The plane is spanned by the two leading eigenvectors of `sum q
//! q^T`, which does not care about the quaternions' signs. Angles are `phi = 2 atan2(q.u2, q.u1)`,
//! unwrapped and regressed on time: the spin is `n dphi/dt`.
//!
//! RANSAC: the plane is fitted to short runs of successive frames; a frame whose distance `1 -
//! |projection on the plane|` is below a threshold joins; the plane that at least three join and
//! with the smallest total distance wins.
//!
//! Known weaknesses, kept: a run must be free of outliers; a slow spin leaves the plane
//! undetermined; any rotation about nearly the correct axis counts as an inlier, however wrong its
//! angle; unwrapping is by rules of thumb.

use nalgebra::{Matrix4, Vector4};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::motion::ConstantSpin;
use super::repeated::Merged;
use super::robust::SpinConfig;
use super::{Fit, Measurement, SpinRejection, check, require};
use crate::geometry::{Rotation, Vec3};

/// Settings, by default those of the authors' published code.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuateraConfig {
    /// Frames in a run.
    pub run: usize,
    /// Runs tried; if there are no more than that, each is tried once.
    pub iterations: usize,
    /// Largest distance from the plane, `1 - |projection|`, dimensionless.
    pub threshold: f64,
    /// Frames outside the run that must join.
    pub joining: usize,
    /// Largest spin that unwrapping may yield, revolutions per second.
    pub max_rps: f64,
    /// Seed for the choice of runs in long sequences.
    pub seed: u64,
}

impl Default for QuateraConfig {
    fn default() -> Self {
        Self {
            run: 4,
            iterations: 30,
            threshold: 0.05,
            joining: 3,
            max_rps: 175.0,
            seed: 0,
        }
    }
}

impl QuateraConfig {
    /// Checks the domains of all settings.
    ///
    /// # Errors
    /// [`SpinRejection::Setting`] naming the first that is outside.
    pub fn check(&self) -> Result<(), SpinRejection> {
        // One quaternion lies in many planes, and one angle on many lines.
        let run = self.run as f64;
        require(self.run >= 2, "run", "2 or more", run)?;
        let iterations = self.iterations as f64;
        require(self.iterations > 0, "iterations", "1 or more", iterations)?;
        let threshold = self.threshold;
        require(threshold > 0.0, "threshold", "a positive number", threshold)?;
        let rps = self.max_rps;
        let inside = rps > 0.0 && rps.is_finite();
        require(inside, "max_rps", "a positive number", rps)
    }
}

/// A coefficient of determination below this makes unwrapping try the other direction (authors').
const GOOD_SCORE: f64 = 0.95;
/// Rate (rad/s) over which the tolerance of the second unwrapping pass falls off (authors').
const TOLERANCE_RATE: f64 = 300.0;
/// The tolerance's value at high rates, as a fraction of the mean rate (authors').
const MIN_TOLERANCE: f64 = 0.5;
/// Turns added to one frame at most: beyond any that a permitted spin can need.
const MAX_TURNS: usize = 8;

/// The baseline estimator with its working memory.
#[derive(Debug, Clone)]
pub struct QuateraEstimator {
    config: QuateraConfig,
    quaternions: Vec<Vector4<f64>>,
    members: Vec<bool>,
    best: Vec<bool>,
    times: Vec<f64>,
    raw: Vec<f64>,
    angles: Vec<f64>,
    rates: Vec<f64>,
    sorted: Vec<f64>,
}

/// A plane through the origin of R^4.
#[derive(Debug, Clone, Copy)]
struct QuaternionPlane {
    u1: Vector4<f64>,
    u2: Vector4<f64>,
}

impl QuaternionPlane {
    /// The two leading eigenvectors of `sum q q^T` over the members.
    fn through<'a>(quaternions: impl Iterator<Item = &'a Vector4<f64>>) -> Self {
        let scatter = quaternions.fold(Matrix4::zeros(), |z, q| z + q * q.transpose());
        let eigen = scatter.symmetric_eigen();
        let mut order = [0, 1, 2, 3];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        Self {
            u1: eigen.eigenvectors.column(order[0]).into_owned(),
            u2: eigen.eigenvectors.column(order[1]).into_owned(),
        }
    }

    fn distance(&self, q: &Vector4<f64>) -> f64 {
        1.0 - q.dot(&self.u1).hypot(q.dot(&self.u2))
    }

    /// The angle turned since u1, in (-pi, pi]: a quaternion and its negative have the same.
    fn angle(&self, q: &Vector4<f64>) -> f64 {
        fold(2.0 * q.dot(&self.u2).atan2(q.dot(&self.u1)))
    }

    /// Axis of the rotation that takes u1 to u2; nalgebra's coordinate order is x, y, z, w.
    fn axis(&self) -> Vec3 {
        let (a, b) = (quaternion(&self.u1), quaternion(&self.u2));
        (b * a.conjugate()).imag().normalize()
    }
}

/// The angle less whole turns, in [-pi, pi].
fn fold(angle: f64) -> f64 {
    use std::f64::consts::TAU;
    angle - TAU * (angle / TAU).round()
}

fn quaternion(v: &Vector4<f64>) -> nalgebra::Quaternion<f64> {
    nalgebra::Quaternion::from_vector(*v)
}

/// A straight line through angles over time.
#[derive(Debug, Clone, Copy)]
struct StraightLine {
    rate: f64,
    /// Angle at the first time.
    start: f64,
    /// Coefficient of determination.
    score: f64,
}

impl QuateraEstimator {
    /// An estimator with these settings.
    pub fn new(config: QuateraConfig) -> Self {
        Self {
            config,
            quaternions: Vec::new(),
            members: Vec::new(),
            best: Vec::new(),
            times: Vec::new(),
            raw: Vec::new(),
            angles: Vec::new(),
            rates: Vec::new(),
            sorted: Vec::new(),
        }
    }

    /// For each measurement of the last successful fit, whether it is an inlier.
    pub fn inliers(&self) -> &[bool] {
        &self.best
    }

    /// The spin of a sequence.
    ///
    /// # Errors
    /// A [`SpinRejection`] where the settings or the measurements are invalid, or the measurements
    /// are too few (a run and three more), or where RANSAC finds no plane, or unwrapping no
    /// permitted spin.
    pub fn fit(&mut self, measurements: &[Measurement]) -> Result<Fit, SpinRejection> {
        self.config.check()?;
        let needed = self.config.run.saturating_add(self.config.joining);
        check(measurements, needed)?;
        let merged = Merged::of(measurements, SpinConfig::default().sigma_rad);
        let found = self.fit_merged(&merged.measurements);
        if merged.is_changed() {
            self.best = merged.spread(&self.best);
        }
        found
    }

    /// As [`Self::fit`], of measurements whose times all differ.
    fn fit_merged(&mut self, measurements: &[Measurement]) -> Result<Fit, SpinRejection> {
        self.quaternions.clear();
        self.quaternions
            .extend(measurements.iter().map(|m| m.orientation.coords));
        let max_rps = self.config.max_rps;
        let rejection = |agreeing| SpinRejection::NoConsensus {
            agreeing,
            frames: measurements.len(),
            max_rps,
        };
        let none = rejection(0);
        let Some(plane) = self.ransac() else {
            return Err(none);
        };
        let inliers = self.best.iter().filter(|m| **m).count();
        let unwrapped = rejection(inliers);
        self.times.clear();
        self.raw.clear();
        for ((m, q), member) in measurements.iter().zip(&self.quaternions).zip(&self.best) {
            if *member {
                self.times.push(m.time_s);
                self.raw.push(plane.angle(q));
            }
        }
        let line = self.regress().ok_or(unwrapped)?;
        let axis = plane.axis();
        let time_s = self.times[0];
        let start = Rotation::from_scaled_axis(axis * line.start);
        let u1 = Rotation::new_normalize(quaternion(&plane.u1));
        Ok(Fit {
            motion: ConstantSpin {
                time_s,
                orientation: start * u1,
                spin: axis * line.rate,
            },
            spin_covariance: None,
            sigma_rad: None,
            log_likelihood: None,
            inliers,
            lack_of_fit: None,
        })
    }

    /// The best plane; its members are left in `self.best`.
    fn ransac(&mut self) -> Option<QuaternionPlane> {
        let starts = self.quaternions.len() - self.config.run + 1;
        let mut rng = ChaCha8Rng::seed_from_u64(self.config.seed);
        let mut best: Option<(f64, QuaternionPlane)> = None;
        for i in 0..self.config.iterations.min(starts) {
            let exhaustive = starts <= self.config.iterations;
            let start = if exhaustive {
                i
            } else {
                rng.random_range(0..starts)
            };
            let run = start..start + self.config.run;
            let plane = QuaternionPlane::through(self.quaternions[run.clone()].iter());
            self.members.clear();
            let mut joined = 0;
            for (k, q) in self.quaternions.iter().enumerate() {
                let joins = !run.contains(&k) && plane.distance(q) < self.config.threshold;
                joined += usize::from(joins);
                self.members.push(joins || run.contains(&k));
            }
            if joined < self.config.joining {
                continue;
            }
            let chosen = || self.quaternions.iter().zip(&self.members).filter(|x| *x.1);
            let plane = QuaternionPlane::through(chosen().map(|x| x.0));
            let total: f64 = chosen().map(|x| plane.distance(x.0)).sum();
            if best.is_none_or(|(smallest, _)| total < smallest) {
                best = Some((total, plane));
                self.best.clone_from(&self.members);
            }
        }
        best.map(|(_, plane)| plane)
    }

    /// Unwraps in the likelier direction, in the other too where the line is poor.
    fn regress(&mut self) -> Option<StraightLine> {
        let limit = self.config.max_rps * std::f64::consts::TAU;
        self.sorted.clear();
        self.sorted
            .extend(self.raw.windows(2).map(|w| fold(w[1] - w[0])));
        let direction = if median(&mut self.sorted) > 0.0 {
            1.0
        } else {
            -1.0
        };
        let permitted = |l: &StraightLine| l.rate.abs() <= limit;
        let likelier = Some(self.unwrap(direction)).filter(permitted);
        if likelier.is_some_and(|l| l.score >= GOOD_SCORE) {
            return likelier;
        }
        let other = Some(self.unwrap(-direction)).filter(permitted);
        match (likelier, other) {
            (Some(a), Some(b)) => Some(if b.score >= a.score { b } else { a }),
            (a, b) => a.or(b),
        }
    }

    /// Adds whole turns so that the angles run in one direction at an even rate.
    fn unwrap(&mut self, direction: f64) -> StraightLine {
        use std::f64::consts::TAU;
        self.angles.clear();
        let mut turns = 0.0;
        for (k, &raw) in self.raw.iter().enumerate() {
            let mut angle = raw + turns;
            if k > 0 {
                for _ in 0..MAX_TURNS {
                    if direction * (angle - self.angles[k - 1]) >= 0.0 {
                        break;
                    }
                    turns += direction * TAU;
                    angle += direction * TAU;
                }
            }
            self.angles.push(angle);
        }
        self.rates.clear();
        for k in 1..self.angles.len() {
            let rise = direction * (self.angles[k] - self.angles[k - 1]);
            self.rates.push(rise / (self.times[k] - self.times[k - 1]));
        }
        self.sorted.clone_from(&self.rates);
        let mean = interquartile_mean(&mut self.sorted);
        let tolerance = MIN_TOLERANCE + (-mean / TOLERANCE_RATE).exp();
        let mut shift = 0.0;
        for k in 1..self.angles.len() {
            if self.rates[k - 1] < (1.0 - tolerance) * mean {
                shift += direction * TAU;
            } else if self.rates[k - 1] > (1.0 + tolerance) * mean {
                shift -= direction * TAU;
            }
            self.angles[k] += shift;
        }
        line(&self.times, &self.angles)
    }
}

/// Least-squares line.
fn line(times: &[f64], angles: &[f64]) -> StraightLine {
    let n = times.len() as f64;
    let mean_t = times.iter().sum::<f64>() / n;
    let mean_a = angles.iter().sum::<f64>() / n;
    let (mut tt, mut ta, mut aa) = (0.0, 0.0, 0.0);
    for (t, a) in times.iter().zip(angles) {
        tt += (t - mean_t).powi(2);
        ta += (t - mean_t) * (a - mean_a);
        aa += (a - mean_a).powi(2);
    }
    let rate = ta / tt;
    StraightLine {
        rate,
        start: mean_a + rate * (times[0] - mean_t),
        score: if aa > 0.0 { ta * ta / (tt * aa) } else { 1.0 },
    }
}

fn median(values: &mut [f64]) -> f64 {
    quantile(values, 0.5)
}

/// Quantile with linear interpolation between order statistics; sorts its argument.
fn quantile(values: &mut [f64], p: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let x = p * (values.len() - 1) as f64;
    let (low, high) = (x.floor() as usize, x.ceil() as usize);
    values[low] + (values[high] - values[low]) * (x - x.floor())
}

/// Mean of the values between the quartiles, both included.
fn interquartile_mean(values: &mut [f64]) -> f64 {
    let (low, high) = (quantile(values, 0.25), quantile(values, 0.75));
    let (mut sum, mut count) = (0.0, 0.0);
    for v in values.iter().filter(|v| **v >= low && **v <= high) {
        sum += v;
        count += 1.0;
    }
    if count > 0.0 {
        sum / count
    } else {
        0.5 * (low + high)
    }
}
