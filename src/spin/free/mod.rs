//! The spin of a ball that is pushed: on a treadmill, by a hand, over the ground.
//!
//! The motion is a smooth one, the spin a path whose change is random (the process and its evidence are in `smoother`), about the simpler motion that
//! is likeliest, the base. How fast it changes is learned: the density `q` of the change has a prior of equal weight for each factor of three of `sqrt(q)`,
//! up to a spin that changes by a tenth of its root mean square from one orientation to the next, and the evidence is the mean
//! over it. A path that may change as much as it likes from frame to frame explains any order and any times of the frames.
//!
//! What a free motion is summed up by is its mean spin over the time, with its covariance, and the spread of the spin about it.
//!
//! # Errors that frames share
//! Errors of drawn dots are alike as long as the ball shows the same side, over `n` frames say. They are taken as noise of `n`
//! times their variance: for what changes slowly it is the same. The turn of a view frame at an unknown rate turns every spin, which is
//! no evidence for a change (see `smoother`).
//!
//! Guaranteed: no free motion without odds of 20 to 1 against its base; most of the orientations follow it, and they speak more for it
//! than for turns about one axis at no particular times or for no motion at all. Not guaranteed: a spin that jumps, as at a bounce.

mod smoother;

use std::f64::consts::TAU;

use nalgebra::Matrix3;

use super::belief::Circle;
use super::fitted::FittedMotion;
use super::mixture::{ROTATION_VOLUME, inlier_probability, is_majority};
use super::motion::{ConstantSpin, LocalFrame};
use super::robust::{SpinConfig, TIE_MARGIN};
use super::shared::{SharedError, shared_covariance};
use super::windows::spin_over_time;
use super::{Fit, Measurement};
use crate::geometry::{Rotation, Vec3, turned_covariance};
use crate::stats::median;
use smoother::{Base, ProcessPrior, SmoothPath, trapezes};

/// Orientations without which there is no free motion: its change is learned from them.
pub const MIN_ORIENTATIONS: usize = 8;
/// Longer sequences are looked at only where the free motion is asked for: some 10 us an orientation.
const SEARCHED: usize = 4096;
/// Most that the spin changes from one orientation to the next, over its root mean square. A third of the frames lost is a
/// change of 0.6, and 0.25 still lets it pass.
const MAX_CHANGE: f64 = 0.1;
/// A motion is smooth where no jump of orientation and spin would raise twice the logarithm of the likelihood by more. Of 160 pushed
/// clips of 10 to 155 orientations the largest had 29.5; with one frame lost, two blocks of frames swapped or half of them reversed 55 to 590.
const MAX_JUMP: f64 = 40.0;
/// Rates of change that are tried, and the factor between the squares of two.
const CHANGES: usize = 6;
const FACTOR: f64 = 9.0;
/// Steps of the smoother for each, and for the last.
const STEPS: usize = 4;
const LAST_STEPS: usize = 10;
/// Orientations of a run in which a path begins where no simpler motion holds.
const RUN: usize = 6;
/// An orientation belongs to its run within so many standard deviations.
const OUTLYING: f64 = 5.0;
/// Below this correlation sides of the ball have nothing in common, and so many places are enough to say how long they do.
const APART: f64 = 0.05;
const PLACES: usize = 16;

/// Orientation and spin at the time of a measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knot {
    /// Seconds.
    pub time_s: f64,
    /// Pattern to camera.
    pub orientation: Rotation,
    /// Camera frame, rad/s.
    pub spin: Vec3,
    /// Its covariance, (rad/s)^2.
    pub spin_covariance: Matrix3<f64>,
}

/// A free motion.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeFit {
    /// The motion at the measurements' times; in between spins are straight lines.
    pub knots: Vec<Knot>,
    /// The mean spin over the time, with its covariance, and the orientation in the middle.
    pub mean: Fit,
    /// Mean square of the spin about its mean, (rad/s)^2: how far it changes over the time.
    pub spread: Matrix3<f64>,
    /// Density of the spin's change, (rad/s)^2 per second: within a time `T` each component changes by `sqrt(change T)`.
    pub change: f64,
    /// Natural logarithm of the odds against the simpler motion that it leaves; against no steady motion where there is none.
    pub ln_bayes_factor: f64,
}

