//! One verdict over all frames of a clip: does the table fit, are the images mirrored, which of
//! several tables is it?
//!
//! A single frame of another pattern, of its mirror image or of no pattern at all fits now and then
//! by accident. Frames of one clip show one ball, so that their evidence adds up.
//!
//! # Evidence
//! A hypothesis is a table, seen directly or in a mirror. A frame with a pose has the evidence `E`
//! (natural log) that its dots are the pattern's and not anything
//! ([`RobustRecognizer::explain_near`]). A frame of the right ball may still have none, with the
//! probability `m` where it shows enough dots, and `m'` where it shows fewer. It weighs
//!
//! ```text
//! L = ln( m + (1 - m) exp(E) )     with a pose
//! L = ln m                         without one, if it shows enough dots
//! L = ln m'                        without one, if it shows the ball with fewer and the poses share no motion; else 0
//! ```
//!
//! limited, so that no single frame decides. The sum over the frames is the hypothesis' evidence
//! against "none of them"; a motion that the poses share adds to it, where it shows another side of the ball. Two hypotheses are compared
//! frame by frame in the same way.
//!
//! Guarantees: the verdict depends on the frames' dots and poses alone. Not guaranteed: a verdict on
//! fewer than [`MIN_FRAMES`] frames that say anything; then there is none. Frames with few dots say something only where others
//! have a pose, weighed here or in the clip's own estimate: a ball that is hardly seen is not another ball. A frame without any dot shows
//! the ball where most of the frames with a pose have it; elsewhere the circle may be that of something else.

use std::ops::Deref;

use nalgebra::Matrix2;

use crate::error::Result;
use crate::geometry::Vec3;
use crate::pattern::Pattern;
use crate::recognize::robust::{RobustRecognizer, RobustWorkspace};
use crate::view::{DotUncertainty, ObservedDot};
use crate::vision::dots::detector::LIKELY_DOT;
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection};
use crate::vision::optics::camera::BallCircle;

/// Minimum number of frames that say anything for a verdict.
pub const MIN_FRAMES: usize = 3;
/// Dots, likelier so than not, that identify a ball in nearly every frame.
const ENOUGH_DOTS: usize = 6;
/// Probability that a frame of the right ball with enough dots has no pose.
const MISSED: f64 = 0.2;
/// The same of a frame that shows a ball with fewer dots: 39 % of 231 rendered images in all conditions (12, 20 and 40 dots,
/// seed 71), and more, since the frames of one clip are alike.
const MISSED_OF_FEW: f64 = 0.6;
/// Frames that show a ball with few dots are enough for a verdict from this number on: less is a matter of luck.
const MANY_OF_FEW: usize = 16;
/// What a pose of the clip's own estimate adds where it is not found again: ln of 1 - [`MISSED_OF_FEW`] over the 2 % of frames that balls
/// with a face keep by accident.
const ANSWERED: f64 = 3.0;
/// Limits of a frame's weight against "none of them", and between two hypotheses.
const MAX_WEIGHT: f64 = 6.0;
pub(crate) const MAX_LEAD: f64 = 10.0;
/// What a motion that the poses share adds.
const COMMON_MOTION: f64 = 6.0;
/// Evidence that a hypothesis must have.
const MIN_EVIDENCE: f64 = 2.0;
/// Lead over the others: odds of 20 to 1.
const MIN_LEAD: f64 = 3.0;

/// What a frame says of one hypothesis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrameScore {
    /// Detections that are likelier dots than not.
    pub dots: usize,
    /// The outline of a ball whose dots could be looked for.
    pub ball: Option<BallCircle>,
    /// Whether the clip's own estimate has a pose of it.
    pub is_answered: bool,
    /// ln of the evidence of its pose against "not this pattern"; `None` without a pose.
    pub ln_evidence: Option<f64>,
}

impl FrameScore {
    fn has_enough_dots(&self) -> bool {
        self.dots >= ENOUGH_DOTS
    }

    /// Whether it tells its hypothesis from others: it has a pose, or enough dots for one.
    pub(crate) fn says_anything(&self) -> bool {
        self.has_enough_dots() || self.ln_evidence.is_some()
    }

