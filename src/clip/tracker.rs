//! A camera's frames one by one, as they come: the orientation now, and the spin now.
//!
//! Where the ball was seen in the frames before, its outline is looked for where they predict it: only the
//! surroundings of the ball are converted and searched. Where that fails, it is looked for farther around; and
//! after some frames, as at the beginning, in the whole frame, at a coarse scale first, moving
//! objects before those that stand still. An outline that was found in this way counts as the ball's by its
//! dots.
//!
//! That is the forward pass over a [sequence](super::sequence::frames_in_doubt): every frame is one [`Estimator::estimate`], whose prior is
//! what the earlier frames expect. Poses that needed no hint and are likelier than 0.8 enter a window of
//! fixed length, from which the spin is fitted after each frame; it predicts the orientation of the next. A hinted pose is
//! an answer, but no evidence: it never enters the window, so that no error confirms itself.
//!
//! # What is promised
//! The work for a frame depends on the frame and on [`TrackerConfig::window`], not on how many frames
//! came before. Once the window has been full, no memory is allocated, but where frames suggest another ball or a mirror. An answer depends
//! on this frame and the earlier ones within [`TrackerConfig::memory_s`]; of those before, no more than the
//! rounding of an outline's fit, which starts from the predicted one, and the [verdict](TrackerState::judgment) on the last frames.
//!
//! Not promised: what the [second pass](super::sequence::second_pass) finds when it knows the later frames
//! as well, and any answer to a spin that changes within the window (a bounce): the fit then rejects
//! it, or takes the larger part. [`Tracker::reset`] starts afresh.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::followed::FollowedOutline;
use super::judgment::Judgment;
use super::live_judgment::LiveJudgment;
use super::sequence::{SequenceConfig, TRUSTED, predict};
use super::sequence_view::SequenceView;
use crate::error::{Result, require};
use crate::image::{ImageView, Roi};
use crate::recognize::Hint;
use crate::spin::clock::Clock;
use crate::spin::pair;
use crate::spin::robust::RobustEstimator;
use crate::spin::shared::{SharedError, ViewTurn};
use crate::spin::{Fit, MIN_FRAMES, Measurement, SpinRejection};
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::estimate::{FrameEstimate, Pose, SeenFrom};
use crate::vision::frame::prior::{Budget, Follows, OutlinePrior, Prior, SearchDepth};
use crate::vision::outline::circle::coarse::CoarseSearch;

/// Frames follow each other where they are less than so many of the shortest steps apart: halfway to the two of a dropped frame, and no
/// stamp jitters by half a step.
const ADJACENT: f64 = 1.5;

/// What a tracker remembers, and how it uses it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerConfig {
    /// How frames help each other.
    pub sequence: SequenceConfig,
    /// Number of poses in the window.
    pub window: usize,
    /// Poses older than this are forgotten, seconds.
    pub memory_s: f64,
    /// Time for a frame, from [`Tracker::update`] on: then nothing further is begun, and a frame without an answer has the
    /// rejection [`FrameRejection::OutOfTime`](crate::vision::frame::estimate::FrameRejection::OutOfTime). By default no limit.
    pub max_latency: Option<Duration>,
}

impl Default for TrackerConfig {
    /// Twelve poses of the last quarter of a second.
    fn default() -> Self {
        Self {
            sequence: SequenceConfig::default(),
            window: 12,
            memory_s: 0.25,
            max_latency: None,
        }
    }
}

impl TrackerConfig {
    /// Checks the domains of all settings.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] naming the setting.
    pub fn check(&self) -> Result<()> {
        let expected = format!("{MIN_FRAMES} to 1000");
        let inside = (MIN_FRAMES..=1000).contains(&self.window);
        require(inside, "window", &expected, self.window)?;
        let inside = self.memory_s > 0.0 && self.memory_s.is_finite();
        require(inside, "memory_s", "a positive number", self.memory_s)?;
        Ok(self.sequence.spin.check()?)
    }
}

