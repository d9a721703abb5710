//! What the frames of a clip say of each other, after each was estimated alone.

use super::ball_tracks::{missing_balls, number_balls};
use super::balls::{BallEstimate, BallsEstimator, sort_from_left};
use super::batch::{BatchFrame, SequenceOutcome};
use super::outlines;
use super::rolling::seen_times;
use super::run::Pass;
use super::sequence::{SequenceConfig, SequenceSummary, estimate_spin, second_pass};
use super::times::TimeSource;
use super::work::{Work, Worker};
use crate::error::Result;
use crate::image::ImageView;
use crate::source::files::Source;
use crate::vision::frame::estimate::FrameEstimate;
use crate::vision::optics::camera::BallCircle;
use crate::vision::outline::find::OutlineFinder;

/// Why frames are no sequence.
enum NoSequence {
    NoTimes,
    NotIncreasing,
}

impl From<NoSequence> for SequenceOutcome {
    fn from(why: NoSequence) -> Self {
        match why {
            NoSequence::NoTimes => Self::NoTimes,
            NoSequence::NotIncreasing => Self::TimesNotIncreasing,
        }
    }
}

/// The times of frames that may be a sequence, or why they are none.
fn ordered_times(frames: &[BatchFrame]) -> std::result::Result<Vec<f64>, NoSequence> {
    let times = frames.iter().map(|f| f.first_row_s.or(f.time_s));
    let times: Option<Vec<f64>> = times.collect();
    match times.filter(|t| t.len() > 1) {
        None => Err(NoSequence::NoTimes),
        Some(times) if times.windows(2).all(|w| w[0] < w[1]) => Ok(times),
        Some(_) => Err(NoSequence::NotIncreasing),
    }
}

