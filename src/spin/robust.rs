//! Spin by maximum likelihood on SO(3): robust to outliers, and a global search.
//!
//! Every spin that two of the frames allow (any number of turns between them, up to the permitted
//! magnitude) is scored on all others; the best few are refined together with the orientation under
//! a mixture of noise and uniform outliers; of these the likeliest wins, and among equals the
//! slowest.
//!
//! Guarantees: the same measurements give the same bits; no allocation once the estimator has seen
//! a sequence as long; a spin is only reported where more frames agree on it than chance would
//! explain. Not guaranteed: an answer for a spin that is not constant; the model assumes a constant
//! one.

use nalgebra::Matrix3;

use super::alias::alias_near;
use super::chance::expected_by_chance;
use super::mixture::{Mixture, Noise, RatePrior, Settled, Spread};
use super::motion::{ConstantSpin, LocalFrame, Motion};
use super::search::{KEPT, SCORE_MARGIN, SearchConfig, Seen, Shortlist, judge_pair, pair_radius};
use super::shared::{Part, SharedError};
use super::widening::widened;
use super::{Fit, MAX_TURNS, MIN_FRAMES, Measurement, SpinRejection, check, require};
use crate::geometry::Vec3;

/// Pairs of frames are searched by the gap between them, up to this many frames gap by gap, then
/// all at once.
const QUICK_GAP: usize = 3;
/// Widest gap between a pair's frames: beyond that there are only more turns to be wrong by.
const WIDEST_GAP: usize = 30;
/// Share of the frames that must agree for the search to end: what else there is explains the same frames, and
/// has been found with the same pairs, or explains fewer.
const ENOUGH: f64 = 0.6;
/// From so many frames on it is enough that the frames within reach of the best hypothesis agree with it: a spin
/// that changes over a long sequence has no fit, with whatever gap it is searched.
const LONG: usize = 128;
/// A constant spin of so many frames predicts as many after them to within their noise: `n` frames leave a
/// standard deviation of `sqrt(28 / n)` of it at the far end.
const PREDICTING: usize = 28;
/// Steps in which the spin of the first frames becomes that of twice as many, where one holds: five as a rule.
const EXTENDING_STEPS: usize = 12;
/// Frames that serve as a pair's first with each gap, and pairs with the wide gaps together; long sequences
/// are sampled evenly.
const MAX_STARTS: usize = 64;
const MAX_WIDE_PAIRS: usize = 512;
/// Of spins whose log posterior differs by less than this the slowest is chosen: odds of 20 to 1
/// are the minimum that counts as evidence.
pub(super) const TIE_MARGIN: f64 = 3.0;

/// A prior of the spin's magnitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MagnitudePrior {
    /// Expected magnitude, revolutions per second.
    pub rps: f64,
    /// Its standard deviation, revolutions per second.
    pub std_rps: f64,
}

impl MagnitudePrior {
    /// Log-density of a magnitude, up to a constant.
    pub fn log_density(&self, rps: f64) -> f64 {
        -0.5 * ((rps - self.rps) / self.std_rps).powi(2)
    }
}

/// How spins are estimated: the settings of [`RobustEstimator`], [`fit_decay`](super::decay::fit_decay) and
/// [`fit_precession`](super::precession::fit_precession).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpinConfig {
    /// Largest spin considered, revolutions per second.
    pub max_rps: f64,
    /// Noise of an orientation per axis, radians.
    pub sigma_rad: f64,
    /// Weight of `sigma_rad`, in degrees of freedom, when the noise is estimated from the
    /// residuals; infinite: the noise is known and fixed.
    pub sigma_degrees: f64,
    /// An error that frames share, if there is one: it widens the covariance.
    pub shared: Option<SharedError>,
    /// Prior of the magnitude, if there is one.
    pub prior: Option<MagnitudePrior>,
    /// Expected number of spins with as much agreement by chance that is still accepted.
    pub false_alarms: f64,
    /// Orientations in a run whose spin is taken as constant, whatever the motion.
    pub window: usize,
    /// Largest rate of decay or growth considered, 1/s. Its prior is uniform within it.
    pub max_decay_per_s: f64,
    /// Expected relative difference of an uneven ball's moments of inertia: its standard deviation.
    pub unevenness: f64,
    /// Expected rate at which the spin of an uneven ball decays, 1/s: its standard deviation about none.
    pub decay_sigma_per_s: f64,
}