/// What is known after a frame.
#[derive(Debug)]
pub struct TrackerState<'a> {
    /// The frame: its outline, dots and orientation, or why there is none.
    pub frame: &'a FrameEstimate,
    /// The spin by the window's poses, or why there is none: from the second of two frames on that follow each other, the slowest one that leads from
    /// pose to pose, which nothing checks yet ([`Fit::inliers`] is 2); without intrinsics in the view frame of the last of them. Its covariance counts the errors of
    /// drawn dots that the poses share, and the turn of the view frame ([`SharedError`]). Two frames follow each other where they are hardly farther
    /// apart than any two so far: of the first two frames ever this is assumed, since their times do not say whether one between them was dropped.
    pub spin: &'a std::result::Result<Fit, SpinRejection>,
    /// What is wrong with the times of the window's frames, and mended for the spin.
    pub clock: &'a Clock,
    /// What the last frames together say of the ball: does the table fit, are the images mirrored. As long as they do not, no frame keeps a
    /// pose.
    pub judgment: &'a Judgment,
}

/// A pose of the window.
#[derive(Debug, Clone, Copy)]
struct SeenFrame {
    measurement: Measurement,
    /// From where, if the camera's intrinsics are unknown.
    from: Option<SeenFrom>,
    pose: Pose,
}

/// Follows one ball through the frames of a camera.
#[derive(Debug)]
pub struct Tracker {
    estimator: Arc<Estimator>,
    config: TrackerConfig,
    /// Where the ball is looked for, if not everywhere.
    roi: Option<Roi>,
    workspace: EstimatorWorkspace,
    fitter: RobustEstimator,
    window: VecDeque<SeenFrame>,
    /// The window's orientations in one frame.
    turned: Vec<Measurement>,
    /// Their times and the turns that they contain.
    turns: Vec<(f64, ViewTurn)>,
    frame: FrameEstimate,
    outline: FollowedOutline,
    spin: std::result::Result<Fit, SpinRejection>,
    judgment: LiveJudgment,
}

impl Tracker {
    /// A tracker that has seen nothing.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for a setting outside its domain.
    pub fn new(estimator: Arc<Estimator>, config: TrackerConfig) -> Result<Self> {
        config.check()?;
        // Not while frames come in.
        estimator.rotation_search();
        Ok(Self {
            workspace: estimator.workspace(),
            judgment: LiveJudgment::new(Arc::clone(&estimator))?,
            estimator,
            fitter: RobustEstimator::new(config.sequence.spin),
            window: VecDeque::with_capacity(config.window + 1),
            turned: Vec::with_capacity(config.window),
            turns: Vec::with_capacity(config.window),
            frame: FrameEstimate::default(),
            outline: FollowedOutline::default(),
            spin: Err(NOTHING_SEEN),
            roi: None,
            config,
        })
    }

    /// The same tracker, which looks for the ball in this part of every frame; one that it follows may
    /// leave it.
    pub fn within(mut self, roi: Roi) -> Self {
        self.roi = Some(roi);
        self
    }

    /// The settings.
    pub fn config(&self) -> &TrackerConfig {
        &self.config
    }

