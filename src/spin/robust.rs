//! Spin by maximum likelihood on SO(3): robust to outliers, and a global search.
//!
//! Every spin that two of the frames allow (any number of turns between them, up to the permitted
//! magnitude) is scored on all others; the best few are refined together with the orientation under
//! a mixture of noise and uniform outliers; of these the likeliest wins, and among equals the
//! slowest.
//!
//! Guarantees: the same measurements give the same bits; no allocation once the estimator has seen
//! a sequence as long, where nothing speaks against its times; a spin is only reported where more frames agree on it than chance would
//! explain, and where the others do not speak more against it (`belief`). Not guaranteed: an answer for a spin that is not constant; the model assumes a constant
//! one.

use std::f64::consts::TAU;

use nalgebra::Matrix3;

use super::alias::{SpectralWindow, alias_near};
use super::belief::Belief;
use super::chance::expected_by_chance;
use super::clock::{Clock, Room, TimesReading, examined};
use super::config::SLOWEST_RPS;
pub use super::config::{MagnitudePrior, SpinConfig, TimeOrigin};
use super::mixture::{Mixture, RatePrior, RateSpread, SettledMotion, inlier_probability};
use super::motion::{ConstantSpin, LocalFrame, Motion};
use super::repeated::Merged;
use super::search::{
    KEPT, SCORE_MARGIN, SearchConfig, SeenTurn, Shortlist, judge_pair, pair_radius,
};
use super::shared::{FrameTerm, SharedError};
use super::widening::widened;
use super::{Fit, MAX_TURNS, MIN_FRAMES, Measurement, SpinRejection, check};
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
/// Aliases for which there is room from the beginning: as many as 350 rps have at ten frames per second.
pub(super) const ALIASES: usize = 128;
/// Steps in which an alias settles from where the fit's own maximum leads to: one at a tie.
const ALIAS_STEPS: usize = 20;
/// Steps in which the spin of the first frames becomes that of twice as many, where one holds: five as a rule.
const EXTENDING_STEPS: usize = 12;
/// Frames that serve as a pair's first with each gap, and pairs with the wide gaps together; long sequences
/// are sampled evenly.
const MAX_STARTS: usize = 64;
const MAX_WIDE_PAIRS: usize = 512;
/// Of spins whose log posterior differs by less than this the slowest is chosen: odds of 20 to 1
/// are the minimum that counts as evidence.
pub(super) const TIE_MARGIN: f64 = 3.0;

/// The robust estimator with its working memory.
#[derive(Debug, Clone)]
pub struct RobustEstimator {
    config: SpinConfig,
    seen: Vec<SeenTurn>,
    shortlist: Shortlist,
    window: SpectralWindow,
    aliases: Vec<SettledMotion<ConstantSpin>>,
    probabilities: Vec<f64>,
    parts: Vec<FrameTerm<3>>,
    candidates: [Option<SettledMotion<ConstantSpin>>; KEPT],
    room: Room,
}

