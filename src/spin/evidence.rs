//! A motion beyond a constant spin, where there is evidence for it.
//!
//! The fit takes a richer motion, [`DecayingSpin`](super::motion::DecayingSpin) or
//! [`PrecessingSpin`](super::motion::PrecessingSpin), and compares it with the motion that it contains. The odds are
//! by Laplace's method those of the likelihoods at one noise, times the share of the prior's range that the
//! measurements leave to the rates beyond (R. E. Kass, A. E. Raftery, "Bayes factors", J. Am. Stat. Assoc. 90,
//! 1995, eq. 5). Odds of 20 to 1 or more are evidence; with less the answer is the constant spin. Errors that are not independent
//! (`widening.rs`) weigh less: the logarithm of the likelihoods' ratio, a square of the rates over their covariance, is
//! taken with the wider one.
//!
//! # Starts
//! Over a long sequence a wrong rate loses full turns. The fit starts from the constant spin of
//! [`super::robust`], and from the spins of short runs, from which it grows over the sequence (see
//! `spin::mixture`). Of sequences longer than 512 orientations a section is fitted so, and the best
//! few motions grow from there: the cost is linear in the orientations.
//!
//! Guaranteed: no richer motion without evidence; most of the frames agree, and more than chance
//! explains (`spin::chance`, with the motions that can be distinguished as further hypotheses); no spin faster than
//! permitted at either end. Not guaranteed: that no other motion explains the orientations better.

use super::belief::Belief;
use super::chance::expected_by_chance;
use super::mixture::{
    Blocks, Mixture, RatePrior, RateSpread, SettledMotion, duration, is_majority,
};
use super::motion::{ConstantSpin, LocalFrame, Motion};
use super::repeated::Merged;
use super::robust::{RobustEstimator, SpinConfig, TIE_MARGIN};
use super::widening::widened;
use super::{Fit, MIN_FRAMES, Measurement, SpinRejection, check};
use crate::concurrency;
use nalgebra::{Matrix3, SMatrix};

/// Orientations of which a motion is fitted from every start.
pub(super) const SECTION: usize = 512;
/// Where the sections of a longer sequence lie: shares of what is left beside them. The first from which
/// the motion holds over the sequence is enough.
const PLACES: [f64; 3] = [0.5, 0.15, 0.85];
/// Motions of a section that grow over the sequence.
const GROWING: usize = 3;
/// Motions are the same where their predictions are this near, radians: maxima lie whole turns apart.
const SAME_RAD: f64 = 0.01;
/// Runs from which a fit grows.
const RUNS: usize = 3;
/// Runs tried for each of them, half a run apart, until one has a spin.
const TRIES: usize = 8;

/// A motion fitted to a sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionFit<M, const P: usize> {
    /// The motion; its reference time is that of the first measurement.
    pub motion: M,
    /// Covariance of its parameters.
    pub(super) covariance: Blocks<P>,
    /// Standard deviation of the rates beyond the spin before the fit.
    pub(super) scale: f64,
    /// Noise of an orientation per axis, radians, as assumed or estimated.
    pub sigma_rad: f64,
    /// Log-likelihood of the measurements (density with respect to the rotation vector).
    pub log_likelihood: f64,
    /// Number of inliers.
    pub inliers: usize,
    /// Natural logarithm of the odds for this motion against the simpler one that it contains.
    pub ln_bayes_factor: f64,
    /// As that of [`Fit`].
    pub lack_of_fit: Option<f64>,
}

impl<M, const P: usize> MotionFit<M, P> {
    /// Whether there is evidence for it: odds of 20 to 1 or better.
    pub fn is_evident(&self) -> bool {
        self.ln_bayes_factor > TIE_MARGIN
    }
}

/// The outcome of looking for a motion beyond a constant spin.
// One a sequence: a kilobyte is less trouble than a box.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome<M, const P: usize> {
    /// There is evidence for it.
    Found {
        /// The motion.
        fit: MotionFit<M, P>,
        /// The constant spin that agrees with the most orientations, if any is.
        constant: Option<Fit>,
    },
    /// There is none: a constant spin explains the orientations.
    Constant {
        /// The constant spin.
        fit: Fit,
        /// The motion without evidence; `None` where the orientations do not determine it (a ball that
        /// hardly turns, a short sequence).
        rival: Option<MotionFit<M, P>>,
    },
}

impl<M, const P: usize> Outcome<M, P> {
    /// The motion, if there is evidence for it.
    pub fn found(&self) -> Option<&MotionFit<M, P>> {
        match self {
            Self::Found { fit, .. } => Some(fit),
            Self::Constant { .. } => None,
        }
    }