    fn has_pose(&self) -> bool {
        self.ln_evidence.is_some() || self.is_answered
    }

    /// Whether the center of one's outline lies within the other's: they show one thing, or what is on it.
    fn is_at_the_place_of(&self, other: &Self) -> bool {
        let both = self.ball.zip(other.ball);
        both.is_some_and(|(a, b)| {
            let apart = (a.center.u - b.center.u).hypot(a.center.v - b.center.v);
            apart < a.radius.max(b.radius)
        })
    }

    /// What it adds to the evidence.
    fn limited(&self) -> f64 {
        self.weight().clamp(-MAX_WEIGHT, MAX_WEIGHT)
    }

    /// ln of the frame's evidence for the hypothesis, not limited.
    pub(crate) fn weight(&self) -> f64 {
        match self.ln_evidence {
            // For large E the sum is E itself, without overflow.
            Some(e) => {
                let (fits, missed) = ((1.0 - MISSED).ln() + e, MISSED.ln());
                let high = fits.max(missed);
                high + ((fits - high).exp() + (missed - high).exp()).ln()
            }
            None if self.has_enough_dots() => MISSED.ln(),
            None => 0.0,
        }
    }
}

/// A table, seen directly or in a mirror, with what the frames say of it.
#[derive(Debug, Clone, PartialEq)]
pub struct BallHypothesis {
    /// The number of the table.
    pub table: usize,
    /// Whether the images are mirrored.
    pub is_mirrored: bool,
    /// One a frame, the same frames for all hypotheses.
    pub frames: Vec<FrameScore>,
    /// Whether most of the poses agree on one motion that shows another side of the ball.
    pub has_common_motion: bool,
}

impl BallHypothesis {
    /// Of which no frame has said anything.
    pub(super) fn unseen(table: usize, is_mirrored: bool) -> Self {
        Self {
            table,
            is_mirrored,
            frames: Vec::new(),
            has_common_motion: false,
        }
    }

    /// ln of the evidence against "none of them".
    pub fn ln_evidence(&self) -> f64 {
        let motion = if self.has_common_motion {
            COMMON_MOTION
        } else {
            0.0
        };
        let little = self.little() as f64 * MISSED_OF_FEW.ln();
        self.frames.iter().map(FrameScore::limited).sum::<f64>() + motion + little
    }

    /// The same of the last frames alone, without a motion.
    pub(crate) fn ln_evidence_of_last(&self, count: usize) -> f64 {
        let weights = self
            .frames
            .iter()
            .rev()
            .take(count)
            .map(FrameScore::limited);
        weights.sum()
    }

    /// Frames that show the ball with few dots and have no pose, where the others share no motion: with one, it is the ball that is hard
    /// to see.
    fn little(&self) -> usize {
        if self.has_common_motion {
            return 0;
        }
        let posed = || self.frames.iter().filter(|f| f.has_pose());
        let poses = posed().count();
        let is_there = |f: &FrameScore| {
            let there = posed().filter(|p| f.is_at_the_place_of(p));
            2 * there.count() > poses
        };
        let shows_the_ball = |f: &&FrameScore| f.ball.is_some() && (f.dots > 0 || is_there(f));
        let unexplained = |f: &&FrameScore| f.ln_evidence.is_none() && !f.has_enough_dots();
        let frames = self.frames.iter().filter(unexplained);
        frames.filter(shows_the_ball).count()
    }

    /// Whether the clip's own poses are luck: hardly one among many frames with a few dots, and none of them found again.
    fn is_luck(&self) -> bool {
        let answered = self.frames.iter().filter(|f| f.is_answered).count();
        let little = self.little();
        let ln_odds = answered as f64 * ANSWERED + little as f64 * MISSED_OF_FEW.ln();
        answered > 0 && little >= MANY_OF_FEW && ln_odds < -MIN_LEAD
    }

    /// ln of the evidence against another hypothesis.
    pub fn ln_lead(&self, other: &Self) -> f64 {
        let pairs = self.frames.iter().zip(&other.frames);
        pairs
            .map(|(a, b)| (a.weight() - b.weight()).clamp(-MAX_LEAD, MAX_LEAD))
            .sum()
    }