impl FreeFit {
    /// The orientation at `time_s`; before the first measurement and after the last the spin is that there.
    pub fn predict(&self, time_s: f64) -> Rotation {
        let (a, b, share) = self.between(time_s);
        let (Some(b), true) = (b, share > 0.0) else {
            let turn = a.spin * (time_s - a.time_s);
            return Rotation::from_scaled_axis(turn) * a.orientation;
        };
        let dt = b.time_s - a.time_s;
        let part = |share: f64| {
            let turn = (a.spin + (b.spin - a.spin) * (0.5 * share)) * (share * dt);
            Rotation::from_scaled_axis(turn) * a.orientation
        };
        let rest = (b.orientation * part(1.0).inverse()).scaled_axis();
        Rotation::from_scaled_axis(rest * share) * part(share)
    }

    /// The spin at `time_s` with its covariance, and the orientation then.
    pub fn at(&self, time_s: f64) -> Fit {
        let (a, b, share) = self.between(time_s);
        let (spin, covariance) = match b {
            Some(b) => {
                let between = share * (1.0 - share) * (b.time_s - a.time_s);
                // Neighbors agree at least as well as the mean of their covariances says.
                let mixed = a.spin_covariance * (1.0 - share) + b.spin_covariance * share;
                let open = Matrix3::from_diagonal_element(self.change * between);
                (a.spin + (b.spin - a.spin) * share, mixed + open)
            }
            None => {
                let beyond = self.change * (time_s - a.time_s).abs();
                let open = Matrix3::from_diagonal_element(beyond);
                (a.spin, a.spin_covariance + open)
            }
        };
        Fit {
            motion: ConstantSpin {
                time_s,
                orientation: self.predict(time_s),
                spin,
            },
            spin_covariance: Some(covariance),
            ..self.mean
        }
    }

    /// The knot before a time, the one after, and the share of the way between; without the second beyond the ends.
    fn between(&self, time_s: f64) -> (&Knot, Option<&Knot>, f64) {
        let after = self.knots.partition_point(|k| k.time_s <= time_s);
        let before = after.saturating_sub(1);
        match self.knots.get(after).filter(|_| after > 0) {
            Some(b) => {
                let a = &self.knots[before];
                (a, Some(b), (time_s - a.time_s) / (b.time_s - a.time_s))
            }
            None => (&self.knots[before], None, 0.0),
        }
    }

    /// The same in another camera frame, which `turn` leads to.
    #[must_use]
    pub fn turned(mut self, turn: &Rotation) -> Self {
        for knot in &mut self.knots {
            knot.orientation = turn * knot.orientation;
            knot.spin = turn * knot.spin;
            knot.spin_covariance = turned_covariance(turn, &knot.spin_covariance);
        }
        self.mean = self.mean.turned(turn);
        self.spread = turned_covariance(turn, &self.spread);
        self
    }

    /// How much farther right orientations are off the motion along its axis than across it, per axis.
    pub(super) fn along_over_across(&self, measurements: &[Measurement]) -> f64 {
        let (mut along, mut across) = (0.0, 0.0);
        for (m, knot) in measurements.iter().zip(&self.knots) {
            let off = (m.orientation * knot.orientation.inverse()).scaled_axis();
            let variance = self.mean.sigma_rad.unwrap_or_default() * m.sigma_scale;
            let p = inlier_probability(m.confidence, off.norm_squared(), variance * variance);
            let axis = knot.spin.try_normalize(0.0).unwrap_or_default();
            let part = axis.dot(&off).powi(2);
            along += p * part;
            across += 0.5 * p * (off.norm_squared() - part);
        }
        if across > 0.0 {
            (along / across).sqrt()
        } else {
            1.0
        }
    }

    /// The slowest spin and the fastest over the time, rad/s.
    pub fn rates_rad_s(&self) -> (f64, f64) {
        let rates = self.knots.iter().map(|k| k.spin.norm());
        rates.fold((f64::INFINITY, 0.0), |(low, high), rate| {
            (rate.min(low), rate.max(high))
        })
    }

    /// Root mean square by which the spin is off its mean, rad/s.
    pub fn spread_rad_s(&self) -> f64 {
        self.spread.trace().max(0.0).sqrt()
    }
}

/// What the measurements say before a path is looked for.
struct Setting<'a> {
    measurements: &'a [Measurement],
    config: &'a SpinConfig,
    base: Base,
    /// Where a path begins.
    start: SmoothPath,
    prior: ProcessPrior,
    /// The largest density of the change.
    most: f64,
}

