//! The mixture fit: the maximum likelihood of a [`Motion`] where some of the orientations are wrong.
//!
//! A measurement's error `e` at the reference time (see [`super::motion`]) is `N(0, sigma^2 s^2 I)` with the
//! probability that the measurement is an inlier, else its orientation is uniform on SO(3), whose volume
//! is `8 pi^2` in rotation vectors near the identity. Four things are apart: the motion says how
//! errors depend on its parameters, [`posterior`] weighs them, [`WeightedNormal`](normal::WeightedNormal) solves for a step, and
//! [`Mixture`] decides on steps.
//!
//! [`Mixture::grow`] leads from what a few frames say to the whole sequence: frames are used from there
//! outwards, as far as their prediction is good enough, its variance added to the noise. [`Mixture::settle`]
//! climbs to the likelihood's maximum by expectation-maximization: Gauss-Newton steps of the motion, and the
//! noise from the weighted residuals. A step that lowers the likelihood is damped until it raises it (D.
//! W. Marquardt, "An algorithm for least-squares estimation of nonlinear parameters", J. SIAM 11, 1963).
//!
//! The cost of a step is linear in the frames. Every frame's errors are as far from the reference
//! orientation as from the others, so that the orientation is eliminated like an intercept, and a
//! step costs a system of as many equations as the motion has rates.
//!
//! Guaranteed: what [`Mixture::settle`] returns has converged, to a ten-thousandth of a standard deviation (of
//! a million frames to what rounding leaves of their likelihood, some thousandths).
//! Not guaranteed: that the maximum is the global one; that is the matter of the starts.

mod noise;
mod normal;

use std::ops::Range;

use nalgebra::{Matrix3, SMatrix};

use super::Measurement;
use super::motion::Motion;
use crate::geometry::Vec3;
use noise::posterior;
pub(super) use noise::{
    MAX_GAINFUL_VARIANCE, NoiseVariance, ROTATION_VOLUME, inlier_probability,
    ln_likelihood_of_outliers, peak_gain, trusted,
};
pub(super) use normal::{Blocks, RatePrior, RateSpread, WeightedNormal};

/// Steps while a fit grows from its first frames to the whole sequence.
const GROWTH_STEPS: usize = 40;
/// A step takes in at most so many times the frames of the one before, to either side, and more than
/// before only after a step shorter than this many standard deviations, squared.
const GROWTH: usize = 8;
const STEADY: f64 = 10.0;
/// Degrees of freedom by which the noise is better known while a fit grows: some twenty frames may not widen
/// it, many must.
const GROWTH_DEGREES: f64 = 60.0;
/// A fit has grown where the next step is shorter than this many standard deviations, squared.
const GROWN: f64 = 1.0;
/// Steps of a climb, the rejected ones included; a good start needs five, one in a thousand more than thirty.
const MAX_STEPS: usize = 60;
/// Steps after which a slow climb takes longer ones, at most so many times as long.
const FIRST_STEPS: usize = 6;
const MAX_FACTOR: f64 = 8.0;
/// A climb ends where the next step's square length, in standard deviations, is below this ...
const CONVERGED: f64 = 1e-8;
/// ... and the noise changes by less than this fraction.
const NOISE_CONVERGED: f64 = 1e-4;
/// Damping (a share of the information's diagonal) after the first rejected step, and when it gives up.
const FIRST_DAMPING: f64 = 1e-3;
const LAST_DAMPING: f64 = 1e10;
/// A change of the objective by less than this fraction is rounding.
const ROUNDING: f64 = 1e-12;
/// From so many frames on a motion must explain at least this share of the expected inliers while it is
/// fitted: else it does not hold, and its steps would only cost time.
const MANY_FRAMES: usize = 256;
const MIN_SUPPORT: f64 = 0.25;
/// A climb may take so many steps with less.
const PATIENCE: usize = 5;

/// A logarithm of a product whose factors are summed up in few logarithms.
#[derive(Debug, Clone, Copy)]
struct LnProduct {
    ln: f64,
    product: f64,
}

impl LnProduct {
    const ONE: Self = Self {
        ln: 0.0,
        product: 1.0,
    };

