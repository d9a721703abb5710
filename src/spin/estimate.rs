//! The spin of a ball of which nobody knows how it moves: the motion by evidence, and the spin at a time.
//!
//! A constant spin, one that decays, one that precesses and one that is pushed are fitted to the same orientations ([`robust`](super::robust),
//! [`decay`](super::decay), [`precession`](super::precession), [`free`](super::free)). Each contains the ones before it; a richer one is taken where
//! the odds for it are 20 to 1 or better ([`evidence`](super::evidence)), the richest first. A spin that changes has a time: by
//! default the middle between the first orientation and the last, where it is known best. A free motion is summed up by its mean.
//!
//! ```
//! use spindoe::spin::estimate::{MotionModel, SpinEstimate};
//! use spindoe::spin::robust::SpinConfig;
//! use spindoe::spin::simulate::Scenario;
//!
//! let flight = Scenario { frames: 210, decay_per_s: 0.09, ..Scenario::default() };
//! let measurements = flight.sequence((60.0, 60.0), 5, 0).measurements;
//! let estimate = SpinEstimate::fit(&measurements, MotionModel::Auto, &SpinConfig::default())?;
//! assert_eq!(estimate.motion.model(), MotionModel::Decaying);
//! let middle = estimate.at(estimate.middle_s());
//! assert!((middle.motion.rps() - 60.0 * f64::exp(-0.09 * middle.motion.time_s)).abs() < 0.1);
//! # Ok::<(), spindoe::spin::SpinRejection>(())
//! ```
//!
//! The cost is linear in the orientations. A precession of more than sixteen thousand is looked for in the middle of them first.
//!
//! Guaranteed: where a motion is asked for, it is the answer wherever the orientations determine it, whatever the odds. Not
//! guaranteed: that no other motion explains the orientations better; a lack of fit ([`Fit::lack_of_fit`]) says that one does.

use std::f64::consts::TAU;

use super::alias::{AliasConfig, Alternative, SpinEvidence, alternatives, weigh};
use super::belief::Belief;
use super::clock::{Clock, Room, TimesReading, examined};
use super::decay::DecayFit;
use super::evidence::fitted;
pub use super::fitted::{FittedMotion, MotionModel, Rival};
use super::free::{free_about, free_alone, is_searched};
use super::mixture::inlier_probability;
use super::precession::PrecessionFit;
use super::repeated::Merged;
use super::robust::{RobustEstimator, SpinConfig, TIE_MARGIN};
use super::summary::SpinSummary;
use super::{Fit, MIN_FRAMES, Measurement, SpinRejection, check};
use crate::geometry::Vec3;

/// Orientations, the middle ones, in which a precession that is not asked for must show: a minute at 300 frames per second. One that
/// does not turns the spin's axis by less than some thousandths of a degree per second.
const SEARCHED: usize = 16_384;

/// The spin of a sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct SpinEstimate {
    /// The motion that was taken.
    pub motion: FittedMotion,
    /// The constant spin that agrees with the most orientations, if any is.
    pub constant: Option<Fit>,
    /// What was found of a decay.
    pub decaying: Rival<DecayFit>,
    /// What was found of a precession.
    pub precessing: Rival<PrecessionFit>,
    /// What was found wrong with the times, and mended: the motion is that with them mended.
    pub clock: Clock,
    /// The measurements with which it is, and their indices, where any was.
    mended: Option<(Vec<Measurement>, Vec<usize>)>,
    /// For each measurement that was given which of those of different times it is a part of; empty where no time repeats.
    repeats: Vec<usize>,
    /// Times of the first and the last orientation, seconds.
    span_s: [f64; 2],
    window: usize,
}

impl SpinEstimate {
    /// Fits a motion, or with [`MotionModel::Auto`] takes the one for which there is evidence.
    ///
    /// # Errors
    /// A [`SpinRejection`] where the settings or measurements are invalid, or the measurements too few, or where no such motion
    /// agrees with more of them than chance explains.
    pub fn fit(
        measurements: &[Measurement],
        model: MotionModel,
        config: &SpinConfig,
    ) -> Result<Self, SpinRejection> {
        Self::examined(measurements, model, config, None)
    }

    /// As [`Self::fit`], of the spins that the orientations leave open ([`alternatives`]) the one for which they and `evidence`
    /// speak together, and the slowest of those that odds of 20 to 1 do not decide between.
    ///
    /// # Errors
    /// As [`Self::fit`].
    pub fn fit_with(
        measurements: &[Measurement],
        model: MotionModel,
        config: &SpinConfig,
        evidence: &dyn SpinEvidence,
    ) -> Result<Self, SpinRejection> {
        Self::examined(measurements, model, config, Some(evidence))
    }