/// A free motion about a motion that is believed, with odds of 20 to 1 or whatever they are; `None` where the measurements are too
/// few or do not follow one.
pub(super) fn free_about(
    measurements: &[Measurement],
    motion: &FittedMotion,
    config: &SpinConfig,
) -> Option<FreeFit> {
    let n = measurements.len();
    if n < MIN_ORIENTATIONS {
        return None;
    }
    let spins = measurements.iter().map(|m| motion.spin_at(m.time_s));
    let base = Base {
        orientations: measurements
            .iter()
            .map(|m| motion.predict(m.time_s))
            .collect(),
        spins: spins.collect(),
    };
    let sigma_rad = motion
        .at(measurements[0].time_s)
        .sigma_rad
        .unwrap_or(config.sigma_rad);
    let start = SmoothPath::of_base(&base, measurements, sigma_rad);
    let setting = Setting::new(measurements, config, base, start)?;
    let unmoved = setting.settled(0.0, setting.start.clone(), LAST_STEPS)?;
    let mut paths = setting.scanned((0..CHANGES).rev());
    // Which orientations are right, and their noise, may be seen better from there.
    let again = paths.last().map(|(_, slowest)| slowest.clone());
    let again = again.and_then(|path| setting.settled(0.0, path, LAST_STEPS));
    let unmoved = match again {
        Some(again) if again.ln_evidence > unmoved.ln_evidence => again,
        _ => unmoved,
    };
    // Where many do not follow the simpler motion the path may begin in runs.
    let few = (unmoved.inliers() as f64) < FOLLOWED * n as f64;
    if few && let Some(other) = Setting::of_runs(measurements, config) {
        let others = other.scanned(0..CHANGES);
        let best = |paths: &[(f64, SmoothPath)]| {
            let all = paths.iter().map(|(_, p)| p.ln_evidence);
            all.fold(f64::NEG_INFINITY, f64::max)
        };
        if best(&others) > best(&paths) {
            paths = others;
            let ln_bayes_factor = ln_mean(&paths) - unmoved.ln_evidence;
            return other.finished(&paths, ln_bayes_factor);
        }
    }
    let ln_bayes_factor = ln_mean(&paths) - unmoved.ln_evidence;
    setting.finished(&paths, ln_bayes_factor)
}

/// Below this share of orientations that follow a motion a path is also looked for in runs.
const FOLLOWED: f64 = 0.85;

/// A free motion where no steady one holds: it must have more evidence than turns about one axis at no particular times, and than
/// orientations that have nothing to do with each other.
pub(super) fn free_alone(measurements: &[Measurement], config: &SpinConfig) -> Option<FreeFit> {
    let setting = Setting::of_runs(measurements, config)?;
    let paths = setting.scanned(0..CHANGES);
    let nothing = -(measurements.len() as f64) * ROTATION_VOLUME.ln();
    let circle = Circle::searched(measurements, config.noise())?;
    let other = circle.ln_likelihood.max(nothing);
    let found = setting.finished(&paths, ln_mean(&paths) - other)?;
    (found.ln_bayes_factor > TIE_MARGIN).then_some(found)
}

/// Whether a sequence is looked at though nobody asked for its free motion.
pub(super) fn is_searched(measurements: &[Measurement]) -> bool {
    (MIN_ORIENTATIONS..=SEARCHED).contains(&measurements.len())
}

/// The logarithm of the mean evidence over the rates of change that were tried.
fn ln_mean(paths: &[(f64, SmoothPath)]) -> f64 {
    let lns = || paths.iter().map(|(_, path)| path.ln_evidence);
    let top = lns().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = lns().map(|ln| (ln - top).exp()).sum();
    top + (sum / CHANGES as f64).ln()
}

impl<'a> Setting<'a> {
    fn new(
        measurements: &'a [Measurement],
        config: &'a SpinConfig,
        base: Base,
        start: SmoothPath,
    ) -> Option<Self> {
        let weights = trapezes(measurements);
        let spins = base.spins.iter().zip(&start.beside).map(|(b, v)| b + v);
        let square: f64 = weights
            .iter()
            .zip(spins)
            .map(|(w, s)| w * s.norm_squared())
            .sum();
        let steps = measurements.windows(2).map(|w| w[1].time_s - w[0].time_s);
        let step_s = median(&mut steps.collect::<Vec<_>>());
        let shared = config.shared.as_ref();
        let turning = shared.map(SharedError::turn_rate_covariance);
        let turning = turning.filter(|c| c.trace() > 0.0);
        let prior = ProcessPrior {
            change: 0.0,
            spin: config.max_rps * TAU / 3f64.sqrt(),
            // Positive definite, whatever it is.
            turning: turning.map(|c| c + Matrix3::from_diagonal_element(1e-6 * c.trace())),
            shared: shared.map_or(0.0, |s| {
                let alike = frames_alike(&base.orientations, s.correlation_rad);
                s.sigma_rad * s.sigma_rad * (alike - 1.0)
            }),
            noise: config.noise(),
        };
        let most = MAX_CHANGE * MAX_CHANGE * square / step_s;
        (most > 0.0 && most.is_finite()).then_some(Self {
            measurements,
            config,
            base,
            start,
            prior,
            most,
        })
    }