    /// The motion, with evidence or without, where the orientations determine it.
    pub fn determined(&self) -> Option<&MotionFit<M, P>> {
        match self {
            Self::Found { fit, .. } => Some(fit),
            Self::Constant { rival, .. } => rival.as_ref(),
        }
    }
}

/// A motion that has a constant spin as a special case.
pub(super) trait Richer<const P: usize>: Motion<P> + Send + Sync {
    /// Orientations without which there is no fit.
    fn needed(config: &SpinConfig) -> usize;

    /// A constant spin as such a motion.
    fn of_constant(constant: &ConstantSpin) -> Self;

    /// The motions from which a fit starts where the spin is nearly constant.
    fn starts(constant: &ConstantSpin, _duration_s: f64, _config: &SpinConfig) -> Vec<Self> {
        vec![Self::of_constant(constant)]
    }

    /// What is known of the rates beyond the spin before a fit: their standard deviation, and the priors of all
    /// rates.
    fn prior(constant: &ConstantSpin, config: &SpinConfig) -> (f64, RatePrior<P>);

    /// The priors while a fit grows from a run, and with them the variances of the rates beyond the spin.
    fn growth_prior(scale: f64, config: &SpinConfig) -> RatePrior<P>;

    /// The same motion with another reference time.
    fn rebased(&self, time_s: f64) -> Self;

    /// Whether its rates are within what is considered until `last_s`.
    fn is_permitted(&self, last_s: f64, config: &SpinConfig) -> bool;

    /// Number of such motions with one spin that a sequence can distinguish: each is a clock or a ball of its
    /// own on which as many constant spins may agree by chance.
    fn distinguished(scale: f64, duration_s: f64, sigma_rad: f64, config: &SpinConfig) -> f64;

    /// Log-posterior of the simpler motion that this one contains, at the noise `sigma_rad`; `constant` is the
    /// constant spin of all measurements.
    fn ln_simpler(
        &self,
        measurements: &[Measurement],
        sigma_rad: f64,
        constant: Option<&ConstantSpin>,
        config: &SpinConfig,
    ) -> f64;

    /// What the covariance by independent noise makes of the rates beyond the simpler motion over what the wider one does:
    /// squares over variances.
    fn weight_of_evidence(&self, independent: &Blocks<P>, widened: &Blocks<P>) -> f64;

    /// Logarithm of the share of the prior's range that the measurements leave to the rates beyond the simpler
    /// motion.
    fn ln_occam(covariance: &Blocks<P>, scale: f64, config: &SpinConfig) -> f64;

    /// Whether the sequence determines the rates beyond the spin.
    fn is_determined(&self, covariance: &Blocks<P>, scale: f64, duration_s: f64) -> bool;
}

/// A maximum, with the prior under which it is one.
#[derive(Debug, Clone, Copy)]
struct MotionMaximum<M, const P: usize> {
    settled: SettledMotion<M>,
    scale: f64,
    prior: RatePrior<P>,
}

/// A start and the prior that goes with it.
struct MotionStart<M, const P: usize> {
    motion: M,
    scale: f64,
    prior: RatePrior<P>,
}

/// Fits the motion `M` and compares it with a constant spin.
///
/// # Errors
/// A [`SpinRejection`] where the settings or measurements are invalid, or the measurements too few, or where
/// neither a constant spin nor `M` agrees with most of the frames and with more than chance explains.
pub(super) fn compare<M: Richer<P>, const P: usize>(
    measurements: &[Measurement],
    config: &SpinConfig,
) -> Result<Outcome<M, P>, SpinRejection> {
    config.check()?;
    check(measurements, M::needed(config))?;
    let merged = Merged::of(measurements, config.sigma_rad);
    let measurements = &*merged.measurements;
    let constant = RobustEstimator::new(*config).fit_part(measurements);
    match fitted::<M, P>(measurements, constant.as_ref().ok(), config) {
        Some(fit) if fit.is_evident() => Ok(Outcome::Found {
            fit,
            constant: constant.ok(),
        }),
        rival => Ok(Outcome::Constant {
            fit: held_by_most(constant?, measurements, config.max_rps)?,
            rival,
        }),
    }
}