    /// The constant spin that orientations and `evidence` speak for together, believed or not: what a correction of the orientations
    /// starts from. The corrected ones decide.
    ///
    /// # Errors
    /// As [`Self::fit`], where no spin agrees with more orientations than chance explains.
    #[cfg(feature = "vision")]
    pub(crate) fn provisional(
        measurements: &[Measurement],
        config: &SpinConfig,
        evidence: &dyn SpinEvidence,
    ) -> Result<Fit, SpinRejection> {
        let mut estimator = RobustEstimator::new(*config);
        let mut fit = estimator.provisional(measurements)?;
        settle(&mut estimator, &mut fit, measurements, evidence);
        Ok(fit)
    }

    /// The motion at the times that the clock has.
    fn examined(
        measurements: &[Measurement],
        model: MotionModel,
        config: &SpinConfig,
        evidence: Option<&dyn SpinEvidence>,
    ) -> Result<Self, SpinRejection> {
        config.check()?;
        check(measurements, MIN_FRAMES)?;
        let merged = Merged::of(measurements, config.sigma_rad);
        let mut found = Self::of_merged(&merged.measurements, model, config, evidence)?;
        if merged.is_changed() {
            let count = merged.measurements.len();
            found.repeats = merged.spread(&(0..count).collect::<Vec<_>>());
            let (followed, kept) = found
                .mended
                .take()
                .unwrap_or_else(|| (merged.measurements.to_vec(), (0..count).collect()));
            found.mended = Some((followed, kept));
        }
        Ok(found)
    }

    /// As [`Self::examined`], of measurements whose times all differ.
    fn of_merged(
        measurements: &[Measurement],
        model: MotionModel,
        config: &SpinConfig,
        evidence: Option<&dyn SpinEvidence>,
    ) -> Result<Self, SpinRejection> {
        let room = &mut Room::default();
        let found = examined(measurements, config, room, |measurements, config, start| {
            let mut estimator = RobustEstimator::new(*config);
            let mut constant = estimator.fit_given(measurements, start).map(|(fit, _)| fit);
            if let (Ok(fit), Some(evidence)) = (&mut constant, evidence) {
                settle(&mut estimator, fit, measurements, evidence);
            }
            // About where scattered times leave a spin there is no other motion.
            let model = if start.is_some() {
                MotionModel::Constant
            } else {
                model
            };
            let mut found = Self::beyond(constant, measurements, model, config)?;
            let mut belief = found.belief(measurements, config);
            if belief.check().is_ok() && start.is_none() {
                found.free(measurements, model, config, &mut belief);
            }
            Ok((found, belief))
        });
        let mut found = match found {
            Err(rejection) => Self::pushed(rejection, room.taken(measurements), model, config)?,
            Ok(found) => found,
        };
        let TimesReading {
            clock,
            measurements,
            kept,
            ..
        } = std::mem::take(&mut room.reading);
        if !clock.is_right() {
            found.clock = clock;
            found.mended = Some((measurements, kept));
        }
        Ok(found)
    }

    /// Takes the free motion about the one that was found, where it is asked for or has the evidence.
    fn free(
        &mut self,
        measurements: &[Measurement],
        model: MotionModel,
        config: &SpinConfig,
        belief: &mut Belief,
    ) {
        let is_asked_for = model == MotionModel::Free;
        if !(is_asked_for || model == MotionModel::Auto && is_searched(measurements)) {
            return;
        }
        let Some(free) = free_about(measurements, &self.motion, config) else {
            return;
        };
        if is_asked_for || free.ln_bayes_factor > TIE_MARGIN {
            belief.motion += free.ln_bayes_factor.max(0.0);
            belief.along_over_across = free.along_over_across(measurements);
            self.motion = FittedMotion::Free(free);
        }
    }

    /// The free motion where no steady one holds and nothing is known to be wrong with the times.
    fn pushed(
        rejection: SpinRejection,
        measurements: &[Measurement],
        model: MotionModel,
        config: &SpinConfig,
    ) -> Result<Self, SpinRejection> {
        let is_wanted = match model {
            MotionModel::Auto => is_searched(measurements),
            model => model == MotionModel::Free,
        };
        let is_ordered = |r: &SpinRejection| {
            !matches!(
                r,
                SpinRejection::NotAtTheseTimes {
                    in_order_rps: Some(_),
                    ..
                }
            )
        };
        if !is_wanted || !rejection.is_no_spin() || !is_ordered(&rejection) {
            return Err(rejection);
        }
        let free = free_alone(measurements, config).ok_or(rejection)?;
        Ok(Self {
            motion: FittedMotion::Free(free),
            constant: None,
            decaying: Rival::NotFitted,
            precessing: Rival::NotFitted,
            clock: Clock::default(),
            mended: None,
            repeats: Vec::new(),
            span_s: span_s(measurements),
            window: config.window,
        })
    }

