//! The [verdict](super::verdict) on a clip's frames: do they show a ball of these tables, which one, and in a mirror?
//!
//! A clip of one ball is one set of frames. Of several balls each number is one, since each ball carries a table of its own; the images
//! of exposures are one, and so are frames without numbers, each with the ball that says most. A ball that none of the tables fits keeps
//! no pose. The camera is the same for all: the images are mirrored where that is so of one ball and no other is seen directly.
//!
//! Of several balls one whose poses leave no doubt is not weighed in a mirror: each frame's recognizer has done so.
//!
//! Guarantees: tables and mirror images are judged by the same frames, at most [`MAX_FRAMES`] of a ball, spread over the clip; with fewer than
//! [`MIN_FRAMES`] that say anything nothing is taken back.

use std::borrow::Cow;

use super::balls::BallEstimate;
use super::batch::{Batch, BatchFrame, SequenceOutcome};
use super::config::BatchConfig;
use super::verdict::{BallHypothesis, FrameScore, MIN_FRAMES, Scorer, Verdict, decide, mirrored};
use super::work::Work;
use crate::concurrency;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::spin::Measurement;
use crate::spin::robust::{RobustEstimator, SpinConfig};
use crate::vision::estimator::Estimator;
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection, MIRRORED};

/// Frames that have a say, spread over the clip.
const MAX_FRAMES: usize = 64;
/// Frames that one task scores.
const CHUNK: usize = 4;
/// Frames, spread over the clip, after which it is asked whether they are enough.
const ROUND: usize = 16;
/// They are where one hypothesis leads all others and "none of them" by this, ln of the odds: far beyond what a verdict needs
/// ([`decide`]), since frames of one part of a clip are alike.
pub(super) const SURE: f64 = 30.0;
/// Cosine of the angle between two lines of sight, in the ball's frame, from which on more than half of the dots that are seen are others.
const OTHER_SIDE: f64 = 0.5;

/// What all frames together say.
#[derive(Debug, Clone)]
pub struct Judgment {
    /// The verdict; of several balls on the one that decides.
    pub verdict: Verdict,
    /// What was weighed: each table, directly and in a mirror. None where no verdict was asked for.
    pub hypotheses: Vec<BallHypothesis>,
    /// Of one ball the table in use.
    pub table: usize,
}

impl Default for Judgment {
    /// No verdict was asked for.
    fn default() -> Self {
        Self {
            verdict: Verdict::Open,
            hypotheses: Vec::new(),
            table: 0,
        }
    }
}

/// A frame's time, where it has one, and what is seen in it of a ball.
type SeenBall<'a> = (Option<f64>, &'a FrameEstimate);

/// A table, seen directly or in a mirror.
pub(super) struct TableCandidate<'a> {
    estimator: Cow<'a, Estimator>,
    table: usize,
    is_mirrored: bool,
}

impl<'a> TableCandidate<'a> {
    /// Each table directly, and in a mirror.
    pub fn of_tables(tables: &'a [Estimator]) -> Result<Vec<Self>> {
        let mut all = Vec::with_capacity(2 * tables.len());
        for (table, estimator) in tables.iter().enumerate() {
            let mirrored = mirrored(estimator)?;
            let both = [Cow::Borrowed(estimator), Cow::Owned(mirrored)];
            for (estimator, is_mirrored) in both.into_iter().zip([false, true]) {
                all.push(Self {
                    estimator,
                    table,
                    is_mirrored,
                });
            }
        }
        Ok(all)
    }