    /// A path through the spins of short runs.
    fn of_runs(measurements: &'a [Measurement], config: &'a SpinConfig) -> Option<Self> {
        if measurements.len() < MIN_ORIENTATIONS {
            return None;
        }
        let alone = SpinConfig {
            shared: None,
            ..*config
        };
        let runs = spin_over_time(measurements, RUN, &alone).ok()?;
        let (first, last) = (runs.first()?, runs.last()?);
        let mean = runs.iter().map(|r| r.fit.motion.spin).sum::<Vec3>() / runs.len() as f64;
        let spin_at = |time_s: f64| {
            let after = runs.partition_point(|r| r.time_s <= time_s);
            let (Some(a), Some(b)) = (runs.get(after.wrapping_sub(1)), runs.get(after)) else {
                let end = if after == 0 { first } else { last };
                return end.fit.motion.spin;
            };
            let share = (time_s - a.time_s) / (b.time_s - a.time_s);
            a.fit.motion.spin * (1.0 - share) + b.fit.motion.spin * share
        };
        let sigmas = runs.iter().filter_map(|r| r.fit.sigma_rad);
        let sigma_rad = median(&mut sigmas.collect::<Vec<_>>());
        let (mut orientations, mut right) = (Vec::new(), Vec::new());
        for m in measurements {
            let near = |r: &&super::windows::WindowFit| (r.time_s - m.time_s).abs();
            let run = runs.iter().min_by(|a, b| near(a).total_cmp(&near(b)))?;
            let expected = run.fit.motion.at(m.time_s);
            let angle = expected.angle_to(&m.orientation);
            let is_near = angle < OUTLYING * sigma_rad * m.sigma_scale;
            orientations.push(if is_near { m.orientation } else { expected });
            right.push(if is_near { m.confidence } else { 0.0 });
        }
        let steady = ConstantSpin {
            time_s: measurements[0].time_s,
            orientation: measurements[0].orientation,
            spin: mean,
        };
        let base = Base {
            orientations: measurements.iter().map(|m| steady.at(m.time_s)).collect(),
            spins: vec![mean; measurements.len()],
        };
        let start = SmoothPath {
            orientations,
            beside: measurements
                .iter()
                .map(|m| spin_at(m.time_s) - mean)
                .collect(),
            right,
            ..SmoothPath::of_base(&base, measurements, sigma_rad)
        };
        Self::new(measurements, config, base, start)
    }

    fn settled(&self, change: f64, start: SmoothPath, steps: usize) -> Option<SmoothPath> {
        let prior = ProcessPrior {
            change,
            ..self.prior
        };
        start.settled(self.measurements, &self.base, &prior, steps)
    }

    /// The paths of all rates of change, each from the one before, in this order; the first is that of the fastest change.
    fn scanned(&self, order: impl Iterator<Item = usize>) -> Vec<(f64, SmoothPath)> {
        let mut paths: Vec<(f64, SmoothPath)> = Vec::with_capacity(CHANGES);
        for k in order {
            let change = self.most * FACTOR.powi(-(k as i32));
            let start = paths.last().map_or(&self.start, |(_, path)| path).clone();
            paths.extend(
                self.settled(change, start, STEPS)
                    .map(|path| (change, path)),
            );
        }
        paths.sort_by(|a, b| b.0.total_cmp(&a.0));
        paths
    }