    /// Frames with a pose.
    pub fn answered(&self) -> usize {
        let posed = self.frames.iter().filter(|f| f.ln_evidence.is_some());
        posed.count()
    }
}

/// The verdict on a clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict {
    /// Too few frames say anything: each stands for itself.
    Open,
    /// This hypothesis fits.
    Fits {
        /// Its index among those given.
        hypothesis: usize,
        /// ln of its odds against the next best one; infinite where it is the only one.
        ln_lead: f64,
        /// ln of its odds against "none of them".
        ln_evidence: f64,
    },
    /// Two hypotheses fit about as well.
    Tied {
        /// The indices of both, the better one first.
        hypotheses: [usize; 2],
        /// ln of the odds.
        ln_lead: f64,
    },
    /// None of them fits.
    None {
        /// The index of the best.
        best: usize,
        /// ln of its odds against "none of them".
        ln_evidence: f64,
    },
}

/// Decides among hypotheses on the same frames.
pub fn decide(hypotheses: &[BallHypothesis]) -> Verdict {
    let informative = |h: &BallHypothesis| {
        let says = |f: &&FrameScore| f.says_anything();
        let is_much = h.answered() > 0 && h.little() >= MANY_OF_FEW;
        h.frames.iter().filter(says).count() + if is_much { MIN_FRAMES } else { 0 }
    };
    if hypotheses.iter().map(informative).max().unwrap_or(0) < MIN_FRAMES {
        return match hypotheses
            .first()
            .filter(|_| hypotheses.iter().all(BallHypothesis::is_luck))
        {
            Some(first) => Verdict::None {
                best: 0,
                ln_evidence: first.ln_evidence(),
            },
            None => Verdict::Open,
        };
    }
    // The one that leads over all others; leads are limited by frame, so a cycle is conceivable.
    let min_lead = |i: usize| {
        let others = (0..hypotheses.len()).filter(|&j| j != i);
        others
            .map(|j| (hypotheses[i].ln_lead(&hypotheses[j]), j))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((f64::INFINITY, i))
    };
    let leads = (0..hypotheses.len()).map(|i| (i, min_lead(i)));
    let Some((best, (ln_lead, next))) = leads.max_by(|a, b| a.1.0.total_cmp(&b.1.0)) else {
        return Verdict::Open;
    };
    let ln_evidence = hypotheses[best].ln_evidence();
    if ln_evidence < MIN_EVIDENCE {
        Verdict::None { best, ln_evidence }
    } else if ln_lead < MIN_LEAD {
        Verdict::Tied {
            hypotheses: [best, next],
            ln_lead,
        }
    } else {
        Verdict::Fits {
            hypothesis: best,
            ln_lead,
            ln_evidence,
        }
    }
}

/// The mirror image of a pattern: x reversed. Mirrored images of a ball are images of a ball with
/// this pattern.
///
/// # Errors
/// [`crate::Error::Internal`] where reversed unit vectors are none, which cannot be.
pub fn mirrored_pattern(pattern: &Pattern) -> Result<Pattern> {
    let dots = pattern.dots().iter();
    Pattern::new(dots.map(|d| Vec3::new(-d.x, d.y, d.z)).collect())
}

/// The estimator of what a mirror shows of its ball.
///
/// # Errors
/// As [`Estimator::for_pattern`].
pub(super) fn mirrored(estimator: &Estimator) -> Result<Estimator> {
    estimator.for_pattern(&mirrored_pattern(estimator.pattern())?)
}

/// Scores frames under one hypothesis, whose pattern's estimator is borrowed or shared.
#[derive(Debug)]
pub struct Scorer<E> {
    estimator: E,
    recognizer: RobustRecognizer,
    workspace: RobustWorkspace,
    estimation: EstimatorWorkspace,
    observed: Vec<ObservedDot>,
}

impl<E: Deref<Target = Estimator>> Scorer<E> {
    /// For the estimator of the hypothesis' pattern.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for a setting outside its domain.
    pub fn new(estimator: E) -> Result<Self> {
        use crate::recognize::Recognizer as _;
        let config = estimator.config().recognizer;
        let recognizer = RobustRecognizer::new(estimator.pattern(), config)?;
        Ok(Self {
            workspace: recognizer.workspace(),
            recognizer,
            estimation: estimator.workspace(),
            estimator,
            observed: Vec::new(),
        })
    }