    /// What frames say of it: their scores, and their orientations where they have one and a time.
    fn scores(&self, seen: &[SeenBall<'_>]) -> Result<(Vec<FrameScore>, Vec<Measurement>)> {
        let chunks: Vec<&[SeenBall<'_>]> = seen.chunks(CHUNK).collect();
        let scored = concurrency::map(&chunks, |chunk| -> Result<Vec<_>> {
            let mut scorer = Scorer::new(&*self.estimator)?;
            let one = |(time_s, estimate): &SeenBall<'_>| {
                let mut estimate = FrameEstimate::clone(estimate);
                let score = scorer.identify(&mut estimate);
                let pose = time_s.zip(estimate.pose());
                let measured = pose.map(|(time_s, pose)| Measurement {
                    confidence: pose.confidence,
                    ..Measurement::new(time_s, pose.rotation)
                });
                (score, measured)
            };
            Ok(chunk.iter().map(one).collect())
        });
        let scored: Result<Vec<Vec<_>>> = scored.into_iter().collect();
        let (scores, measured): (Vec<_>, Vec<_>) = scored?.into_iter().flatten().unzip();
        Ok((scores, measured.into_iter().flatten().collect()))
    }

    /// Nothing was seen yet.
    pub fn unseen(&self) -> BallHypothesis {
        BallHypothesis::unseen(self.table, self.is_mirrored)
    }

    /// Adds what frames of no known times say.
    pub fn learn(&self, hypothesis: &mut BallHypothesis, seen: &[FrameEstimate]) -> Result<()> {
        let seen: Vec<SeenBall<'_>> = seen.iter().map(|estimate| (None, estimate)).collect();
        hypothesis.frames.extend(self.scores(&seen)?.0);
        Ok(())
    }
}

impl Judgment {
    /// Judges a clip, one ball's by the table in use. Balls that none of the tables fits, and all where the images are mirrored, keep no
    /// pose.
    pub(super) fn of_clip(
        work: &Work<'_>,
        table: usize,
        config: &BatchConfig,
        batch: &mut Batch,
    ) -> Result<Self> {
        let (tables, spin) = (work.tables(), config.sequence.spin);
        match work {
            Work::Outlines(_) => Ok(Self::default()),
            Work::Poses(_) => {
                let all = batch.frames.iter();
                let seen: Vec<SeenBall<'_>> = all.map(|f| (f.time_s, f.estimate())).collect();
                let mut this = Self::of(&TableCandidate::of_tables(tables)?, &seen, spin)?;
                // Too little to choose: the table in use stands.
                this.table = this.fitting().unwrap_or(table);
                if let Some(why) = this.rejection() {
                    batch.frames.iter_mut().for_each(|frame| frame.reject(why));
                }
                Ok(this)
            }
            Work::Balls(_, strobe) => Self::of_balls(tables, strobe.is_some(), spin, batch),
        }
    }