impl Default for SpinConfig {
    /// 175 revolutions per second (the paper's limit: half a turn a frame at 350 frames per second)
    /// and 2 deg of noise (the paper's mean orientation error is 2.4 deg over all three axes), with
    /// a weak weight: at half or twice that noise the residuals of ten frames dominate. Runs of ten
    /// orientations: at 350 frames per second a spin loses less than 0.3 % in one. Decays up to 2 per
    /// second, twenty times what air does to a table tennis ball; moments of inertia that differ by 5 %, with decays of
    /// 0.2 per second.
    fn default() -> Self {
        Self {
            max_rps: 175.0,
            sigma_rad: 2f64.to_radians(),
            sigma_degrees: 4.0,
            shared: None,
            prior: None,
            false_alarms: 0.2,
            window: 10,
            max_decay_per_s: 2.0,
            unevenness: 0.05,
            decay_sigma_per_s: 0.2,
        }
    }
}

impl SpinConfig {
    /// What is known of the noise.
    pub(super) fn noise(&self) -> Noise {
        Noise {
            sigma_rad: self.sigma_rad,
            degrees: self.sigma_degrees,
        }
    }

    /// Checks the domains of all settings.
    ///
    /// # Errors
    /// [`SpinRejection::Setting`] naming the first that is outside.
    pub fn check(&self) -> Result<(), SpinRejection> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let rps = self.max_rps;
        require(positive(rps), "max_rps", "a positive number", rps)?;
        // More noise than that is no orientation, and would allow any number of turns.
        let sigma = self.sigma_rad;
        let inside = sigma > 0.0 && sigma <= std::f64::consts::FRAC_PI_2;
        let degrees = sigma.to_degrees();
        require(
            inside,
            "sigma_rad",
            "more than 0 and at most 90 deg",
            degrees,
        )?;
        // Infinite is a meaning of its own.
        let degrees = self.sigma_degrees;
        require(degrees > 0.0, "sigma_degrees", "a positive number", degrees)?;
        let alarms = self.false_alarms;
        require(
            positive(alarms),
            "false_alarms",
            "a positive number",
            alarms,
        )?;
        let inside = self.window >= MIN_FRAMES;
        require(inside, "window", "3 or more", self.window as f64)?;
        for (setting, rate) in [
            ("max_decay_per_s", self.max_decay_per_s),
            ("decay_sigma_per_s", self.decay_sigma_per_s),
        ] {
            require(positive(rate), setting, "a positive number", rate)?;
        }
        let e = self.unevenness;
        let expected = "more than 0 and at most 0.5";
        require(e > 0.0 && e <= 0.5, "unevenness", expected, e)?;
        let Some(prior) = self.prior else {
            return Ok(());
        };
        let inside = prior.rps >= 0.0 && prior.rps.is_finite();
        require(inside, "prior_rps", "0 or more", prior.rps)?;
        let std = prior.std_rps;
        require(positive(std), "prior_std_rps", "a positive number", std)
    }
}

/// The robust estimator with its working memory.
#[derive(Debug, Clone)]
pub struct RobustEstimator {
    config: SpinConfig,
    seen: Vec<Seen>,
    shortlist: Shortlist,
    probabilities: Vec<f64>,
    parts: Vec<Part<3>>,
    candidates: [Option<Settled<ConstantSpin>>; KEPT],
}

impl RobustEstimator {
    /// An estimator with these settings.
    pub fn new(config: SpinConfig) -> Self {
        Self {
            config,
            seen: Vec::new(),
            shortlist: Shortlist::new(),
            probabilities: Vec::new(),
            parts: Vec::new(),
            candidates: [None; KEPT],
        }
    }

    /// The settings.
    pub fn config(&self) -> &SpinConfig {
        &self.config
    }

    /// Sets the error that the frames of the next fits share.
    pub fn set_shared(&mut self, shared: Option<SharedError>) {
        self.config.shared = shared;
    }

    /// For each measurement of the last successful fit, the probability that it is an inlier.
    pub fn inlier_probabilities(&self) -> &[f64] {
        &self.probabilities
    }

    /// The spin of a sequence.
    ///
    /// # Errors
    /// A [`SpinRejection`] where the settings or the measurements are invalid, or the measurements
    /// are too few or agree on nothing.
    pub fn fit(&mut self, measurements: &[Measurement]) -> Result<Fit, SpinRejection> {
        self.config.check()?;
        check(measurements, MIN_FRAMES)?;
        self.check_spacing(measurements)?;
        let n = measurements.len();
        self.shortlist.clear();
        self.candidates = [None; KEPT];
        let mut best = None;
        let quick = (1..=QUICK_GAP).map(|gap| gap..=gap);
        for gaps in quick.chain([QUICK_GAP + 1..=WIDEST_GAP.min(n - 1)]) {
            if gaps.is_empty() || *gaps.start() > n - 1 {
                break;
            }
            self.search(measurements, gaps);
            best = self.refine_all(measurements);
            let is_explained = n >= LONG && self.shortlist.best_share() >= ENOUGH;
            if is_explained || best.is_some_and(|b| b.support >= ENOUGH * n as f64) {
                break;
            }
        }
        let Some(best) = best else {
            return Err(self.no_consensus(0, n));
        };
        self.finish(measurements, &best)
    }