    /// How far the motion is believed.
    fn belief(&self, measurements: &[Measurement], config: &SpinConfig) -> Belief {
        let at_first = self.at(self.span_s[0]);
        let sigma_rad = at_first.sigma_rad.unwrap_or(config.sigma_rad);
        let known = (sigma_rad, at_first.inliers);
        match &self.motion {
            FittedMotion::Constant(fit) => Belief::of(measurements, &fit.motion, known, config),
            FittedMotion::Decaying(fit) => Belief::of(measurements, &fit.motion, known, config),
            FittedMotion::Precessing(fit) => Belief::of(measurements, &fit.motion, known, config),
            // It is judged by its own evidence.
            FittedMotion::Free(fit) => Belief::of(measurements, &fit.mean.motion, known, config),
        }
    }

    /// The measurements whose motion it is, of those that were given: without what repeats, at mended times.
    pub fn followed<'a>(&'a self, measurements: &'a [Measurement]) -> &'a [Measurement] {
        self.mended
            .as_ref()
            .map_or(measurements, |(mended, _)| mended)
    }

    /// The motion, where the constant spin is known.
    fn beyond(
        constant: Result<Fit, SpinRejection>,
        measurements: &[Measurement],
        model: MotionModel,
        config: &SpinConfig,
    ) -> Result<Self, SpinRejection> {
        // What no motion can do anything about.
        if let Err(rejection) = &constant
            && !rejection.is_no_spin()
        {
            return Err(*rejection);
        }
        let known = constant.as_ref().ok();
        let wants = |one: MotionModel| model == one || model == MotionModel::Auto;
        let decaying: Rival<DecayFit> = match wants(MotionModel::Decaying) {
            true => Rival::of(fitted(measurements, known, config)),
            false => Rival::NotFitted,
        };
        let is_asked_for = model != MotionModel::Auto;
        let precessing: Rival<PrecessionFit> = match wants(MotionModel::Precessing) {
            true if is_asked_for => Rival::of(fitted(measurements, known, config)),
            true => Rival::of(precession_where_evident(measurements, known, config)),
            false => Rival::NotFitted,
        };
        let precession = precessing.fit().filter(|f| is_asked_for || f.is_evident());
        let decay = decaying.fit().filter(|f| is_asked_for || f.is_evident());
        let motion = match (precession, decay) {
            (Some(fit), _) => FittedMotion::Precessing(*fit),
            (None, Some(fit)) => FittedMotion::Decaying(*fit),
            (None, None) => FittedMotion::Constant(constant?),
        };
        Ok(Self {
            motion,
            constant: constant.ok(),
            decaying,
            precessing,
            clock: Clock::default(),
            mended: None,
            repeats: Vec::new(),
            span_s: span_s(measurements),
            window: config.window,
        })
    }

    /// A constant spin that another estimator found.
    pub fn of_constant(fit: Fit, measurements: &[Measurement]) -> Self {
        Self {
            motion: FittedMotion::Constant(fit),
            constant: Some(fit),
            decaying: Rival::NotFitted,
            precessing: Rival::NotFitted,
            clock: Clock::default(),
            mended: None,
            repeats: Vec::new(),
            span_s: span_s(measurements),
            window: measurements.len(),
        }
    }

    /// Times of the first orientation and the last, seconds.
    pub fn span_s(&self) -> [f64; 2] {
        self.span_s
    }

    /// The middle between the first orientation and the last, seconds.
    pub fn middle_s(&self) -> f64 {
        0.5 * (self.span_s[0] + self.span_s[1])
    }

    /// The spin at `time_s`; see [`FittedMotion::at`].
    pub fn at(&self, time_s: f64) -> Fit {
        self.motion.at(time_s)
    }

    /// The spin that sums the sequence up: that in the middle, of a free motion the mean over the time.
    pub fn overall(&self) -> Fit {
        match &self.motion {
            FittedMotion::Free(fit) => fit.mean,
            _ => self.at(self.middle_s()),
        }
    }

