//! Fit and identification in turn.

use nalgebra::Matrix2;

use super::bundle::{Bundle, BundleFrame, DotFit, Observation};
use super::clip_dot::ClipDot;
use super::config::CalibrationConfig;
use super::fitted::FittedFrame;
use super::identify::identify_frames;
use super::marks::{FoundMark, steady_marks};
use super::presence::{DetectionRate, Looks, MIN_EXPECTED_VIEWS, doubtful_limit, find_records};
use super::result::{Calibration, CalibrationRejection, SteadyMark, drawing_sigma_rad, in_space};
use crate::ball::{Ball, CalibrationRecord};
use crate::error::Result;
use crate::geometry::{Vec3, angle_between};
use crate::pattern::{MAX_DOTS, Pattern};
use crate::stats::median;
use crate::vision::FrameEstimate;
use crate::vision::pose::trust::TrustMap;

/// Minimum number of named dots of a frame that takes part in the fit.
const MIN_MATCHED: usize = 4;
/// An unnamed detection this near to a dot that was left out is a find of it, radians.
const FIND_RAD: f64 = 0.05;
/// A mark nearer to a dot than this is that dot, found twice, radians.
const SAME_RAD: f64 = 0.07;
/// Share of the dots in view that may be missing.
const MAX_MISSING: f64 = 0.34;
/// Placement errors with which a ball that is not recognized is tried again, in those of the estimator.
const WIDER: [f64; 2] = [2.0, 3.5];
/// A mark this many standard deviations of the dots' offsets from a dot's place may be that dot: its looks say
/// whether it is.
const DISPLACED: f64 = 5.0;
/// Change of the dots, radians, below which the rounds end.
const SETTLED_RAD: f64 = 1e-4;

/// What the detector says of a dot, mean over its views.
#[derive(Debug, Clone, Copy, Default)]
struct MeanDetection {
    /// Probability of a dot.
    probability: f64,
    /// Variance of a detection, rad^2 per axis at the ball's middle.
    variance: f64,
}

/// What a fit gives besides the dots.
struct FitSummary {
    noise_scale: f64,
    smooth: bool,
    inverse_distance: Option<f64>,
    axis_rad: Option<f64>,
    /// What the outlines are off, in radii: see [`Bundle::outline_shift`].
    outline_shift: Vec3,
    /// Mean variance of a detection, rad^2 at the ball's middle.
    detection_variance: f64,
    sightings: Vec<MeanDetection>,
}

/// The alternation's state.
pub(super) struct Rounds<'a> {
    nominal: &'a Pattern,
    times_s: Option<&'a [f64]>,
    config: &'a CalibrationConfig,
    candidates: Vec<ClipDot>,
    /// For each dot of the pattern that named the frames' detections, its candidate.
    names: Vec<usize>,
    frames: Vec<FrameEstimate>,
    with_ball: usize,
}

type Outcome<T> = std::result::Result<T, CalibrationRejection>;

impl<'a> Rounds<'a> {
    pub fn new(
        nominal: &'a Pattern,
        frames: &[FrameEstimate],
        times_s: Option<&'a [f64]>,
        config: &'a CalibrationConfig,
    ) -> Self {
        let sigma_rad = config.placement_sigma_rad;
        let candidates = nominal.dots().iter();
        let candidates = candidates.map(|direction| ClipDot::of_pattern(direction, sigma_rad));
        Self {
            nominal,
            times_s,
            config,
            candidates: candidates.collect(),
            names: (0..nominal.len()).collect(),
            with_ball: frames.iter().filter(|f| f.outline.is_some()).count(),
            frames: frames.to_vec(),
        }
    }

    pub fn run(mut self) -> Result<Outcome<Calibration>> {
        if let Err(rejection) = self.check_frames() {
            let is_unknown = matches!(rejection, CalibrationRejection::OtherBall { .. });
            if !(is_unknown && self.identify_wider()?) {
                return Ok(Err(rejection));
            }
        }
        let mut round = 1;
        loop {
            let before: Vec<(Vec3, bool)> = self.state().collect();
            let is_last = round == self.config.rounds;
            let (summary, marks, rate) = match self.round(is_last) {
                Ok(done) => done,
                Err(rejection) => return Ok(Err(rejection)),
            };
            let settled = before.len() == self.candidates.len()
                && before
                    .iter()
                    .zip(self.state())
                    .all(|(a, b)| a.1 == b.1 && angle_between(&a.0, &b.0) < SETTLED_RAD);
            if settled || is_last {
                return Ok(self.finish(&summary, &marks, &rate));
            }
            self.identify_again(&summary)?;
            if let Err(rejection) = self.check_frames() {
                return Ok(Err(rejection));
            }
            round += 1;
        }
    }

