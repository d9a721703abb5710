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

use super::chance::expected_by_chance;
use super::refine::{NoisePrior, Refined, observed_information, rebase, refine};
use super::search::{KEPT, SCORE_MARGIN, SearchConfig, Seen, Shortlist, judge_pair, pair_radius};
use super::shared::{Part, SharedError, shared_covariance};
use super::{Fit, MAX_TURNS, MIN_FRAMES, Measurement, SpinRejection, check, require};
use crate::geometry::Vec3;

/// Pairs of frames are searched by the gap between them, up to this many frames gap by gap, then
/// all at once.
const QUICK_GAP: usize = 3;
/// Widest gap between a pair's frames: beyond that there are only more turns to be wrong by.
const WIDEST_GAP: usize = 30;
/// Share of the frames that must agree for the search to end: what else there is explains the same
/// frames, and has been found with the same pairs, or explains fewer.
const ENOUGH: f64 = 0.6;
/// Frames that serve as a pair's first in one search; long sequences are sampled evenly.
const MAX_STARTS: usize = 64;
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

/// Settings of [`RobustEstimator`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobustSpinConfig {
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
}

impl Default for RobustSpinConfig {
    /// 175 revolutions per second (the paper's limit: half a turn a frame at 350 frames per second)
    /// and 2 deg of noise (the paper's mean orientation error is 2.4 deg over all three axes), with
    /// a weak weight: at half or twice that noise the residuals of ten frames dominate.
    fn default() -> Self {
        Self {
            max_rps: 175.0,
            sigma_rad: 2f64.to_radians(),
            sigma_degrees: 4.0,
            shared: None,
            prior: None,
            false_alarms: 0.2,
        }
    }
}

impl RobustSpinConfig {
    /// What is known of the noise.
    pub(super) fn noise(&self) -> NoisePrior {
        NoisePrior {
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
    config: RobustSpinConfig,
    seen: Vec<Seen>,
    shortlist: Shortlist,
    scratch: Vec<f64>,
    probabilities: Vec<f64>,
    parts: Vec<Part>,
    candidates: [Option<Refined>; KEPT],
}

impl RobustEstimator {
    /// An estimator with these settings.
    pub fn new(config: RobustSpinConfig) -> Self {
        Self {
            config,
            seen: Vec::new(),
            shortlist: Shortlist::new(),
            scratch: Vec::new(),
            probabilities: Vec::new(),
            parts: Vec::new(),
            candidates: [None; KEPT],
        }
    }

    /// The settings.
    pub fn config(&self) -> &RobustSpinConfig {
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
        let mut best = None;
        let quick = (1..=QUICK_GAP).map(|gap| gap..=gap);
        for gaps in quick.chain([QUICK_GAP + 1..=WIDEST_GAP.min(n - 1)]) {
            if gaps.is_empty() || *gaps.start() > n - 1 {
                break;
            }
            self.search(measurements, gaps);
            best = self.refine_all(measurements);
            if best.is_some_and(|b| b.support >= ENOUGH * n as f64) {
                break;
            }
        }
        let Some(best) = best else {
            return Err(self.no_consensus(0, n));
        };
        self.finish(measurements, &best)
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
        for gap in gaps {
            let starts = measurements.len() - gap;
            let stride = starts.div_ceil(MAX_STARTS);
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

    /// Refines the shortlist and returns the winner.
    fn refine_all(&mut self, measurements: &[Measurement]) -> Option<Refined> {
        let prior = self.config.noise();
        let best_score = self.shortlist.iter().next()?.score;
        self.candidates = [None; KEPT];
        for (i, h) in self.shortlist.iter().enumerate() {
            if h.score < best_score - SCORE_MARGIN {
                break;
            }
            // Within what the pair's noise explains, it is a worse start for the same maximum.
            let interval = measurements[h.pair.1].time_s - measurements[h.pair.0].time_s;
            let radius = pair_radius(prior.sigma_rad, interval);
            let same = |r: &Refined| (r.motion.spin - h.spin).norm_squared() < radius * radius;
            if self.candidates.iter().flatten().any(same) {
                continue;
            }
            self.candidates[i] = refine(measurements, h.pair, h.spin, &prior, &mut self.scratch)
                .filter(|r| r.motion.rps() <= self.config.max_rps);
        }
        self.choose()
    }

    /// The likeliest candidate; of those as likely, the slowest.
    fn choose(&self) -> Option<Refined> {
        let worth = |r: &Refined| {
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
        best: &Refined,
    ) -> Result<Fit, SpinRejection> {
        let prior = NoisePrior {
            sigma_rad: best.sigma_rad,
            degrees: f64::INFINITY,
        };
        // One more pass from the optimum leaves its probabilities in place.
        super::refine::probabilities(measurements, &best.motion, &prior, &mut self.probabilities);
        let inliers = self.probabilities.iter().filter(|p| **p > 0.5).count();
        let chance = expected_by_chance(measurements, inliers, best.sigma_rad, self.config.max_rps);
        if inliers < MIN_FRAMES || chance > self.config.false_alarms {
            return Err(self.no_consensus(inliers, measurements.len()));
        }
        let motion = rebase(&best.motion, measurements[0].time_s);
        let covariance = self.covariance(measurements, &motion, best);
        Ok(Fit {
            motion,
            spin_covariance: covariance,
            sigma_rad: Some(best.sigma_rad),
            log_likelihood: Some(best.log_likelihood),
            inliers,
        })
    }

    /// Covariance of the spin: the inverse of the curvature, widened where the noise is estimated.
    fn covariance(
        &mut self,
        measurements: &[Measurement],
        motion: &super::Motion,
        best: &Refined,
    ) -> Option<Matrix3<f64>> {
        let inverse = |subtract| {
            observed_information(
                measurements,
                motion,
                best.sigma_rad,
                &self.probabilities,
                subtract,
            )
            .cholesky()
            .map(|c| c.inverse())
        };
        let covariance = inverse(true).or_else(|| inverse(false))?;
        // Student's distribution with d degrees of freedom has the variance d / (d - 2).
        let widening = match best.degrees {
            d if d.is_finite() => d / (d - 2.0).max(1.0),
            _ => 1.0,
        };
        let own = covariance.fixed_view::<3, 3>(3, 3).into_owned() * widening;
        let Some(shared) = &self.config.shared else {
            return Some(own);
        };
        let (sigma, probabilities) = (best.sigma_rad, &self.probabilities);
        let parts = &mut self.parts;
        Some(own + shared_covariance(measurements, motion, sigma, probabilities, shared, parts)?)
    }
}

/// Standard deviations of a spin's components, rad/s.
pub fn standard_deviations(covariance: &Matrix3<f64>) -> Vec3 {
    covariance.diagonal().map(|v| v.max(0.0).sqrt())
}