    /// Multiplies by a factor between 1e-100 and 1e100.
    fn multiply(&mut self, factor: f64) {
        self.product *= factor;
        if !(1e-100..1e100).contains(&self.product) {
            self.ln += self.product.ln();
            self.product = 1.0;
        }
    }

    fn ln(&self) -> f64 {
        self.ln + self.product.ln()
    }
}

/// Everything that one pass over the measurements yields.
#[derive(Debug, Clone, Copy)]
struct MixturePass<const P: usize> {
    normal: WeightedNormal<P>,
    support: f64,
    expected: f64,
    squares: f64,
    inliers: usize,
    log_likelihood: f64,
    log_posterior: f64,
    objective: f64,
}

impl<const P: usize> MixturePass<P> {
    fn settled<M>(&self, motion: M, sigma_rad: f64, degrees: f64) -> SettledMotion<M> {
        SettledMotion {
            motion,
            sigma_rad,
            degrees,
            support: self.support,
            inliers: self.inliers,
            log_likelihood: self.log_likelihood,
            log_posterior: self.log_posterior,
            objective: self.objective,
        }
    }
}

/// Steps that shrink by the ratio r each lead 1 / (1 - r) times as far.
fn lead(ratio: f64) -> f64 {
    if ratio < 1.0 {
        (1.0 - ratio).recip().min(MAX_FACTOR)
    } else {
        1.0
    }
}

/// The frames that a growing fit has reached.
struct Reached<const P: usize> {
    normal: WeightedNormal<P>,
    frames: usize,
    support: f64,
    expected: f64,
    /// Squared errors over their variances.
    squares: f64,
}

impl<const P: usize> Reached<P> {
    fn new() -> Self {
        Self {
            normal: WeightedNormal::new(),
            frames: 0,
            support: 0.0,
            expected: 0.0,
            squares: 0.0,
        }
    }

    /// Takes in a frame if its prediction is good enough, and says so.
    fn take(
        &mut self,
        m: &Measurement,
        error: &Vec3,
        jacobian: &SMatrix<f64, 3, P>,
        spread: &RateSpread<P>,
        sigma_rad: f64,
    ) -> bool {
        let extra = spread.variance(jacobian);
        if !RateSpread::<P>::is_good(extra) {
            return false;
        }
        let own = (sigma_rad * m.sigma_scale).powi(2);
        let square = error.norm_squared();
        let (inlier, _) = posterior(m.confidence, square, own + extra);
        self.normal.add(inlier / own, error, jacobian);
        self.squares += inlier * square / (own + extra);
        self.frames += 1;
        self.support += inlier;
        self.expected += m.confidence;
        true
    }
}

/// A motion at a maximum of the likelihood.
#[derive(Debug, Clone, Copy)]
pub(super) struct SettledMotion<M> {
    pub motion: M,
    /// Noise per axis, radians.
    pub sigma_rad: f64,
    /// Degrees of freedom of the noise; infinite where it was known.
    pub degrees: f64,
    /// Sum of the probabilities that the frames are inliers.
    pub support: f64,
    /// Frames that are rather inliers than not.
    pub inliers: usize,
    /// Log-likelihood, density with respect to the rotation vectors.
    pub log_likelihood: f64,
    /// The same with the priors of the rates, up to a constant.
    pub log_posterior: f64,
    /// The same with the prior of the noise, by which maxima are compared.
    pub objective: f64,
}

/// A climb that led to no maximum.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unsettled {
    /// As that of [`SettledMotion`], where the climb ended: the maximum is no lower.
    pub log_posterior: f64,
}

/// Measurements, and what is known of the noise and the rates beforehand.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mixture<'a, const P: usize> {
    pub measurements: &'a [Measurement],
    pub noise: NoiseVariance,
    pub prior: RatePrior<P>,
}