    /// The estimator of the hypothesis' pattern.
    pub fn estimator(&self) -> &Estimator {
        &self.estimator
    }

    /// Identifies the dots of a frame by this hypothesis' pattern, and scores it.
    pub fn identify(&mut self, frame: &mut FrameEstimate) -> FrameScore {
        let is_answered = frame.pose().is_some();
        let workspace = &mut self.estimation;
        self.estimator.identify_detections(workspace, frame);
        FrameScore {
            is_answered,
            ..self.score(frame)
        }
    }

    /// The score of a frame as estimated.
    pub fn score(&mut self, frame: &FrameEstimate) -> FrameScore {
        let likely = frame.dots.iter().filter(|d| d.probability >= LIKELY_DOT);
        let shows_ball = matches!(
            frame.outcome,
            Ok(_)
                | Err(FrameRejection::TooFewDots { .. }
                    | FrameRejection::Ambiguous { .. }
                    | FrameRejection::Recognizer(_)
                    | FrameRejection::Foreign)
        );
        FrameScore {
            dots: likely.count(),
            ball: frame.outline.filter(|_| shows_ball).map(|o| o.circle),
            is_answered: frame.pose().is_some(),
            ln_evidence: self.ln_evidence(frame),
        }
    }

    fn ln_evidence(&mut self, frame: &FrameEstimate) -> Option<f64> {
        let pose = frame.pose()?;
        let view = self.estimator.camera().view_of(frame)?;
        let config = self.estimator.config();
        let hand = Matrix2::from_diagonal_element(config.placement_sigma_rad.powi(2));
        let min_depth = config.recognizer.view.visibility_limit.max(view.horizon());
        self.observed.clear();
        for dot in frame.dots.iter().filter(|d| d.probability >= LIKELY_DOT) {
            let seen = view.back_project(dot.pixel, &dot.covariance);
            let Some(mut seen) = seen.filter(|s| s.direction.z >= min_depth) else {
                continue;
            };
            if let DotUncertainty::Tangent { covariance } = &mut seen.uncertainty {
                *covariance += hand;
            }
            self.observed.push(seen);
        }
        let rotation = view.to_camera().inverse() * pose.rotation;
        let (dots, workspace) = (&self.observed, &mut self.workspace);
        // A pose that its own dots do not support has no evidence.
        self.recognizer
            .explain_near(dots, &rotation, workspace)
            .map(|found| found.ln_evidence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::optics::camera::Pixel;

    const BALL: BallCircle = BallCircle::new(Pixel { u: 100.0, v: 80.0 }, 40.0);

    fn hypothesis(table: usize, is_mirrored: bool, evidence: &[Option<f64>]) -> BallHypothesis {
        let frame = |e: &Option<f64>| FrameScore {
            dots: 8,
            ball: Some(BALL),
            is_answered: e.is_some(),
            ln_evidence: *e,
        };
        BallHypothesis {
            table,
            is_mirrored,
            frames: evidence.iter().map(frame).collect(),
            has_common_motion: false,
        }
    }

    #[test]
    fn one_lucky_frame_of_ten_is_no_fit() {
        let mut frames = [None; 10];
        frames[3] = Some(40.0);
        let found = decide(&[hypothesis(0, false, &frames)]);
        assert!(matches!(found, Verdict::None { best: 0, .. }), "{found:?}");
        // Three of ten are, and one motion makes two enough.
        frames[5..7].fill(Some(20.0));
        let found = decide(&[hypothesis(0, false, &frames)]);
        assert!(matches!(found, Verdict::Fits { .. }), "{found:?}");
    }

    #[test]
    fn too_few_frames_are_left_to_themselves() {
        let found = decide(&[hypothesis(0, false, &[None, None])]);
        assert_eq!(found, Verdict::Open);
        assert_eq!(decide(&[]), Verdict::Open);
        let few_dots = BallHypothesis {
            frames: vec![FrameScore::default(); 20],
            ..hypothesis(0, false, &[])
        };
        assert_eq!(decide(&[few_dots]), Verdict::Open);
    }

    /// A ball with a face, or a ladybird: its few dots fit by accident in two frames of a hundred.
    #[test]
    fn a_few_lucky_frames_of_many_with_few_dots_are_no_fit() {
        let clip = |answered: usize| {
            let few = FrameScore {
                dots: 3,
                ball: Some(BALL),
                ..FrameScore::default()
            };
            let mut frames = vec![few; 100];
            for frame in frames.iter_mut().take(answered) {
                frame.ln_evidence = Some(5.0);
            }
            BallHypothesis {
                frames,
                ..hypothesis(0, false, &[])
            }
        };
        let found = decide(&[clip(2)]);
        assert!(matches!(found, Verdict::None { best: 0, .. }), "{found:?}");
        let found = decide(&[clip(15)]);
        assert!(matches!(found, Verdict::Fits { .. }), "{found:?}");
        let one_motion = BallHypothesis {
            has_common_motion: true,
            ..clip(4)
        };
        let found = decide(&[one_motion]);
        assert!(matches!(found, Verdict::Fits { .. }), "{found:?}");
        // Hardly seen at all is not another ball.
        assert_eq!(decide(&[clip(0)]), Verdict::Open);
    }

    /// A ball with stars: a pose of the clip's own estimate that no dots give again. Where many frames have one, it is the ball that is hard
    /// to see.
    #[test]
    fn a_pose_that_is_not_found_again_is_luck_among_many_frames() {
        let clip = |answered: usize, frames: usize| {
            let frame = |k| FrameScore {
                dots: 4,
                ball: Some(BALL),
                is_answered: k < answered,
                ln_evidence: None,
            };
            BallHypothesis {
                frames: (0..frames).map(frame).collect(),
                ..hypothesis(0, false, &[])
            }
        };
        let found = decide(&[clip(1, 39), clip(1, 39)]);
        assert!(matches!(found, Verdict::None { best: 0, .. }), "{found:?}");
        for (answered, frames) in [(0, 39), (1, 12), (8, 39)] {
            assert_eq!(decide(&[clip(answered, frames)]), Verdict::Open);
        }
    }

    /// A ball with an eye: one frame by six dots, on the eye, and the ball without a dot in all others. A lamp elsewhere is not the ball.
    #[test]
    fn frames_without_a_dot_count_where_a_posed_ball_lies() {
        let clip = |elsewhere: BallCircle| {
            let mut frames = [None; 55].map(|ln_evidence| FrameScore {
                dots: 0,
                ball: Some(elsewhere),
                is_answered: false,
                ln_evidence,
            });
            frames[20] = FrameScore {
                dots: 6,
                ball: Some(BALL),
                is_answered: true,
                ln_evidence: Some(8.0),
            };
            BallHypothesis {
                frames: frames.to_vec(),
                ..hypothesis(0, false, &[])
            }
        };
        let at = |u: f64, radius: f64| BallCircle::new(Pixel { u, v: 80.0 }, radius);
        for ball in [at(104.0, 43.0), at(90.0, 200.0)] {
            let found = decide(&[clip(ball)]);
            assert!(matches!(found, Verdict::None { best: 0, .. }), "{found:?}");
        }
        assert_eq!(decide(&[clip(at(160.0, 40.0))]), Verdict::Open);
    }

    #[test]
    fn small_leads_of_many_frames_tell_a_mirror() {
        let direct = hypothesis(0, false, &[Some(18.0); 10]);
        let mirrored = hypothesis(0, true, &[Some(20.0); 10]);
        let found = decide(&[direct.clone(), mirrored]);
        let Verdict::Fits {
            hypothesis,
            ln_lead,
            ..
        } = found
        else {
            panic!("{found:?}")
        };
        assert!(hypothesis == 1 && (ln_lead - 20.0).abs() < 1e-6);
        // As good as each other: no verdict between them.
        let same = BallHypothesis {
            table: 1,
            ..direct.clone()
        };
        assert!(matches!(decide(&[direct, same]), Verdict::Tied { .. }));
    }
}