    /// The spin of a sequence of at most twice the `known` frames, the first, that have the spin `fit`: the maximum of the likelihood that
    /// leads from there, without a search.
    ///
    /// # Errors
    /// A [`SpinRejection`] where that spin does not hold over the sequence.
    pub(super) fn extend(
        &mut self,
        measurements: &[Measurement],
        known: usize,
        fit: &Fit,
    ) -> Result<Fit, SpinRejection> {
        let rejected = self.no_consensus(0, measurements.len());
        let mixture = self.mixture(measurements);
        let start = match known >= PREDICTING {
            true => Some(fit.motion),
            false => {
                let covariance = fit.spin_covariance.ok_or(rejected)?;
                let interval = measurements[known - 1].time_s - measurements[0].time_s;
                let basis = LocalFrame::of(&fit.motion.spin).basis;
                let spread = Spread {
                    level: self.config.sigma_rad.powi(2) / known as f64,
                    center: Matrix3::from_diagonal_element(0.5 * interval),
                    rates: basis.transpose() * covariance * basis,
                };
                mixture.grow(fit.motion, 0..known, spread)
            }
        };
        let settled = start
            .and_then(|start| mixture.settle_within(start, EXTENDING_STEPS).ok())
            .filter(|s| s.motion.rps() <= self.config.max_rps);
        self.finish(measurements, &settled.ok_or(rejected)?)
    }

    /// The spin of a sequence that is an alias of `fit`: the maximum of the likelihood next to `spin`.
    ///
    /// # Errors
    /// A [`SpinRejection`] where no spin near it agrees with the measurements, within the limit.
    pub(super) fn fit_alias(
        &mut self,
        measurements: &[Measurement],
        fit: &Fit,
        spin: &Vec3,
    ) -> Result<Fit, SpinRejection> {
        let settled = self
            .mixture(measurements)
            .settle(alias_near(measurements, fit, spin))
            .ok()
            .filter(|s| s.motion.rps() <= self.config.max_rps);
        let rejected = self.no_consensus(0, measurements.len());
        self.finish(measurements, &settled.ok_or(rejected)?)
    }