impl<const P: usize> Mixture<'_, P> {
    /// Parameters of a motion: its orientation and its rates.
    const PARAMETERS: usize = P + 3;

    /// Takes in frame after frame, outwards from the middle of the frames `known`, of which the motion and its
    /// `spread` come. `None` where the frames leave the rates undetermined, or where the motion does not
    /// hold beyond some of them.
    pub fn grow<M: Motion<P>>(
        &self,
        motion: M,
        known: Range<usize>,
        spread: RateSpread<P>,
    ) -> Option<M> {
        let (before, after) = self.measurements.split_at(known.start + known.len() / 2);
        let (mut motion, mut spread) = (motion, spread);
        let mut sigma_rad = self.noise.sigma_rad;
        let (mut limit, mut is_doubtful) = (GROWTH * known.len(), false);
        for _ in 0..GROWTH_STEPS {
            let jacobian = motion.jacobian();
            let mut reached = Reached::new();
            let mut take = |m: &&Measurement| {
                let (error, jacobian) = jacobian(m);
                reached.take(m, &error, &jacobian, &spread, sigma_rad)
            };
            let later = after.iter().take(limit).take_while(&mut take).count();
            let earlier = before
                .iter()
                .rev()
                .take(limit)
                .take_while(&mut take)
                .count();
            // Parameters that are still poor may lose frames once.
            let many = reached.frames >= MANY_FRAMES;
            let is_lost = many && reached.support < MIN_SUPPORT * reached.expected;
            if is_lost && is_doubtful {
                return None;
            }
            is_doubtful = is_lost;
            let step = reached.normal.step(&motion.rates(), &self.prior, 0.0)?;
            if step.length < STEADY {
                limit = GROWTH * reached.frames;
            }
            // More noise than expected makes predictions worse than expected.
            let squares = reached.squares * sigma_rad * sigma_rad;
            let growing = NoiseVariance {
                degrees: self.noise.degrees + GROWTH_DEGREES,
                ..self.noise
            };
            let (noise, _) = growing.updated(reached.support, squares, Self::PARAMETERS);
            let noise = noise.max(self.noise.sigma_rad);
            spread = step.spread(&reached.normal, (noise / sigma_rad).powi(2));
            sigma_rad = noise;
            let is_next_good = |m: Option<&Measurement>| {
                m.is_some_and(|m| RateSpread::<P>::is_good(spread.variance(&jacobian(m).1)))
            };
            let grows =
                is_next_good(after.get(later)) || is_next_good(before.iter().rev().nth(earlier));
            let is_short = step.length < GROWN;
            motion = motion.retract(&step.turn, &step.rates);
            if is_short && !grows {
                break;
            }
        }
        Some(motion)
    }

    /// Climbs to a maximum of the likelihood and estimates the noise; [`Unsettled`] where it does not
    /// converge, or the maximum is flat, or the motion does not hold over many frames.
    pub fn settle<M: Motion<P>>(&self, start: M) -> Result<SettledMotion<M>, Unsettled> {
        self.settle_within(start, MAX_STEPS)
    }

    /// As [`Mixture::settle`], in at most so many steps.
    pub fn settle_within<M: Motion<P>>(
        &self,
        start: M,
        max_steps: usize,
    ) -> Result<SettledMotion<M>, Unsettled> {
        let (mut motion, mut sigma_rad) = (start, self.noise.sigma_rad);
        let mut pass = self.pass(&motion, sigma_rad);
        let (mut damping, mut last_length) = (0.0, f64::INFINITY);
        for taken in 0..max_steps {
            let many = taken >= PATIENCE && self.measurements.len() >= MANY_FRAMES;
            if many && pass.support < MIN_SUPPORT * pass.expected {
                break;
            }
            let (next_sigma, degrees) =
                self.noise
                    .updated(pass.support, pass.squares, Self::PARAMETERS);
            let rates = motion.rates();
            let Some(step) = pass.normal.step(&rates, &self.prior, 0.0) else {
                break;
            };
            let is_noise_settled = (next_sigma / sigma_rad - 1.0).abs() < NOISE_CONVERGED;
            // Of millions of frames the objective does not show a shorter step.
            let converged = CONVERGED.max(ROUNDING * pass.objective.abs());
            if step.length < converged && is_noise_settled {
                return Ok(pass.settled(motion, sigma_rad, degrees));
            }
            let damped = match damping {
                0.0 => Some(step),
                _ => pass.normal.step(&rates, &self.prior, damping),
            };
            let Some(step) = damped else {
                break;
            };
            let ratio = (step.length / last_length).sqrt();
            let is_steady = taken >= FIRST_STEPS && damping == 0.0;
            let factor = if is_steady { lead(ratio) } else { 1.0 };
            last_length = step.length;
            let next = motion.retract(&(step.turn * factor), &(step.rates * factor));
            let next_sigma = sigma_rad * (next_sigma / sigma_rad).powf(factor);
            let next_sigma = self.noise.limited(next_sigma);
            let reached = self.pass(&next, next_sigma);
            if reached.objective >= pass.objective - ROUNDING * pass.objective.abs() {
                (motion, sigma_rad, pass) = (next, next_sigma, reached);
                damping = if damping > FIRST_DAMPING {
                    0.1 * damping
                } else {
                    0.0
                };
            } else if damping > LAST_DAMPING {
                break;
            } else {
                damping = (10.0 * damping).max(FIRST_DAMPING);
            }
        }
        Err(Unsettled {
            log_posterior: pass.log_posterior,
        })
    }

    /// The log-posterior at the maximum that a start leads to, or as far as it gets.
    pub fn ln_maximum<M: Motion<P>>(&self, start: M) -> f64 {
        self.settle(start)
            .map_or_else(|u| u.log_posterior, |s| s.log_posterior)
    }

    /// One pass over the measurements.
    fn pass<M: Motion<P>>(&self, motion: &M, sigma_rad: f64) -> MixturePass<P> {
        let mut normal = WeightedNormal::new();
        let (mut support, mut expected, mut squares, mut inliers) = (0.0, 0.0, 0.0, 0);
        let mut likelihood = LnProduct::ONE;
        let jacobian = motion.jacobian();
        for m in self.measurements {
            let (error, jacobian) = jacobian(m);
            let square = error.norm_squared();
            let scale = m.sigma_scale * m.sigma_scale;
            let variance = sigma_rad * sigma_rad * scale;
            let (inlier, density) = posterior(m.confidence, square, variance);
            normal.add(inlier / variance, &error, &jacobian);
            likelihood.multiply(density);
            support += inlier;
            expected += m.confidence;
            squares += inlier * square / scale;
            inliers += usize::from(inlier > 0.5);
        }
        let log_likelihood = likelihood.ln();
        let log_posterior = log_likelihood + self.prior.pull(&motion.rates()).0;
        MixturePass {
            normal,
            support,
            expected,
            squares,
            inliers,
            log_likelihood,
            log_posterior,
            objective: log_posterior + self.noise.ln_prior(sigma_rad, Self::PARAMETERS),
        }
    }

    /// How far a maximum's predictions are off.
    pub fn spread<M: Motion<P>>(&self, at: &SettledMotion<M>) -> Option<RateSpread<P>> {
        let normal = self.pass(&at.motion, at.sigma_rad).normal;
        let step = normal.step(&at.motion.rates(), &self.prior, 0.0)?;
        Some(step.spread(&normal, 1.0))
    }

    /// For each frame the probability that it is an inlier.
    pub fn probabilities<M: Motion<P>>(&self, at: &SettledMotion<M>) -> Vec<f64> {
        let jacobian = at.motion.jacobian();
        let probability = |m: &Measurement| {
            let variance = (at.sigma_rad * m.sigma_scale).powi(2);
            inlier_probability(m.confidence, jacobian(m).0.norm_squared(), variance)
        };
        self.measurements.iter().map(probability).collect()
    }

    /// The covariance of a maximum's parameters, and for each frame the probability that it is an inlier:
    /// the inverse of the observed information, which is less than that of a step by what uncertain
    /// membership costs (T. A. Louis, "Finding the observed information matrix when using the EM algorithm",
    /// J. R. Stat. Soc. B 44, 1982, eq. 3.1), widened where the noise was estimated. `None` where that is not positive
    /// definite; with `is_membership_known` nothing is subtracted.
    pub fn covariance<M: Motion<P>>(
        &self,
        at: &SettledMotion<M>,
        is_membership_known: bool,
        mut probability: impl FnMut(f64),
    ) -> Option<Blocks<P>> {
        let mut information = Blocks {
            turn: Matrix3::zeros(),
            both: SMatrix::zeros(),
            rates: SMatrix::from_diagonal(&self.prior.weight),
        };
        let jacobian = at.motion.jacobian();
        for m in self.measurements {
            let (error, jacobian) = jacobian(m);
            let variance = (at.sigma_rad * m.sigma_scale).powi(2);
            let (inlier, _) = posterior(m.confidence, error.norm_squared(), variance);
            probability(inlier);
            let missing = match is_membership_known {
                true => 0.0,
                false => inlier * (1.0 - inlier) / variance,
            };
            // What a frame says of its three errors.
            let own = (Matrix3::from_diagonal_element(inlier)
                - error * error.transpose() * missing)
                / variance;
            let weighted = own * jacobian;
            information.turn += own;
            information.both += weighted;
            information.rates += jacobian.tr_mul(&weighted);
        }
        // Student's distribution with d degrees of freedom has the variance d / (d - 2).
        let widening = match at.degrees {
            d if d.is_finite() => d / (d - 2.0).max(1.0),
            _ => 1.0,
        };
        Some(information.inverse()?.scaled(widening))
    }
}