impl Pass<'_> {
    /// What the frames are together.
    pub(super) fn together(
        &self,
        sources: &[(Source, usize)],
        times: &TimeSource,
        frames: &mut [BatchFrame],
    ) -> Result<SequenceOutcome> {
        let independent = self.config.independent;
        match self.work {
            Work::Balls(balls, strobe) => {
                let outcome = match (independent || strobe.is_some(), ordered_times(frames)) {
                    (true, _) => SequenceOutcome::Apart,
                    (false, Err(why)) => why.into(),
                    (false, Ok(times_s)) => {
                        self.find_missing(balls, sources, &times_s, frames)?;
                        self.number(times, &times_s, frames)
                    }
                };
                if !matches!(outcome, SequenceOutcome::Numbered(_)) {
                    frames.iter_mut().for_each(|f| sort_from_left(&mut f.balls));
                }
                return Ok(outcome);
            }
            Work::Outlines(finder) if !independent => {
                self.settle_outlines(finder, sources, frames)?;
            }
            Work::Outlines(_) | Work::Poses(_) => {}
        }
        self.as_sequence(sources, frames)
    }

    /// The second pass over frames of one ball that were each estimated alone, and their spin.
    pub(super) fn as_sequence(
        &self,
        sources: &[(Source, usize)],
        frames: &mut [BatchFrame],
    ) -> Result<SequenceOutcome> {
        let times = match ordered_times(frames) {
            Ok(times) => times,
            Err(why) => return Ok(why.into()),
        };
        let estimates = frames.iter_mut().map(BatchFrame::take_estimate);
        let mut estimates: Vec<FrameEstimate> = estimates.collect();
        self.config.check_readout(&times)?;
        let config = &SequenceConfig {
            row_s: self.config.row_s(frames),
            ..self.config.sequence
        };
        let passed: Result<SequenceSummary> = match self.work {
            Work::Poses(tables) if !self.config.independent => {
                let estimator = &tables[self.table];
                second_pass(estimator, config, &times, &mut estimates, |wanted, work| {
                    let again =
                        |k: usize, image: ImageView<'_>, worker: &mut Worker<'_>| match worker {
                            Worker::Pose(_, table, ws) => {
                                Some(vec![BallEstimate::of(work(k, image, ws)?, *table)])
                            }
                            _ => None,
                        };
                    let found = self.on_pictures(sources, wanted, &again)?;
                    let one = |(k, balls): (usize, Vec<BallEstimate>)| {
                        Some((k, balls.into_iter().next()?.frame))
                    };
                    Ok(found.into_iter().filter_map(one).collect())
                })
            }
            _ => {
                let posed = estimates.iter().filter(|f| f.pose().is_some()).count();
                Ok(SequenceSummary {
                    alone: posed,
                    together: posed,
                })
            }
        };
        let seen_s = seen_times(config.row_s, &times, &estimates);
        let spin = estimate_spin(config, &seen_s, &estimates);
        for (frame, estimate) in frames.iter_mut().zip(estimates) {
            frame.set_estimate(estimate);
        }
        if config.row_s > 0.0 {
            for (frame, (first_row_s, seen_s)) in frames.iter_mut().zip(times.iter().zip(seen_s)) {
                (frame.first_row_s, frame.time_s) = (Some(*first_row_s), Some(seen_s));
            }
        }
        Ok(SequenceOutcome::Estimated {
            summary: passed?,
            spin,
        })
    }

    /// Looks again for outlines that lie off the path of the others.
    fn settle_outlines(
        &self,
        finder: &OutlineFinder,
        sources: &[(Source, usize)],
        frames: &mut [BatchFrame],
    ) -> Result<()> {
        let times: Option<Vec<f64>> = frames.iter().map(|f| f.time_s).collect();
        let ascend = |times: &Vec<f64>| times.windows(2).all(|w| w[0] < w[1]);
        let numbers = || (0..frames.len()).map(|k| k as f64).collect();
        let times = times.filter(ascend).unwrap_or_else(numbers);
        for _ in 0..outlines::ROUNDS {
            let estimates = frames.iter_mut().map(BatchFrame::take_estimate);
            let estimates: Vec<FrameEstimate> = estimates.collect();
            let is_given = |k: usize| estimates[k].outline.is_some_and(|o| o.is_given());
            let doubts = outlines::off_the_path(&times, &estimates);
            let doubts: Vec<_> = doubts.into_iter().filter(|d| !is_given(d.0)).collect();
            for (frame, estimate) in frames.iter_mut().zip(estimates) {
                frame.set_estimate(estimate);
            }
            let wanted: Vec<usize> = doubts.iter().map(|d| d.0).collect();
            let again = |k: usize, image: ImageView<'_>, worker: &mut Worker<'_>| {
                let expected = &doubts[wanted.binary_search(&k).ok()?].1;
                let Worker::Outline(_, ws) = worker else {
                    return None;
                };
                let mut found = FrameEstimate::default();
                finder.find(image, &outlines::near(expected), ws, &mut found);
                let is_settled = outlines::is_settled(&mut found, expected);
                is_settled.then(|| vec![BallEstimate::of(found, 0)])
            };
            let settled = self.on_pictures(sources, &wanted, &again)?;
            if settled.is_empty() {
                break;
            }
            for (k, found) in settled {
                frames[k].balls = found;
            }
        }
        Ok(())
    }

    /// Looks for balls that are missing within a sequence.
    fn find_missing(
        &self,
        estimator: &BallsEstimator,
        sources: &[(Source, usize)],
        times_s: &[f64],
        frames: &mut [BatchFrame],
    ) -> Result<()> {
        let before = frames.iter_mut().map(|f| std::mem::take(&mut f.balls));
        let balls: Vec<Vec<BallEstimate>> = before.collect();
        let missing = missing_balls(self.config.sequence.spin, times_s, &balls);
        let numbered = missing.iter().enumerate();
        let wanted: Vec<usize> = numbered
            .filter(|(_, circles)| !circles.is_empty())
            .map(|(k, _)| k)
            .collect();
        let again = |k: usize, image: ImageView<'_>, worker: &mut Worker<'_>| {
            let Worker::Balls(_, _, ws) = worker else {
                return None;
            };
            let mut expected = missing[k].clone();
            if let Some(roi) = &self.config.roi {
                let region = roi.within(image.width(), image.height()).ok()?;
                let within = |x: f64, from: usize, size: usize| {
                    (from as f64..(from + size) as f64).contains(&x)
                };
                expected.retain(|BallCircle { center, .. }| {
                    within(center.u, region.left, region.width)
                        && within(center.v, region.top, region.height)
                });
            }
            let (before, budget) = (balls[k].clone(), &self.config.budget);
            Some(estimator.look_again(image, before, &expected, budget, ws))
        };
        let changed = self.on_pictures(sources, &wanted, &again)?;
        for (frame, balls) in frames.iter_mut().zip(balls) {
            frame.balls = balls;
        }
        for (k, balls) in changed {
            frames[k].balls = balls;
        }
        Ok(())
    }

    /// Numbers the balls of a sequence.
    fn number(
        &self,
        times: &TimeSource,
        times_s: &[f64],
        frames: &mut [BatchFrame],
    ) -> SequenceOutcome {
        let spin = times.of_spin(self.config.sequence.spin);
        let taken = frames.iter_mut().map(|f| {
            sort_from_left(&mut f.balls);
            std::mem::take(&mut f.balls)
        });
        let mut balls: Vec<Vec<BallEstimate>> = taken.collect();
        let numbered = number_balls(spin, times_s, &mut balls);
        for (frame, balls) in frames.iter_mut().zip(balls) {
            frame.balls = balls;
        }
        SequenceOutcome::Numbered(numbered)
    }
}