/// The motion `M` and the odds for it, where the measurements determine it; `constant` is their constant spin, if one holds.
pub(super) fn fitted<M: Richer<P>, const P: usize>(
    measurements: &[Measurement],
    constant: Option<&Fit>,
    config: &SpinConfig,
) -> Option<MotionFit<M, P>> {
    if measurements.len() < M::needed(config) {
        return None;
    }
    let steady = constant.map(|fit| &fit.motion);
    let (best, independent) = most_likely::<M, P>(measurements, steady, config)?;
    let SettledMotion {
        motion, sigma_rad, ..
    } = best.settled;
    let mixture = best.mixture(measurements, config);
    let probabilities = mixture.probabilities(&best.settled);
    let (covariance, lack_of_fit) = widened(
        &independent,
        &mixture,
        &best.settled,
        &probabilities,
        config,
        &mut Vec::new(),
    )?;
    let gain =
        best.settled.log_posterior - motion.ln_simpler(measurements, sigma_rad, steady, config);
    let ln_bayes_factor = gain * motion.weight_of_evidence(&independent, &covariance)
        + M::ln_occam(&covariance, best.scale, config);
    let is_determined = motion.is_determined(&covariance, best.scale, duration(measurements));
    is_determined.then_some(MotionFit {
        motion,
        covariance,
        scale: best.scale,
        sigma_rad,
        log_likelihood: best.settled.log_likelihood,
        inliers: best.settled.inliers,
        ln_bayes_factor,
        lack_of_fit,
    })
}

/// A maximum and the covariance of its parameters.
type Best<M, const P: usize> = (MotionMaximum<M, P>, Blocks<P>);

/// The best motion that is permitted.
fn most_likely<M: Richer<P>, const P: usize>(
    measurements: &[Measurement],
    constant: Option<&ConstantSpin>,
    config: &SpinConfig,
) -> Option<Best<M, P>> {
    if measurements.len() <= SECTION {
        let candidates = candidates::<M, P>(measurements, constant, config);
        return best_permitted(candidates, measurements, config);
    }
    PLACES.iter().find_map(|place| {
        let from = (place * (measurements.len() - SECTION) as f64) as usize;
        let section = &measurements[from..from + SECTION];
        let constant = RobustEstimator::new(*config).fit_part(section).ok();
        let constant = constant.as_ref().map(|fit| &fit.motion);
        let candidates = distinct(candidates::<M, P>(section, constant, config), section);
        let grown = candidates
            .iter()
            .filter_map(|c| c.grown(measurements, from, config))
            .collect();
        best_permitted(grown, measurements, config)
    })
}

/// The maxima that all starts lead to.
fn candidates<M: Richer<P>, const P: usize>(
    measurements: &[Measurement],
    constant: Option<&ConstantSpin>,
    config: &SpinConfig,
) -> Vec<MotionMaximum<M, P>> {
    let mut starts = Vec::new();
    if let Some(constant) = constant {
        let (scale, prior) = M::prior(constant, config);
        let motions = M::starts(constant, duration(measurements), config);
        starts.extend(motions.into_iter().map(|motion| MotionStart {
            motion,
            scale,
            prior,
        }));
    }
    starts.extend(grown_from_runs(measurements, config));
    let time_s = measurements[0].time_s;
    let settled = concurrency::map(&starts, |start| {
        let mixture = Mixture {
            measurements,
            noise: config.noise(),
            prior: start.prior,
        };
        Some(MotionMaximum {
            settled: mixture.settle(start.motion.rebased(time_s)).ok()?,
            scale: start.scale,
            prior: start.prior,
        })
    });
    settled.into_iter().flatten().collect()
}

/// Starts that grew from short runs over the sequence.
fn grown_from_runs<M: Richer<P>, const P: usize>(
    measurements: &[Measurement],
    config: &SpinConfig,
) -> Vec<MotionStart<M, P>> {
    let length = config.window.clamp(MIN_FRAMES, measurements.len());
    let last = measurements.len() - length;
    let mut estimator = RobustEstimator::new(SpinConfig {
        shared: None,
        ..*config
    });
    let mut tried = 0;
    let mut starts = Vec::new();
    for k in 0..RUNS {
        let place = (2 * k + 1) * last / (2 * RUNS);
        let places = (0..TRIES).map(|i| place + i * (length / 2).max(1));
        for from in places.filter(|from| *from <= last) {
            if from < tried {
                continue;
            }
            tried = from + 1;
            let run = &measurements[from..from + length];
            let Ok(fit) = estimator.fit_part(run) else {
                continue;
            };
            starts.extend(grown_from_run(measurements, from, run, &fit, config));
            break;
        }
    }
    starts
}

/// A start that grew from the run `from` on, whose spin is `fit`.
fn grown_from_run<M: Richer<P>, const P: usize>(
    measurements: &[Measurement],
    from: usize,
    run: &[Measurement],
    fit: &Fit,
    config: &SpinConfig,
) -> Option<MotionStart<M, P>> {
    let time_s = run.iter().map(|m| m.time_s).sum::<f64>() / run.len() as f64;
    let constant = fit.motion.rebased(time_s);
    let (scale, prior) = M::prior(&constant, config);
    let growth_prior = M::growth_prior(scale, config);
    let sigma_rad = fit.sigma_rad.unwrap_or(config.sigma_rad);
    let basis = LocalFrame::of(&constant.spin).basis;
    let of_spin: Matrix3<f64> = basis.transpose() * fit.spin_covariance? * basis;
    let mut rates = SMatrix::<f64, P, P>::zeros();
    for i in 3..P {
        rates[(i, i)] = 1.0 / growth_prior.weight[i];
    }
    rates.fixed_view_mut::<3, 3>(0, 0).copy_from(&of_spin);
    let spread = RateSpread {
        level: sigma_rad * sigma_rad,
        center: SMatrix::zeros(),
        rates,
    };
    let mixture = Mixture {
        measurements,
        noise: config.noise(),
        prior: growth_prior,
    };
    let start = M::of_constant(&constant);
    let motion = mixture.grow(start, from..from + run.len(), spread)?;
    Some(MotionStart {
        motion,
        scale,
        prior,
    })
}