/// Whether these are at least half of the expected inliers.
pub(super) fn is_majority(inliers: usize, measurements: &[Measurement]) -> bool {
    let expected: f64 = measurements.iter().map(|m| m.confidence).sum();
    inliers as f64 >= 0.5 * expected
}

/// From the first measurement to the last, seconds.
pub(super) fn duration(measurements: &[Measurement]) -> f64 {
    match measurements {
        [first, .., last] => last.time_s - first.time_s,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spin::MIN_FRAMES;
    use crate::spin::motion::ConstantSpin;
    use crate::spin::simulate::Scenario;

    /// Step of the differences, in standard deviations.
    const SHIFT: f64 = 0.01;
    /// Slope of the objective at a maximum, per standard deviation.
    const FLAT: f64 = 1e-3;

    #[test]
    fn what_has_not_converged_is_no_fit() {
        let noise = NoiseVariance {
            sigma_rad: 0.035,
            degrees: 4.0,
        };
        let (mut settled, mut unsettled) = (0, 0);
        for i in 0..1000 {
            let scenario = Scenario {
                frames: 3 + 20 * (i % 10) as usize,
                outliers: 0.4,
                decay_per_s: 2.0,
                ..Scenario::default()
            };
            let sequence = scenario.sequence((1.0, 170.0), 7, i);
            let mixture = Mixture {
                measurements: &sequence.measurements,
                noise,
                prior: RatePrior::none(),
            };
            // Through the first two frames, whether they are right or wrong.
            let [first, second] = [0, 1].map(|k| sequence.measurements[k]);
            let turn = second.orientation * first.orientation.inverse();
            let start = ConstantSpin {
                time_s: first.time_s,
                orientation: first.orientation,
                spin: turn.scaled_axis() / (second.time_s - first.time_s),
            };
            let Ok(found) = mixture.settle(start) else {
                unsettled += 1;
                continue;
            };
            settled += 1;
            let covariance = mixture.covariance(&found, true, |_| ());
            // A few frames nearly whole turns apart leave a valley that no step of differences follows.
            let Some(covariance) = covariance.filter(|_| found.inliers > MIN_FRAMES) else {
                continue;
            };
            let objective = |turn: Vec3, spin: Vec3| {
                let beside = found.motion.retract(&turn, &spin);
                mixture.pass(&beside, found.sigma_rad).objective
            };
            let slope = |turn: Vec3, spin: Vec3| {
                let [ahead, back] = [SHIFT, -SHIFT].map(|s| objective(turn * s, spin * s));
                (ahead - back) / (2.0 * SHIFT)
            };
            for axis in 0..3 {
                let turn = Vec3::ith(axis, covariance.turn[(axis, axis)].sqrt());
                let spin = Vec3::ith(axis, covariance.rates[(axis, axis)].sqrt());
                for slope in [slope(turn, Vec3::zeros()), slope(Vec3::zeros(), spin)] {
                    assert!(slope.abs() < FLAT, "sequence {i}: {slope} at {found:?}");
                }
            }
        }
        assert!(unsettled > 0 && settled > 900, "{settled} of 1000");
    }
}