    /// The likeliest path as a motion.
    fn finished(&self, paths: &[(f64, SmoothPath)], ln_bayes_factor: f64) -> Option<FreeFit> {
        let ln = |k: usize| paths.get(k).map(|(_, path)| path.ln_evidence);
        let evidence = |k: &usize| paths[*k].1.ln_evidence;
        let best = (0..paths.len()).max_by(|a, b| evidence(a).total_cmp(&evidence(b)))?;
        // The top of the parabola through three.
        let top = match (ln(best.wrapping_sub(1)), ln(best), ln(best + 1)) {
            (Some(a), Some(b), Some(c)) if a + c - 2.0 * b < 0.0 => {
                (0.5 * (a - c) / (a + c - 2.0 * b)).clamp(-0.5, 0.5)
            }
            _ => 0.0,
        };
        let (change, start) = &paths[best];
        let change = (change * FACTOR.powf(-top)).min(self.most);
        let path = self.settled(change, start.clone(), LAST_STEPS)?;
        let spins = self.base.spins.iter().zip(&path.beside);
        let spins: Vec<Vec3> = spins.map(|(b, v)| b + v).collect();
        let is_fast = |spin: &Vec3| spin.norm() > TAU * self.config.max_rps;
        let inliers = path.inliers();
        let follows = is_majority(inliers, self.measurements);
        if path.jump > MAX_JUMP || spins.iter().any(is_fast) || !follows {
            return None;
        }
        let weights = trapezes(self.measurements);
        let weighted = || weights.iter().zip(&spins);
        let mean: Vec3 = weighted().map(|(w, s)| s * *w).sum();
        let spread = weighted()
            .map(|(w, s)| (s - mean) * (s - mean).transpose() * *w)
            .sum();
        let common = self.common(&mean, &path);
        let knots = self.measurements.iter().enumerate().map(|(k, m)| Knot {
            time_s: m.time_s,
            orientation: path.orientations[k],
            spin: spins[k],
            spin_covariance: path.variances[k][1] + common,
        });
        let knots: Vec<Knot> = knots.collect();
        let middle_s = 0.5 * (knots[0].time_s + knots[knots.len() - 1].time_s);
        let mut found = FreeFit {
            knots,
            mean: Fit {
                motion: ConstantSpin {
                    time_s: middle_s,
                    orientation: path.orientations[0],
                    spin: mean,
                },
                spin_covariance: Some(path.mean + common),
                sigma_rad: Some(path.sigma_rad),
                log_likelihood: Some(path.ln_evidence),
                inliers,
                lack_of_fit: None,
            },
            spread,
            change,
            ln_bayes_factor,
        };
        found.mean.motion.orientation = found.predict(middle_s);
        Some(found)
    }

    /// The covariance of an error of all spins alike: the frame's turn, the clock's rate, and where the ball turns fast what its drawn dots
    /// tilt the axis by.
    fn common(&self, mean: &Vec3, path: &SmoothPath) -> Matrix3<f64> {
        let off = mean * self.config.clock_rate_std;
        let clock = off * off.transpose();
        let Some(shared) = &self.config.shared else {
            return clock;
        };
        let steady = ConstantSpin {
            time_s: self.measurements[0].time_s,
            orientation: path.orientations[0],
            spin: *mean,
        };
        let tilt = shared_covariance(
            self.measurements,
            &steady,
            path.sigma_rad,
            &path.right,
            (shared, &Vec3::zeros()),
            &mut Vec::new(),
        );
        let basis = LocalFrame::of(mean).basis;
        let tilt = tilt.map(|c| basis * c * basis.transpose());
        let tilt = tilt.filter(|c| c.trace() > path.mean.trace());
        clock + shared.of_spin(mean) + tilt.unwrap_or_default()
    }
}

/// Frames over which the side that the ball shows is the same, as a sum of correlations.
fn frames_alike(orientations: &[Rotation], correlation_rad: f64) -> f64 {
    let sides: Vec<Vec3> = orientations
        .iter()
        .map(|r| r.inverse() * Vec3::z())
        .collect();
    let n = sides.len();
    let alike = |k: usize| {
        let correlation = |other: &Vec3| {
            let angle = sides[k].dot(other).clamp(-1.0, 1.0).acos();
            (-0.5 * (angle / correlation_rad).powi(2)).exp()
        };
        let near = |c: &f64| *c > APART;
        let later: f64 = sides[k + 1..]
            .iter()
            .map(correlation)
            .take_while(near)
            .sum();
        let earlier: f64 = sides[..k]
            .iter()
            .rev()
            .map(correlation)
            .take_while(near)
            .sum();
        1.0 + later + earlier
    };
    let stride = n.div_ceil(PLACES);
    let places = (0..n).step_by(stride);
    let count = places.clone().count() as f64;
    places.map(alike).sum::<f64>() / count
}