impl<M: Richer<P>, const P: usize> MotionMaximum<M, P> {
    fn mixture<'a>(&self, measurements: &'a [Measurement], config: &SpinConfig) -> Mixture<'a, P> {
        Mixture {
            measurements,
            noise: config.noise(),
            prior: self.prior,
        }
    }

    /// The motion of a section that begins at `from`, fitted to the whole sequence.
    fn grown(
        &self,
        measurements: &[Measurement],
        from: usize,
        config: &SpinConfig,
    ) -> Option<Self> {
        let section = self.mixture(&measurements[from..from + SECTION], config);
        let spread = section.spread(&self.settled)?;
        let mixture = self.mixture(measurements, config);
        let grown = mixture.grow(self.settled.motion, from..from + SECTION, spread)?;
        Some(Self {
            settled: mixture.settle(grown.rebased(measurements[0].time_s)).ok()?,
            ..*self
        })
    }

    /// Whether the motion is within what is considered, and most of the frames agree, and more than
    /// chance explains.
    fn is_permitted(&self, measurements: &[Measurement], config: &SpinConfig) -> bool {
        let SettledMotion {
            motion,
            inliers,
            sigma_rad,
            ..
        } = self.settled;
        let duration_s = duration(measurements);
        let chance = expected_by_chance(measurements, inliers, sigma_rad, config.max_rps)
            * M::distinguished(self.scale, duration_s, sigma_rad, config);
        motion.is_permitted(measurements[0].time_s + duration_s, config)
            && inliers >= MIN_FRAMES
            && is_majority(inliers, measurements)
            && chance <= config.false_alarms
            && Belief::of(measurements, &motion, (sigma_rad, inliers), config)
                .check()
                .is_ok()
    }
}

/// The best that is permitted and a maximum in all directions.
fn best_permitted<M: Richer<P>, const P: usize>(
    candidates: Vec<MotionMaximum<M, P>>,
    measurements: &[Measurement],
    config: &SpinConfig,
) -> Option<Best<M, P>> {
    best_first(candidates).into_iter().find_map(|candidate| {
        if !candidate.is_permitted(measurements, config) {
            return None;
        }
        let mixture = candidate.mixture(measurements, config);
        let covariance = mixture.covariance(&candidate.settled, false, |_| ())?;
        Some((candidate, covariance))
    })
}

/// The best few motions that are not the same.
fn distinct<M: Richer<P>, const P: usize>(
    candidates: Vec<MotionMaximum<M, P>>,
    measurements: &[Measurement],
) -> Vec<MotionMaximum<M, P>> {
    let times = [measurements.first(), measurements.last()];
    let is_same = |a: &SettledMotion<M>, b: &SettledMotion<M>| {
        times.into_iter().flatten().all(|m| {
            let [a, b] = [a, b].map(|s| s.motion.predict(m.time_s));
            a.angle_to(&b) < SAME_RAD
        })
    };
    let mut chosen: Vec<MotionMaximum<M, P>> = Vec::new();
    for candidate in best_first(candidates) {
        let is_known = chosen
            .iter()
            .any(|c| is_same(&c.settled, &candidate.settled));
        if !is_known && chosen.len() < GROWING {
            chosen.push(candidate);
        }
    }
    chosen
}

fn best_first<M, const P: usize>(
    mut candidates: Vec<MotionMaximum<M, P>>,
) -> Vec<MotionMaximum<M, P>> {
    candidates.sort_by(|a, b| b.settled.objective.total_cmp(&a.settled.objective));
    candidates
}

/// A constant spin, if most of the sequence agrees on it: another motion passes for a constant one
/// over a part of its sequence.
fn held_by_most(
    fit: Fit,
    measurements: &[Measurement],
    max_rps: f64,
) -> Result<Fit, SpinRejection> {
    if is_majority(fit.inliers, measurements) {
        return Ok(fit);
    }
    Err(SpinRejection::NoConsensus {
        agreeing: fit.inliers,
        frames: measurements.len(),
        max_rps,
    })
}