    /// Judges what is seen of one ball, by no more frames than it takes.
    fn of(
        candidates: &[TableCandidate<'_>],
        seen: &[SeenBall<'_>],
        spin: SpinConfig,
    ) -> Result<Self> {
        let stride = seen.len().div_ceil(MAX_FRAMES).max(1);
        let chosen: Vec<SeenBall<'_>> = seen.iter().step_by(stride).copied().collect();
        let rounds = chosen.len().div_ceil(ROUND).max(1);
        let mut fitter = RobustEstimator::new(spin);
        let mut hypotheses: Vec<BallHypothesis> = candidates.iter().map(|c| c.unseen()).collect();
        let mut measured: Vec<Vec<Measurement>> = vec![Vec::new(); candidates.len()];
        let mut verdict = Verdict::Open;
        for round in 0..rounds {
            let spread = chosen.iter().skip(round).step_by(rounds);
            let spread: Vec<SeenBall<'_>> = spread.copied().collect();
            let learned = hypotheses.iter_mut().zip(&mut measured);
            for (candidate, (hypothesis, measured)) in candidates.iter().zip(learned) {
                let (scores, poses) = candidate.scores(&spread)?;
                hypothesis.frames.extend(scores);
                measured.extend(poses);
                measured.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
                hypothesis.has_common_motion = share_a_motion(&mut fitter, measured);
            }
            verdict = decide(&hypotheses);
            let is_sure = matches!(
                verdict,
                Verdict::Fits { ln_lead, ln_evidence, .. } if ln_lead.min(ln_evidence) >= SURE
            );
            if is_sure {
                break;
            }
        }
        Ok(Self {
            verdict,
            hypotheses,
            table: 0,
        })
    }

    /// The ball as it was estimated, where its poses alone show that its table fits: `None` where they leave that open.
    fn evident(tables: &[Estimator], balls: &[&BallEstimate]) -> Result<Option<Self>> {
        let mut posed = balls.iter().filter(|b| b.frame.pose().is_some());
        let Some(table) = posed.next().map(|ball| ball.table) else {
            return Ok(None);
        };
        let mut scorer = Scorer::new(&tables[table])?;
        let stride = balls.len().div_ceil(MAX_FRAMES).max(1);
        let own_balls = balls.iter().step_by(stride).filter(|b| b.table == table);
        let hypothesis = BallHypothesis {
            frames: own_balls.map(|b| scorer.score(&b.frame)).collect(),
            ..BallHypothesis::unseen(table, false)
        };
        let ln_evidence = hypothesis.ln_evidence();
        Ok((ln_evidence >= SURE).then(|| Self {
            verdict: Verdict::Fits {
                hypothesis: 0,
                ln_lead: f64::INFINITY,
                ln_evidence,
            },
            hypotheses: vec![hypothesis],
            table: 0,
        }))
    }

    /// Judges the balls of frames that show several, or several images of one.
    fn of_balls(
        tables: &[Estimator],
        is_strobed: bool,
        spin: SpinConfig,
        batch: &mut Batch,
    ) -> Result<Self> {
        let places = match &batch.sequence {
            SequenceOutcome::Numbered(numbered) => of_numbers(&numbered.numbers),
            _ => vec![unnumbered(&batch.frames, is_strobed)],
        };
        let (mut all, mut candidates) = (Vec::new(), Vec::new());
        for places in places.iter().filter(|places| places.len() >= MIN_FRAMES) {
            let seen = places.iter().map(|(frame, ball)| {
                let frame = &batch.frames[*frame];
                let time_s = frame.time_s.filter(|_| !is_strobed);
                (time_s, &frame.balls[*ball])
            });
            let (times, balls): (Vec<_>, Vec<_>) = seen.unzip();
            let judgment = match Self::evident(tables, &balls)? {
                Some(judgment) => judgment,
                None => {
                    if candidates.is_empty() {
                        candidates = TableCandidate::of_tables(tables)?;
                    }
                    let seen = times.into_iter().zip(balls.iter().map(|b| &b.frame));
                    Self::of(&candidates, &seen.collect::<Vec<_>>(), spin)?
                }
            };
            all.push((places, judgment));
        }
        let is_direct = all.iter().any(|(_, ball)| ball.fitting().is_some());
        let mirrored = all.iter().find(|(_, ball)| ball.is_mirrored());
        if let Some((_, decisive)) = mirrored.filter(|_| !is_direct) {
            batch.frames.iter_mut().for_each(|f| f.reject(MIRRORED));
            return Ok(decisive.clone());
        }
        for (places, ball) in &all {
            if matches!(ball.verdict, Verdict::None { .. }) {
                for (frame, ball) in places.iter() {
                    batch.frames[*frame].balls[*ball].reject(FrameRejection::Foreign);
                }
            }
        }
        let weight = |ball: &Self| match ball.verdict {
            Verdict::Open => 0,
            Verdict::None { .. } => 1,
            Verdict::Tied { .. } => 2,
            Verdict::Fits { .. } => 3,
        };
        let decisive = all
            .into_iter()
            .map(|(_, ball)| ball)
            .rev()
            .max_by_key(weight);
        Ok(decisive.unwrap_or_default())
    }

    /// The verdict in a word: fits, mirrored, tied, none or open.
    pub fn as_str(&self) -> &'static str {
        match self.verdict {
            Verdict::Open => "open",
            Verdict::None { .. } => "none",
            Verdict::Tied { .. } => "tied",
            Verdict::Fits { .. } if self.is_mirrored() => "mirrored",
            Verdict::Fits { .. } => "fits",
        }
    }

    /// Lead of the verdict over the next best, ln of the odds, where it has one that is finite.
    pub fn ln_odds(&self) -> Option<f64> {
        match self.verdict {
            Verdict::Fits { ln_lead, .. } | Verdict::Tied { ln_lead, .. } => Some(ln_lead),
            Verdict::Open | Verdict::None { .. } => None,
        }
        .filter(|lead| lead.is_finite())
    }

    /// Whether the images are mirrored.
    pub fn is_mirrored(&self) -> bool {
        match self.verdict {
            Verdict::Fits { hypothesis, .. } => self.hypotheses[hypothesis].is_mirrored,
            _ => false,
        }
    }

    /// The table that fits, seen directly. A pattern that is its own mirror image is seen directly: that is what people do.
    fn fitting(&self) -> Option<usize> {
        let table = |hypothesis: usize| self.hypotheses[hypothesis].table;
        match self.verdict {
            Verdict::Fits { hypothesis, .. } if !self.is_mirrored() => Some(table(hypothesis)),
            Verdict::Tied {
                hypotheses: [a, b], ..
            } if table(a) == table(b) => Some(table(a)),
            _ => None,
        }
    }

    /// Why no frame of one ball keeps its pose, where none does.
    pub fn rejection(&self) -> Option<FrameRejection> {
        match self.verdict {
            Verdict::Open => None,
            _ if self.is_mirrored() => Some(MIRRORED),
            _ if self.fitting().is_some() => None,
            _ => Some(FrameRejection::Foreign),
        }
    }
}

/// Whether most of these poses follow one motion, and some of those show another side of the ball.
///
/// Poses of one side are no witnesses of each other: what looks like the dots by accident does so as long as it is seen, and turns with the
/// ball.
fn share_a_motion(fitter: &mut RobustEstimator, poses: &[Measurement]) -> bool {
    let Ok(fit) = fitter.fit(poses) else {
        return false;
    };
    let followed = poses.iter().zip(fitter.inlier_probabilities());
    let sides: Vec<Vec3> = followed
        .filter(|(_, follows)| **follows > 0.5)
        .map(|(pose, _)| pose.orientation.inverse() * Vec3::z())
        .collect();
    let is_spread = |(k, a): (usize, &Vec3)| sides[k + 1..].iter().any(|b| a.dot(b) < OTHER_SIDE);
    2 * fit.inliers > poses.len() && sides.iter().enumerate().any(is_spread)
}

/// The frame and the number in it of each ball of a set.
type BallPlaces = Vec<(usize, usize)>;

/// The balls of each number.
fn of_numbers(numbers: &[Vec<Option<usize>>]) -> Vec<BallPlaces> {
    let count = numbers
        .iter()
        .flatten()
        .flatten()
        .max()
        .map_or(0, |n| n + 1);
    let mut sets = vec![Vec::new(); count];
    for (frame, numbers) in numbers.iter().enumerate() {
        for (ball, number) in numbers.iter().enumerate() {
            if let Some(number) = number {
                sets[*number].push((frame, ball));
            }
        }
    }
    sets
}

/// All images of exposures; of frames whose balls have no numbers the ball that says most.
fn unnumbered(frames: &[BatchFrame], is_strobed: bool) -> BallPlaces {
    let mut places = Vec::new();
    for (frame, BatchFrame { balls, .. }) in frames.iter().enumerate() {
        let says = |ball: &usize| {
            let BallEstimate { frame, .. } = &balls[*ball];
            (frame.pose().is_some(), frame.dots.len())
        };
        match is_strobed {
            true => places.extend((0..balls.len()).map(|ball| (frame, ball))),
            false => places.extend((0..balls.len()).max_by_key(says).map(|ball| (frame, ball))),
        }
    }
    places
}
