//! A painted ball's frames one by one, as they come: the orientation on the surface of an earlier clip now, and the spin now.
//!
//! The outline is looked for where those before lead, as a [`Tracker`](super::tracker::Tracker) does; the pose is that of a
//! [`PaintedFollower`]. The spin is that of the window's poses, from the third on.

use std::collections::VecDeque;
use std::sync::Arc;

use super::followed::FollowedOutline;
use super::painted::PaintedEstimator;
use super::tracker::{NOTHING_SEEN, TrackerConfig};
use crate::error::Result;
use crate::image::{ImageView, Roi};
use crate::spin::clock::Clock;
use crate::spin::robust::RobustEstimator;
use crate::spin::shared::SharedError;
use crate::spin::{Fit, Measurement, SpinRejection};
use crate::surface::{
    PaintedFollower, PaintedFrame, PaintedPose, PaintedRejection, SYSTEMATIC, SurfaceMap,
};
use crate::vision::FrameEstimate;
use crate::vision::frame::prior::{OutlinePrior, Prior};
use crate::vision::outline::find::OutlineSearch;

/// What is known after a frame.
#[derive(Debug)]
pub struct PaintedState<'a> {
    /// The frame: its outline, and neither dots nor a pose.
    pub frame: &'a FrameEstimate,
    /// The pose on the surface, or why there is none.
    pub pose: std::result::Result<PaintedPose, PaintedRejection>,
    /// The spin by the window's poses, or why there is none. Its covariance counts what light, outline and surface err alike.
    pub spin: &'a std::result::Result<Fit, SpinRejection>,
    /// What is wrong with the times of the window's frames, and mended for the spin.
    pub clock: &'a Clock,
}

/// Follows one painted ball through the frames of a camera.
#[derive(Debug)]
pub struct PaintedStream {
    estimator: Arc<PaintedEstimator>,
    follower: PaintedFollower,
    config: TrackerConfig,
    /// Where the ball is looked for, if not everywhere.
    roi: Option<Roi>,
    search: OutlineSearch,
    outline: FollowedOutline,
    frame: FrameEstimate,
    fitter: RobustEstimator,
    window: VecDeque<Measurement>,
    spin: std::result::Result<Fit, SpinRejection>,
}

impl PaintedStream {
    /// Of a ball with this surface. [`TrackerConfig::max_latency`] is not kept: a frame takes what it takes.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for a setting outside its domain.
    pub fn new(
        estimator: Arc<PaintedEstimator>,
        surface: SurfaceMap,
        config: TrackerConfig,
    ) -> Result<Self> {
        config.check()?;
        Ok(Self {
            search: estimator.finder.workspace(),
            follower: PaintedFollower::new(&estimator.camera, surface),
            estimator,
            roi: None,
            outline: FollowedOutline::default(),
            frame: FrameEstimate::default(),
            fitter: RobustEstimator::new(config.sequence.spin),
            window: VecDeque::with_capacity(config.window + 1),
            spin: Err(NOTHING_SEEN),
            config,
        })
    }

    /// The same, which looks for the ball in this part of every frame; one that it follows may leave it.
    #[must_use]
    pub fn within(self, roi: Roi) -> Self {
        Self {
            roi: Some(roi),
            ..self
        }
    }

    /// Forgets everything but what the views share: the next frame is the first of another clip.
    pub fn reset(&mut self) {
        self.outline.reset();
        self.follower.reset();
        self.window.clear();
        self.spin = Err(NOTHING_SEEN);
    }

    /// Takes the next frame, of the time `time_s` in seconds. `outline` is the ball's outline, where it is known.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where the time is not finite or not later than that of the frame before; the stream then stays as it was.
    pub fn update<'a>(
        &mut self,
        image: impl Into<ImageView<'a>>,
        time_s: f64,
        outline: Option<&OutlinePrior>,
    ) -> Result<PaintedState<'_>> {
        let image = image.into();
        let part = self
            .roi
            .map(|roi| roi.within(image.width(), image.height()))
            .transpose()?;
        self.outline.begin(time_s, self.config.memory_s)?;
        let prior = Prior {
            region: part,
            outline: self.outline.expected(time_s, outline),
            ..Prior::default()
        };
        let frame = &mut self.frame;
        self.estimator
            .finder
            .find(image, &prior, &mut self.search, frame);
        let outline = frame.outline.as_ref();
        let shown = outline.map(|outline| PaintedFrame::take(image, outline));
        let pose = self.follower.place(&shown.unwrap_or_default());
        let circle = self.follower.circle();
        self.outline
            .take(time_s, circle, frame.fit.as_ref(), pose.is_ok());
        let oldest = time_s - self.config.memory_s;
        while self.window.front().is_some_and(|seen| seen.time_s < oldest) {
            self.window.pop_front();
        }
        if let Ok(pose) = &pose {
            if self.window.len() == self.config.window {
                self.window.pop_front();
            }
            self.window
                .push_back(Measurement::new(time_s, pose.rotation));
        }
        let errors = self.window.iter().map(|_| SYSTEMATIC);
        self.fitter.set_shared(SharedError::of_residuals(errors));
        self.spin = self.fitter.fit(self.window.make_contiguous());
        Ok(PaintedState {
            frame: &self.frame,
            pose,
            spin: &self.spin,
            clock: self.fitter.clock(),
        })
    }
}