    /// For each of the measurements the probability that it is an inlier.
    pub fn inlier_probabilities(&self, measurements: &[Measurement]) -> Vec<f64> {
        let sigma_rad = self.at(self.span_s[0]).sigma_rad.unwrap_or_default();
        let one = |m: &Measurement| {
            let angle = self.motion.predict(m.time_s).angle_to(&m.orientation);
            let variance = (sigma_rad * m.sigma_scale).powi(2);
            inlier_probability(m.confidence, angle * angle, variance)
        };
        let own = self.followed(measurements).iter().map(one);
        let Some((followed, kept)) = &self.mended else {
            return own.collect();
        };
        if !self.repeats.is_empty() {
            let of = |(m, k): (&Measurement, &usize)| {
                let at = kept.iter().position(|kept| kept == k);
                at.map_or(0.0, |at| {
                    one(&Measurement {
                        time_s: followed[at].time_s,
                        ..*m
                    })
                })
            };
            return measurements.iter().zip(&self.repeats).map(of).collect();
        }
        let mut all = vec![0.0; measurements.len()];
        for (k, p) in kept.iter().zip(own) {
            all[*k] = p;
        }
        all
    }

    /// What the `measurements`, which come from `frames` frames, say of the spin at `time_s`, without one of [`Self::overall`].
    pub fn summary(
        &self,
        measurements: &[Measurement],
        time_s: impl Into<Option<f64>>,
        config: &AliasConfig,
        frames: usize,
    ) -> SpinSummary {
        let fit = match time_s.into() {
            Some(time_s) => self.at(time_s),
            None => self.overall(),
        };
        let time_s = fit.motion.time_s;
        let orientations = measurements.len();
        let measurements = self.followed(measurements);
        let mut summary = match &self.motion {
            FittedMotion::Constant(_) => SpinSummary::new(measurements, &fit, config, frames),
            // A spin that changes has its aliases only while it is nearly constant.
            FittedMotion::Decaying(_) | FittedMotion::Free(_) => {
                let after = measurements.partition_point(|m| m.time_s < time_s);
                let count = self.window.min(measurements.len());
                let from = after
                    .saturating_sub(count / 2)
                    .min(measurements.len() - count);
                let part = &measurements[from..from + count];
                SpinSummary {
                    fit,
                    ..SpinSummary::new(part, &self.at(time_s), config, frames)
                }
            }
            FittedMotion::Precessing(precession) => SpinSummary {
                fit,
                ..precession.summary(measurements, config, frames)
            },
        };
        summary.orientations = orientations;
        summary.clock = self.clock;
        summary.residual_rad =
            super::summary::residual_rad(measurements, fit.inliers, |t| self.motion.predict(t));
        summary
    }
}

/// Takes the alias of a spin for which the orientations and `evidence` speak together.
fn settle(
    estimator: &mut RobustEstimator,
    fit: &mut Fit,
    measurements: &[Measurement],
    evidence: &dyn SpinEvidence,
) {
    let config = *estimator.config();
    let listed = AliasConfig::of(&config);
    let mut others = alternatives(measurements, fit, &listed);
    let own = fit.motion.spin;
    weigh(&mut others, &own, evidence, f64::NEG_INFINITY);
    others.push(Alternative {
        spin: own,
        log_likelihood_ratio: 0.0,
    });
    let taken = slowest_likely(&others, &config).filter(|spin| *spin != own);
    if let Some(Ok(alias)) = taken.map(|spin| estimator.fit_alias(measurements, fit, &spin)) {
        *fit = alias;
    }
}

/// The slowest of the spins that are likely, by the prior of the magnitude, too.
fn slowest_likely(all: &[Alternative], config: &SpinConfig) -> Option<Vec3> {
    let worth = |a: &Alternative| a.log_likelihood_ratio + config.ln_prior(a.spin.norm() / TAU);
    let top = all.iter().map(worth).fold(f64::NEG_INFINITY, f64::max);
    let likely = all.iter().filter(|a| worth(a) >= top - TIE_MARGIN);
    likely
        .map(|a| a.spin)
        .min_by(|a, b| a.norm().total_cmp(&b.norm()))
}

/// The precession; of long recordings that of a part, unless that has evidence for one.
fn precession_where_evident(
    measurements: &[Measurement],
    constant: Option<&Fit>,
    config: &SpinConfig,
) -> Option<PrecessionFit> {
    let whole = || fitted(measurements, constant, config);
    let rest = measurements.len().saturating_sub(SEARCHED);
    if rest == 0 {
        return whole();
    }
    let part = &measurements[rest / 2..rest / 2 + SEARCHED];
    let own = RobustEstimator::new(*config).fit_part(part).ok();
    let found: PrecessionFit = fitted(part, own.as_ref(), config)?;
    if found.is_evident() {
        whole()
    } else {
        Some(found)
    }
}

/// Times of the first and the last measurement, seconds.
fn span_s(measurements: &[Measurement]) -> [f64; 2] {
    let time_s = |m: Option<&Measurement>| m.map_or(0.0, |m| m.time_s);
    [measurements.first(), measurements.last()].map(time_s)
}