impl RobustEstimator {
    /// An estimator with these settings.
    pub fn new(config: SpinConfig) -> Self {
        Self {
            config,
            seen: Vec::new(),
            shortlist: Shortlist::new(),
            window: SpectralWindow::new(),
            aliases: Vec::with_capacity(ALIASES),
            probabilities: Vec::new(),
            parts: Vec::new(),
            candidates: [None; KEPT],
            room: Room::default(),
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

    /// What was found wrong with the times of the last sequence, and mended: the spin is that with them mended.
    pub fn clock(&self) -> &Clock {
        &self.room.reading.clock
    }

    /// The spin of a sequence.
    ///
    /// # Errors
    /// A [`SpinRejection`] where the settings or the measurements are invalid, or the measurements
    /// are too few or agree on nothing, or speak against the spin that some of them agree on.
    pub fn fit(&mut self, measurements: &[Measurement]) -> Result<Fit, SpinRejection> {
        self.config.check()?;
        check(measurements, MIN_FRAMES)?;
        let merged = Merged::of(measurements, self.config.sigma_rad);
        let found = self.fit_merged(&merged.measurements);
        if merged.is_changed() && found.is_ok() {
            self.probabilities = merged.spread(&self.probabilities);
        }
        found
    }

    /// As [`Self::fit`], of measurements whose times all differ.
    fn fit_merged(&mut self, measurements: &[Measurement]) -> Result<Fit, SpinRejection> {
        let given = self.config;
        let mut room = std::mem::take(&mut self.room);
        let found = examined(
            measurements,
            &given,
            &mut room,
            |measurements, config, start| {
                self.config = *config;
                self.fit_given(measurements, start)
            },
        );
        (self.config, self.room) = (given, room);
        let TimesReading { clock, kept, .. } = &self.room.reading;
        if !clock.is_right() && found.is_ok() {
            // Those that were left out are no inliers: each of the others moves to its own place, the last first.
            self.probabilities.resize(measurements.len(), 0.0);
            for (i, k) in kept.iter().enumerate().rev() {
                self.probabilities.swap(i, *k);
            }
        }
        found
    }

    /// A spin that the most orientations follow, believed or not, of those as likely the slowest: what corrections of the orientations
    /// start from.
    ///
    /// # Errors
    /// As [`Self::fit`], where no spin agrees with more orientations than chance explains.
    #[cfg(feature = "vision")]
    pub(crate) fn provisional(
        &mut self,
        measurements: &[Measurement],
    ) -> Result<Fit, SpinRejection> {
        self.config.check()?;
        check(measurements, MIN_FRAMES)?;
        let merged = Merged::of(measurements, self.config.sigma_rad);
        let measurements = &*merged.measurements;
        self.searched(measurements, false)?;
        let found = self.candidates.iter().flatten();
        let most = found.clone().map(|c| c.inliers).max().unwrap_or(0);
        let found = found.filter(|c| c.inliers == most);
        let top = found
            .clone()
            .map(|c| c.log_likelihood)
            .fold(f64::NEG_INFINITY, f64::max);
        let likely = found.filter(|c| c.log_likelihood >= top - TIE_MARGIN);
        let slowest = likely.min_by(|a, b| a.motion.rps().total_cmp(&b.motion.rps()));
        let slowest = *slowest.ok_or(self.no_consensus(most, measurements.len()))?;
        self.finish(measurements, &slowest).map(|(fit, _)| fit)
    }

    /// The spin of a part of a sequence whose clock is examined as a whole.
    ///
    /// # Errors
    /// As [`Self::fit`].
    pub(super) fn fit_part(&mut self, measurements: &[Measurement]) -> Result<Fit, SpinRejection> {
        believed(self.fit_given(measurements, None)?)
    }

    /// The spin of a sequence whose times are right, believed or not; that next to `start`, if one is given.
    ///
    /// # Errors
    /// As [`Self::fit`].
    pub(super) fn fit_given(
        &mut self,
        measurements: &[Measurement],
        start: Option<&ConstantSpin>,
    ) -> Result<(Fit, Belief), SpinRejection> {
        self.config.check()?;
        check(measurements, MIN_FRAMES)?;
        if let Some(start) = start {
            let settled = self.mixture(measurements).settle(*start).ok();
            let rejected = self.no_consensus(0, measurements.len());
            return self.finish(measurements, &settled.ok_or(rejected)?);
        }
        let best = self.searched(measurements, self.config.prior.is_none())?;
        let best = self.among_aliases(measurements, best);
        self.finish(measurements, &best)
    }

    /// The likeliest motion that the search finds, or one of its aliases, of those tried first that are the slower ones or all.
    fn searched(
        &mut self,
        measurements: &[Measurement],
        is_slower_likelier: bool,
    ) -> Result<SettledMotion<ConstantSpin>, SpinRejection> {
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
            self.search(measurements, gaps, is_slower_likelier);
            best = self.refine_all(measurements);
            let is_explained = n >= LONG && self.shortlist.best_share() >= ENOUGH;
            if is_explained || best.is_some_and(|b| b.support >= ENOUGH * n as f64) {
                break;
            }
        }
        best.ok_or(self.no_consensus(0, n))
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
                let spread = RateSpread {
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
        believed(self.finish(measurements, &settled.ok_or(rejected)?)?)
    }

    /// The spin of a sequence that is an alias of `fit`, believed or not: the maximum of the likelihood next to `spin`.
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
        let (fit, _) = self.finish(measurements, &settled.ok_or(rejected)?)?;
        Ok(fit)
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
    fn search(
        &mut self,
        measurements: &[Measurement],
        gaps: std::ops::RangeInclusive<usize>,
        is_slower_likelier: bool,
    ) {
        let settings = SearchConfig {
            sigma_rad: self.config.sigma_rad,
            max_spin: self.config.max_rps * TAU,
            slowest: SLOWEST_RPS * TAU,
            is_slower_likelier,
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
    fn refine_all(&mut self, measurements: &[Measurement]) -> Option<SettledMotion<ConstantSpin>> {
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
            let same = |s: &SettledMotion<ConstantSpin>| {
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
            let ln = |c: &Option<SettledMotion<ConstantSpin>>| {
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
    fn choose(&self) -> Option<SettledMotion<ConstantSpin>> {
        self.slowest_likely(self.candidates.iter().flatten())
    }

    /// The slowest of those that odds of 20 to 1 do not decide between.
    fn slowest_likely<'a>(
        &self,
        all: impl IntoIterator<Item = &'a SettledMotion<ConstantSpin>> + Clone,
    ) -> Option<SettledMotion<ConstantSpin>> {
        let worths = all.clone().into_iter().map(|s| self.worth(s));
        let top = worths.fold(f64::NEG_INFINITY, f64::max);
        all.into_iter()
            .filter(|s| self.worth(s) >= top - TIE_MARGIN)
            .min_by(|a, b| a.motion.rps().total_cmp(&b.motion.rps()))
            .copied()
    }

    /// Log-posterior of a candidate, up to a constant.
    fn worth(&self, candidate: &SettledMotion<ConstantSpin>) -> f64 {
        candidate.log_likelihood + self.config.ln_prior(candidate.motion.rps())
    }

    /// Of a spin and all its aliases that the prior may prefer to it the slowest of the likeliest.
    fn among_aliases(
        &mut self,
        measurements: &[Measurement],
        best: SettledMotion<ConstantSpin>,
    ) -> SettledMotion<ConstantSpin> {
        let mixture = self.mixture(measurements);
        self.probabilities.clear();
        let jacobian = best.motion.jacobian();
        self.probabilities.extend(measurements.iter().map(|m| {
            let variance = (best.sigma_rad * m.sigma_scale).powi(2);
            inlier_probability(m.confidence, jacobian(m).0.norm_squared(), variance)
        }));
        let is_inlier = |k: usize| self.probabilities[k] > 0.5;
        self.window.load(measurements, is_inlier);
        let rate = best.motion.spin.norm();
        let limit = self.config.max_rps * TAU;
        match self.config.prior {
            // Nearer than half a cycle over the sequence it is the same peak.
            None => self.window.scan(-2.0 * rate, -self.window.half_cycle()),
            Some(_) => self.window.scan(-limit - rate, limit - rate),
        }
        self.aliases.clear();
        self.aliases.push(best);
        for delta in &self.window.peaks {
            let start = self.window.aliased(&best.motion, *delta);
            let settled = mixture.settle_within(start, ALIAS_STEPS).ok();
            let permitted = settled.filter(|s| s.motion.rps() <= self.config.max_rps);
            self.aliases.extend(permitted);
        }
        self.slowest_likely(&self.aliases).unwrap_or(best)
    }

    /// Reference time, covariance, and the last doubts.
    fn finish(
        &mut self,
        measurements: &[Measurement],
        best: &SettledMotion<ConstantSpin>,
    ) -> Result<(Fit, Belief), SpinRejection> {
        let inliers = best.inliers;
        let chance = expected_by_chance(measurements, inliers, best.sigma_rad, self.config.max_rps);
        if inliers < MIN_FRAMES || chance > self.config.false_alarms {
            return Err(self.no_consensus(inliers, measurements.len()));
        }
        let known = (best.sigma_rad, inliers);
        let belief = Belief::of(measurements, &best.motion, known, &self.config);
        let at_first = SettledMotion {
            motion: best.motion.rebased(measurements[0].time_s),
            ..*best
        };
        let known = self.covariance(measurements, &at_first);
        let fit = Fit {
            motion: at_first.motion,
            spin_covariance: known.map(|(covariance, _)| covariance),
            sigma_rad: Some(best.sigma_rad),
            log_likelihood: Some(best.log_likelihood),
            inliers,
            lack_of_fit: known.and_then(|(_, lack_of_fit)| lack_of_fit),
        };
        Ok((fit, belief))
    }

    /// Covariance of the spin, and the lack of fit; leaves the probabilities that the frames are inliers in place.
    fn covariance(
        &mut self,
        measurements: &[Measurement],
        best: &SettledMotion<ConstantSpin>,
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
            &self.config,
            &mut self.parts,
        )?;
        let basis = best.motion.local_frame().basis;
        Some((basis * covariance.rates * basis.transpose(), lack_of_fit))
    }
}

/// A fit, where the measurements believe it.
fn believed((fit, belief): (Fit, Belief)) -> Result<Fit, SpinRejection> {
    belief.check().map(|()| fit)
}

/// Standard deviations of a spin's components, rad/s.
pub fn standard_deviations(covariance: &Matrix3<f64>) -> Vec3 {
    covariance.diagonal().map(|v| v.max(0.0).sqrt())
}