    /// The likelihood of a sequence.
    fn mixture<'a>(&self, measurements: &'a [Measurement]) -> Mixture<'a, 3> {
        Mixture {
            measurements,
            noise: self.config.noise(),
            prior: RatePrior::none(),
        }
    }

    /// Rejects a sequence whose nearest frames leave too many turns open.
    fn check_spacing(&self, measurements: &[Measurement]) -> Result<(), SpinRejection> {
        let intervals = measurements.windows(2).map(|w| w[1].time_s - w[0].time_s);
        let interval_s = intervals.fold(f64::INFINITY, f64::min);
        let turns = 2.0 * interval_s * self.config.max_rps;
        if turns <= MAX_TURNS as f64 {
            return Ok(());
        }
        Err(SpinRejection::Sparse {
            interval_s,
            turns,
            max_rps: self.config.max_rps,
        })
    }

    fn no_consensus(&self, agreeing: usize, frames: usize) -> SpinRejection {
        SpinRejection::NoConsensus {
            agreeing,
            frames,
            max_rps: self.config.max_rps,
        }
    }

    /// Offers the spins of all pairs with these gaps (in frames) to the shortlist.
    fn search(&mut self, measurements: &[Measurement], gaps: std::ops::RangeInclusive<usize>) {
        let settings = SearchConfig {
            sigma_rad: self.config.sigma_rad,
            max_spin: self.config.max_rps * std::f64::consts::TAU,
        };
        let max_starts = MAX_STARTS.min(MAX_WIDE_PAIRS / gaps.clone().count());
        for gap in gaps {
            let starts = measurements.len() - gap;
            let stride = starts.div_ceil(max_starts);
            for first in (0..starts).step_by(stride) {
                let pair = (first, first + gap);
                let interval = measurements[pair.1].time_s - measurements[pair.0].time_s;
                if 2.0 * interval * self.config.max_rps > MAX_TURNS as f64 {
                    continue;
                }
                judge_pair(
                    measurements,
                    pair,
                    &settings,
                    &mut self.seen,
                    &mut self.shortlist,
                );
            }
        }
    }

    /// Fits the shortlist and returns the winner.
    fn refine_all(&mut self, measurements: &[Measurement]) -> Option<Settled<ConstantSpin>> {
        let mixture = self.mixture(measurements);
        let best_score = self.shortlist.iter().next()?.score;
        for h in self.shortlist.iter_mut() {
            if h.score < best_score - SCORE_MARGIN {
                break;
            }
            if std::mem::replace(&mut h.is_tried, true) {
                continue;
            }
            // Within what the pair's noise explains, it is a worse start for the same maximum.
            let interval = measurements[h.pair.1].time_s - measurements[h.pair.0].time_s;
            let radius = pair_radius(self.config.sigma_rad, interval);
            let same = |s: &Settled<ConstantSpin>| {
                (s.motion.spin - h.spin).norm_squared() < radius * radius
            };
            if self.candidates.iter().flatten().any(same) {
                continue;
            }
            let (start, spread) = h.start(measurements, self.config.sigma_rad);
            let settled = mixture
                .grow(start, h.pair.0..h.pair.1 + 1, spread)
                .and_then(|grown| mixture.settle(grown).ok())
                .filter(|s| s.motion.rps() <= self.config.max_rps);
            let ln = |c: &Option<Settled<ConstantSpin>>| {
                c.map_or(f64::NEG_INFINITY, |s| s.log_likelihood)
            };
            let worst = self
                .candidates
                .iter_mut()
                .min_by(|a, b| ln(a).total_cmp(&ln(b)));
            if let Some(worst) = worst.filter(|worst| ln(worst) < ln(&settled)) {
                *worst = settled;
            }
        }
        self.choose()
    }

    /// The likeliest candidate; of those as likely, the slowest.
    fn choose(&self) -> Option<Settled<ConstantSpin>> {
        let worth = |r: &Settled<ConstantSpin>| {
            let prior = self.config.prior;
            r.log_likelihood + prior.map_or(0.0, |p| p.log_density(r.motion.rps()))
        };
        let found = || self.candidates.iter().flatten();
        let top = found().map(worth).fold(f64::NEG_INFINITY, f64::max);
        found()
            .filter(|r| worth(r) >= top - TIE_MARGIN)
            .min_by(|a, b| a.motion.rps().total_cmp(&b.motion.rps()))
            .copied()
    }

    /// Reference time, covariance, and the last doubts.
    fn finish(
        &mut self,
        measurements: &[Measurement],
        best: &Settled<ConstantSpin>,
    ) -> Result<Fit, SpinRejection> {
        let inliers = best.inliers;
        let chance = expected_by_chance(measurements, inliers, best.sigma_rad, self.config.max_rps);
        if inliers < MIN_FRAMES || chance > self.config.false_alarms {
            return Err(self.no_consensus(inliers, measurements.len()));
        }
        let at_first = Settled {
            motion: best.motion.rebased(measurements[0].time_s),
            ..*best
        };
        let known = self.covariance(measurements, &at_first);
        Ok(Fit {
            motion: at_first.motion,
            spin_covariance: known.map(|(covariance, _)| covariance),
            sigma_rad: Some(best.sigma_rad),
            log_likelihood: Some(best.log_likelihood),
            inliers,
            lack_of_fit: known.and_then(|(_, lack_of_fit)| lack_of_fit),
        })
    }

    /// Covariance of the spin, and the lack of fit; leaves the probabilities that the frames are inliers in place.
    fn covariance(
        &mut self,
        measurements: &[Measurement],
        best: &Settled<ConstantSpin>,
    ) -> Option<(Matrix3<f64>, Option<f64>)> {
        let mixture = Mixture {
            measurements,
            noise: self.config.noise(),
            prior: RatePrior::none(),
        };
        self.probabilities.clear();
        let probabilities = &mut self.probabilities;
        let covariance = mixture
            .covariance(best, false, |p| probabilities.push(p))
            .or_else(|| mixture.covariance(best, true, |_| ()))?;
        let (covariance, lack_of_fit) = widened(
            &covariance,
            &mixture,
            best,
            &self.probabilities,
            self.config.shared.as_ref(),
            &mut self.parts,
        )?;
        let basis = best.motion.local_frame().basis;
        Some((basis * covariance.rates * basis.transpose(), lack_of_fit))
    }
}

/// Standard deviations of a spin's components, rad/s.
pub fn standard_deviations(covariance: &Matrix3<f64>) -> Vec3 {
    covariance.diagonal().map(|v| v.max(0.0).sqrt())
}