    /// What is known now.
    pub fn state(&self) -> TrackerState<'_> {
        TrackerState {
            frame: &self.frame,
            spin: &self.spin,
            clock: self.fitter.clock(),
            judgment: self.judgment.judgment(),
        }
    }

    /// The probability of each of the window's poses that it agrees with the spin, in order of time;
    /// those of the last successful fit.
    pub fn inlier_probabilities(&self) -> &[f64] {
        self.fitter.inlier_probabilities()
    }

    /// Forgets everything: the next frame is the first of another trajectory.
    pub fn reset(&mut self) {
        self.window.clear();
        self.outline.reset();
        self.judgment.reset();
        let searches = self.workspace.searches.iter_mut();
        searches.for_each(CoarseSearch::forget);
        self.spin = Err(NOTHING_SEEN);
    }

    /// Takes the next frame, of the time `time_s` in seconds. `outline` is the ball's outline, where it
    /// is known.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where the time is not finite or not later than that of the frame before; the
    /// tracker then stays as it was.
    pub fn update<'a>(
        &mut self,
        image: impl Into<ImageView<'a>>,
        time_s: f64,
        outline: Option<&OutlinePrior>,
    ) -> Result<TrackerState<'_>> {
        let begun = Instant::now();
        let image = image.into();
        let whole = Roi::whole(image.width(), image.height());
        let part = self
            .roi
            .unwrap_or(whole)
            .within(whole.width, whole.height)?;
        self.outline.begin(time_s, self.config.memory_s)?;
        self.forget(time_s);
        self.find(image, &part, time_s, outline, begun);
        if let Some(why) = self.judgment.push(&self.frame)? {
            self.frame.take_back(why);
        }
        let trusted = self.trusted_pose(time_s);
        if let Some(seen) = trusted {
            if self.window.len() == self.config.window {
                self.window.pop_front();
            }
            self.window.push_back(seen);
        }
        // Without a new pose the spin stays what it was, as long as the poses are remembered.
        if trusted.is_some() || self.window.len() < MIN_FRAMES {
            self.fit();
        }
        Ok(self.state())
    }

    /// Estimates the frame by what is expected of it.
    fn find(
        &mut self,
        image: ImageView<'_>,
        part: &Roi,
        time_s: f64,
        given: Option<&OutlinePrior>,
        begun: Instant,
    ) {
        let outline = self.outline.expected(time_s, given);
        let prior = Prior {
            region: Some(*part),
            outline,
            rotation: self.expected_rotation(time_s),
            follows: Follows::LastImage,
        };
        let budget = Budget {
            deadline: self
                .config
                .max_latency
                .and_then(|most| begun.checked_add(most)),
            search: SearchDepth::Coarse,
            stop: self.config.sequence.stop,
            ..Budget::default()
        };
        let frame = &mut self.frame;
        self.estimator
            .estimate(image, &prior, &budget, &mut self.workspace, frame);
        let has_pose = frame.pose().is_some();
        self.outline
            .take(time_s, frame.circle, frame.fit.as_ref(), has_pose);
    }

    /// The frame's pose, if it is evidence.
    fn trusted_pose(&self, time_s: f64) -> Option<SeenFrame> {
        let pose = self.frame.pose()?;
        let is_trusted = !pose.hinted && pose.confidence >= TRUSTED;
        is_trusted.then_some(SeenFrame {
            measurement: Measurement {
                confidence: pose.confidence,
                ..Measurement::new(time_s, pose.rotation)
            },
            from: self.frame.seen_from(),
            pose: *pose,
        })
    }

    /// Fits the spin to the window, in the view frame of its last pose where there are no intrinsics.
    fn fit(&mut self) {
        let seen_from = self.window.iter().filter_map(|s| s.from);
        let last = seen_from.clone().next_back();
        let view = last.and_then(|one| SequenceView::about(one.circle.center, seen_from));
        let place = |seen: &SeenFrame| Some(view?.place(&seen.from?.circle, &seen.pose));
        self.turned.clear();
        self.turns.clear();
        for seen in &self.window {
            let (own, placed) = (seen.measurement, place(seen));
            self.turned.push(Measurement {
                orientation: placed.map_or(own.orientation, |placed| placed.rotation),
                ..own
            });
            self.turns
                .extend(placed.map(|placed| (own.time_s, placed.turn)));
        }
        let shared = SharedError::of_residuals(self.window.iter().map(|s| s.pose.residual_rad));
        let shared = SharedError::with_turns(shared, self.turns.iter().copied());
        self.fitter.set_shared(shared);
        self.spin = match self.pair() {
            Some(pair) => {
                let own = [self.window[0], self.window[1]];
                let own = own.map(|seen| place(&seen).map_or(seen.pose.covariance, |p| p.own));
                let max_rps = self.config.sequence.spin.max_rps;
                pair::slowest(&pair, &own, shared.as_ref(), max_rps)
            }
            None => self.fitter.fit(&self.turned),
        };
    }

    /// The window's two poses, if it has two, and their frames follow each other.
    fn pair(&self) -> Option<[Measurement; 2]> {
        let pair = <[Measurement; 2]>::try_from(&self.turned[..]).ok()?;
        let step_s = pair[1].time_s - pair[0].time_s;
        (step_s < ADJACENT * self.outline.shortest_s).then_some(pair)
    }

    /// Drops poses that are too old.
    fn forget(&mut self, time_s: f64) {
        let oldest = time_s - self.config.memory_s;
        let is_old = |seen: &SeenFrame| seen.measurement.time_s < oldest;
        while self.window.front().is_some_and(is_old) {
            self.window.pop_front();
        }
    }

    /// The orientation as the window's spin predicts it.
    fn expected_rotation(&self, time_s: f64) -> Option<Hint> {
        let fit = self.spin.as_ref().ok()?;
        let is_known = self.window.len() >= MIN_FRAMES;
        is_known.then(|| predict(&self.config.sequence, fit, &self.turned, time_s))
    }
}

/// The spin's state before the first frame.
pub(super) const NOTHING_SEEN: SpinRejection = SpinRejection::TooFewFrames {
    found: 0,
    needed: MIN_FRAMES,
};