    fn state(&self) -> impl Iterator<Item = (Vec3, bool)> + '_ {
        self.candidates.iter().map(|c| (c.direction, c.is_active()))
    }

    /// Whether a frame's orientation is beyond doubt.
    fn is_trusted(&self, frame: &FrameEstimate) -> bool {
        frame.matched() >= MIN_MATCHED
            && frame
                .pose()
                .is_some_and(|p| p.confidence >= self.config.trusted)
    }

    fn check_frames(&self) -> Outcome<()> {
        let CalibrationConfig {
            min_frames,
            min_identified,
            ..
        } = *self.config;
        let balls = self.with_ball;
        if balls == 0 {
            let frames = self.frames.len();
            return Err(CalibrationRejection::NoBall { frames });
        }
        if balls < min_frames {
            let (found, needed) = (balls, min_frames);
            return Err(CalibrationRejection::TooFewFrames { found, needed });
        }
        let identified = self.frames.iter().filter(|f| self.is_trusted(f)).count();
        if identified < min_frames || (identified as f64) < min_identified * balls as f64 {
            return Err(CalibrationRejection::OtherBall { identified, balls });
        }
        Ok(())
    }

    /// A fit, and what it says of each dot and of the marks.
    fn round(&mut self, is_last: bool) -> Outcome<(FitSummary, Vec<FoundMark>, DetectionRate)> {
        let (fits, summary, mut fitted) = self.fit().ok_or(CalibrationRejection::Singular)?;
        self.take_fits(&fits, &summary.sightings);
        fitted.sort_by_key(|f| f.index);
        let strays = self.strays(&fitted);
        let marks = self.marks(&fitted, &strays);
        self.take_displaced(&marks);
        let finds = self.finds(&fitted, &strays);
        let directions: Vec<Vec3> = self.candidates.iter().map(|c| c.direction).collect();
        let (records, rate) = find_records(&fitted, &directions, &finds);
        let named = self.candidates.iter().filter(|c| c.named);
        let limit = doubtful_limit(named.map(|c| c.likeness));
        let drawing_sigma = self.drawing_sigma();
        for (candidate, record) in self.candidates.iter_mut().zip(records) {
            let looks = Looks {
                is_found: candidate.views > 0,
                likeness: candidate.likeness,
                limit,
                offset: candidate.offset() / drawing_sigma,
                expected_nominal: rate.expected(&fitted, &candidate.prior.direction),
            };
            candidate.judge(record, &looks);
        }
        self.check_dots()?;
        // What is taken in must take part in a fit.
        let marks = self.learn(marks, self.config.learn_extra && !is_last);
        Ok((summary, marks, rate))
    }

    /// The dots of a fit, with the error that their views share: see
    /// [`CalibrationConfig::shared_sigma_rad`].
    fn take_fits(&mut self, fits: &[DotFit], sightings: &[MeanDetection]) {
        let seen = || fits.iter().zip(sightings).filter(|(fit, _)| fit.views > 0);
        let typical = |value: &dyn Fn(&MeanDetection) -> f64| {
            median(&mut seen().map(|(_, s)| value(s)).collect::<Vec<_>>())
        };
        let usual = MeanDetection {
            probability: typical(&|s| s.probability),
            variance: typical(&|s| s.variance),
        };
        let shared = self.config.shared_sigma_rad.powi(2);
        for ((candidate, fit), seen) in self.candidates.iter_mut().zip(fits).zip(sightings) {
            candidate.direction = fit.direction;
            candidate.views = fit.views;
            candidate.named = fit.views > 0;
            candidate.covariance = fit.covariance;
            candidate.likeness = 1.0;
            if candidate.named {
                let unclear = (seen.variance / usual.variance).max(1.0).powi(2);
                candidate.covariance += Matrix2::identity() * (shared * unclear);
                candidate.likeness = seen.probability / usual.probability;
            }
        }
    }

    /// Too many dots missing are another ball's.
    fn check_dots(&self) -> Outcome<()> {
        let designed = self.candidates.iter().filter(|c| c.mark.is_none());
        let in_view = designed.filter(|c| c.record.expected >= MIN_EXPECTED_VIEWS);
        let (expected, missing) = in_view.fold((0, 0), |(all, missing), c| {
            (all + 1, missing + usize::from(!c.is_active()))
        });
        if missing as f64 > MAX_MISSING * expected as f64 {
            return Err(CalibrationRejection::Contradiction { missing, expected });
        }
        Ok(())
    }

    fn fit(&self) -> Option<(Vec<DotFit>, FitSummary, Vec<FittedFrame>)> {
        let mut frames = Vec::new();
        let mut fitted = Vec::new();
        let mut sightings = vec![MeanDetection::default(); self.candidates.len()];
        for (k, frame) in self.frames.iter().enumerate() {
            if !self.is_trusted(frame) {
                continue;
            }
            let (Some(pose), Some(circle), Some(outline)) =
                (frame.pose(), frame.circle, frame.outline)
            else {
                continue;
            };
            let mut observations = Vec::new();
            for (dot, name) in frame.dots.iter().zip(&frame.assignment) {
                let Some(name) = name else { continue };
                let j = self.names[usize::from(*name)];
                sightings[j].probability += dot.probability;
                sightings[j].variance += 0.5 * dot.covariance.trace() / circle.radius.powi(2);
                observations.push(Observation {
                    dot: j,
                    pixel: dot.pixel,
                    covariance: dot.covariance,
                });
            }
            fitted.extend(FittedFrame::new(k, frame, &self.config.estimator.camera));
            frames.push(BundleFrame {
                time_s: self.times_s.map(|t| t[k]),
                rotation: pose.rotation,
                circle,
                outline,
                axis: frame.axis,
                observations,
            });
        }
        let priors = self.candidates.iter().map(|c| c.prior).collect();
        let mut bundle = Bundle::new(priors, frames, &self.config.estimator.camera);
        bundle.fit(self.config.smooth);
        let views = bundle.views();
        let variance: f64 = sightings.iter().map(|s| s.variance).sum();
        let count = views.iter().sum::<usize>().max(1);
        for (seen, views) in sightings.iter_mut().zip(views) {
            let views = views.max(1) as f64;
            seen.probability /= views;
            seen.variance /= views;
        }
        let summary = FitSummary {
            noise_scale: bundle.noise_scale(),
            smooth: bundle.is_smooth(),
            inverse_distance: bundle.inverse_distance(),
            axis_rad: bundle.axis_rad(),
            outline_shift: bundle.outline_shift(),
            detection_variance: variance / count as f64,
            sightings,
        };
        for (frame, fit) in fitted.iter_mut().zip(&bundle.frames) {
            frame.turn_to(&fit.rotation);
        }
        Some((bundle.dot_fits()?, summary, fitted))
    }

    /// The directions (pattern frame) of the unnamed detections of each fitted frame.
    fn strays(&self, fitted: &[FittedFrame]) -> Vec<Vec<Vec3>> {
        let of = |f: &FittedFrame| f.unnamed(&self.frames[f.index]).map(|s| s.1).collect();
        fitted.iter().map(of).collect()
    }

    /// The candidates found in each fitted frame: by name, or, of those that no frame names, by an
    /// unnamed detection in their place.
    fn finds(&self, fitted: &[FittedFrame], strays: &[Vec<Vec3>]) -> Vec<Vec<usize>> {
        let of_frame = |(f, strays): (&FittedFrame, &Vec<Vec3>)| {
            let named = self.frames[f.index].assignment.iter().flatten();
            let mut found: Vec<usize> = named.map(|j| self.names[usize::from(*j)]).collect();
            for (j, candidate) in self.candidates.iter().enumerate() {
                let is_at = |s: &Vec3| angle_between(s, &candidate.direction) < FIND_RAD;
                if !candidate.named && strays.iter().any(is_at) {
                    found.push(j);
                }
            }
            found
        };
        fitted.iter().zip(strays).map(of_frame).collect()
    }

    /// Steady marks beside the dots.
    fn marks(&self, fitted: &[FittedFrame], strays: &[Vec<Vec3>]) -> Vec<FoundMark> {
        let mut marks = steady_marks(fitted, strays);
        marks.retain(|m| {
            let dots = self
                .candidates
                .iter()
                .filter(|c| c.is_active() && c.views > 0);
            dots.map(|c| angle_between(&c.direction, &m.direction))
                .all(|angle| angle > SAME_RAD)
        });
        marks
    }

    /// A dot that no frame has by name, and a mark near its place: the dot was drawn there.
    fn take_displaced(&mut self, marks: &[FoundMark]) {
        let max_offset =
            (DISPLACED * self.drawing_sigma()).clamp(SAME_RAD, self.config.max_offset_rad);
        for mark in marks {
            let near = |c: &ClipDot| angle_between(&c.prior.direction, &mark.direction);
            let unfound = self
                .candidates
                .iter_mut()
                .filter(|c| c.mark.is_none() && c.views == 0 && near(c) < max_offset)
                .filter(|c| {
                    let is_rejected = |at| angle_between(&at, &mark.direction) < SAME_RAD;
                    !c.rejected.is_some_and(is_rejected)
                });
            if let Some(dot) = unfound.min_by(|a, b| near(a).total_cmp(&near(b))) {
                dot.direction = mark.direction;
                // So that another mark does not take it as well.
                dot.views = mark.found;
            }
        }
    }

    /// How far off the dots are drawn, standard deviation per axis.
    fn drawing_sigma(&self) -> f64 {
        let measured = self
            .candidates
            .iter()
            .filter(|c| c.mark.is_none() && c.views > 0);
        drawing_sigma_rad(measured.map(ClipDot::offset))
    }

    /// Takes marks in where `take_in` says so; the marks that are left.
    fn learn(&mut self, mut marks: Vec<FoundMark>, take_in: bool) -> Vec<FoundMark> {
        marks.retain(|m| {
            let mut dots = self.candidates.iter().filter(|c| c.is_active());
            dots.all(|c| angle_between(&c.direction, &m.direction) > SAME_RAD)
        });
        if !take_in {
            return marks;
        }
        for mark in &marks {
            if self.candidates.len() < MAX_DOTS {
                let dot = ClipDot::of_mark(mark, self.config.placement_sigma_rad);
                self.candidates.push(dot);
            }
        }
        Vec::new()
    }

    /// Identifies all frames anew, with dots that may be drawn farther off than the estimator supposes; whether
    /// enough are then beyond doubt.
    fn identify_wider(&mut self) -> Result<bool> {
        let ball = Ball::new(self.nominal.clone());
        let detected = self.frames.clone();
        for factor in WIDER {
            let mut estimator = self.config.estimator;
            estimator.placement_sigma_rad *= factor;
            estimator.trust = TrustMap::WIDE;
            self.frames = identify_frames(&ball, &estimator, &detected)?;
            if self.check_frames().is_ok() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Identifies all frames with the dots as they are known now.
    fn identify_again(&mut self, summary: &FitSummary) -> Result<()> {
        let active = self
            .candidates
            .iter()
            .enumerate()
            .filter(|(_, c)| c.is_active());
        let (names, dots): (Vec<usize>, Vec<Vec3>) = active.map(|(j, c)| (j, c.direction)).unzip();
        // What the detector does not state counts as placement.
        let unstated = (summary.noise_scale.powi(2) - 1.0).max(0.0) * summary.detection_variance;
        let covariances = names.iter().map(|&j| {
            let c = &self.candidates[j];
            in_space(
                &c.direction,
                &(c.covariance + Matrix2::identity() * unstated),
            )
        });
        let record = CalibrationRecord {
            nominal_sha256: None,
            nominal_numbers: names.iter().map(|&j| Some(j as u16)).collect(),
            views: names
                .iter()
                .map(|&j| self.candidates[j].views as u32)
                .collect(),
        };
        let ball =
            Ball::new(Pattern::new(dots)?).with_calibration(covariances.collect(), record)?;
        // What all outlines are off the fit knows, and no single frame does.
        for outline in self.frames.iter_mut().filter_map(|f| f.outline.as_mut()) {
            outline.circle = outline.circle.shifted(&summary.outline_shift);
        }
        self.frames = identify_frames(&ball, &self.config.estimator, &self.frames)?;
        self.names = names;
        Ok(())
    }

    fn finish(
        mut self,
        summary: &FitSummary,
        marks: &[FoundMark],
        rate: &DetectionRate,
    ) -> Outcome<Calibration> {
        self.check_dots()?;
        let fitted = self.frames.iter().filter(|f| self.is_trusted(f)).count();
        let designed = self.candidates.iter().take(self.nominal.len());
        let dots = designed
            .map(|c| c.calibrated(self.config.placement_sigma_rad))
            .collect();
        let learned = self.candidates[self.nominal.len()..]
            .iter()
            .filter_map(|c| {
                let mark = c.mark.filter(|_| c.is_active())?;
                Some(SteadyMark {
                    direction: c.direction,
                    covariance: Some(c.covariance),
                    found: mark.found,
                    views: mark.views,
                })
            });
        let noted = marks.iter().map(|m| SteadyMark {
            direction: m.direction,
            covariance: None,
            found: m.found,
            views: m.views,
        });
        let marks: Vec<SteadyMark> = learned.chain(noted).collect();
        self.rename();
        Ok(Calibration {
            dots,
            marks,
            with_ball: self.with_ball,
            fitted,
            with_rivals: self
                .frames
                .iter()
                .filter(|f| f.fit.is_some_and(|fit| fit.rivals > 0))
                .count(),
            frames: self.frames,
            noise_scale: summary.noise_scale,
            smooth: summary.smooth,
            inverse_distance: summary.inverse_distance,
            axis_rad: summary.axis_rad,
            detection_rate: rate.mean(),
        })
    }

    /// Gives the frames' detections the numbers of the calibrated pattern.
    fn rename(&mut self) {
        let mut numbers = vec![None; self.candidates.len()];
        let active = self
            .candidates
            .iter()
            .enumerate()
            .filter(|(_, c)| c.is_active());
        for (number, (j, _)) in active.enumerate() {
            numbers[j] = Some(number as u16);
        }
        for name in self.frames.iter_mut().flat_map(|f| &mut f.assignment) {
            *name = name.and_then(|j| numbers[self.names[usize::from(j)]]);
        }
    }
}
