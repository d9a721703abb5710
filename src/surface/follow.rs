//! Frames of a painted ball as they come, each on the surface that an earlier clip has made.
//!
//! A frame is laid where the turn of the last two leads, and where it agrees badly there, anywhere on the surface, as in a clip. Its outline
//! is steadied by those of the frames before. What all views share (outlines that are too small alike, the camera's distance) is fitted to
//! frames between which the ball has turned, after 16, 32, 64 of them and so on. A ball that is found anew must agree by more than decoys of
//! the frames do (`decoy`); from frame to frame it need not.

use std::collections::VecDeque;

use super::clip::{Clip, Views};
use super::decoy::{TESTED, stands_out};
use super::fit::FitSpace;
use super::frame::PaintedFrame;
use super::laid::{Laid, TURNED};
use super::search::Blurred;
use super::surface_map::SurfaceMap;
use super::track::{FIRST_CHECK, PaintedPose, PaintedRejection, PaintedTracker};
use crate::geometry::rotation_angle;
use crate::vision::frame::config::CameraModel;
use crate::vision::optics::camera::BallCircle;

/// Frames whose outlines steady one, and turned ones to which the views are fitted.
const RECENT: usize = 25;
const FITTED: usize = 32;

/// Follows a painted ball through a stream of frames.
#[derive(Debug)]
pub struct PaintedFollower {
    tracker: PaintedTracker,
    surface: SurfaceMap,
    blurred: Blurred,
    space: FitSpace,
    views: Views,
    circle: Option<BallCircle>,
    /// The last frames, the newest last.
    recent: VecDeque<PaintedFrame>,
    /// Where the last two lie, the newer first.
    last: [Option<Laid>; 2],
    /// Frames between which the ball has turned, the newest last, and how many there were in all.
    turned: VecDeque<(PaintedFrame, Laid)>,
    turns: usize,
    /// The best that a decoy agreed, and how many were tried.
    by_chance: f64,
    decoys: usize,
}

impl PaintedFollower {
    /// Of a ball with this surface, by a camera whose distance may be unknown.
    pub fn new(camera: &CameraModel, surface: SurfaceMap) -> Self {
        let tracker = PaintedTracker::new(camera);
        Self {
            blurred: tracker.search.blurred(&tracker.grid, &surface),
            tracker,
            surface,
            space: FitSpace::default(),
            views: Views::of(camera),
            circle: None,
            recent: VecDeque::with_capacity(RECENT + 1),
            last: [None; 2],
            turned: VecDeque::with_capacity(FITTED + 1),
            turns: 0,
            by_chance: 0.0,
            decoys: 0,
        }
    }

    /// The pose of the next frame.
    ///
    /// # Errors
    /// A [`PaintedRejection`] where it shows no ball, or nothing that is on the surface.
    pub fn place(
        &mut self,
        frame: &PaintedFrame,
    ) -> std::result::Result<PaintedPose, PaintedRejection> {
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back(frame.clone());
        let found = self.lay();
        self.last = [found.as_ref().ok().map(|(laid, _)| *laid), self.last[0]];
        let (laid, pose) = found?;
        self.learn(frame, laid);
        Ok(pose)
    }

    /// The outline of the newest frame, steadied by those before.
    pub(crate) fn circle(&self) -> Option<BallCircle> {
        self.circle
    }

    /// Forgets where the ball was: the next frame is the first of another clip. What the views share stays.
    pub fn reset(&mut self) {
        self.recent.clear();
        self.last = [None; 2];
    }

    /// Lays the newest frame on the surface.
    fn lay(&mut self) -> std::result::Result<(Laid, PaintedPose), PaintedRejection> {
        let Self {
            tracker,
            surface,
            blurred,
            space,
            last,
            ..
        } = self;
        let newest = self.recent.len() - 1;
        let clip = Clip::new(self.recent.make_contiguous(), &tracker.camera, self.views);
        self.circle = clip.circle(newest);
        let face = clip.face(newest, &tracker.maker);
        let (face, view) = (face.zip(clip.view(newest))).ok_or(PaintedRejection::NoBall)?;
        let best = tracker.next(space, surface, || &*blurred, &face, last.iter());
        if last[0].is_none() && self.decoys < TESTED {
            let decoys = tracker.decoys(&[]);
            let agreement = decoys.agreement(surface, blurred, &face).unwrap_or(0.0);
            self.by_chance = self.by_chance.max(agreement);
            self.decoys += 1;
        }
        let by_chance = self.by_chance;
        let is_followed = last[0].is_some();
        let best = best.filter(|b| is_followed || stands_out(&mut [b.agreement], by_chance));
        let laid = best.ok_or(PaintedRejection::Lost)?;
        Ok((laid, PaintedPose::new(&face, &laid, view)))
    }

    /// Fits what the views share, now and then.
    fn learn(&mut self, frame: &PaintedFrame, laid: Laid) {
        let last = self.turned.back();
        if last.is_some_and(|(_, last)| rotation_angle(&last.rotation, &laid.rotation) < TURNED) {
            return;
        }
        if self.turned.len() == FITTED {
            self.turned.pop_front();
        }
        self.turned.push_back((frame.clone(), laid));
        self.turns += 1;
        if self.turns < FIRST_CHECK || !self.turns.is_power_of_two() {
            return;
        }
        let turned = self.turned.iter().cloned();
        let (frames, mut laid): (Vec<_>, Vec<_>) = turned.map(|(f, l)| (f, Some(l))).unzip();
        let mut clip = Clip::new(&frames, &self.tracker.camera, self.views);
        clip.reach(frames.len(), &self.tracker.maker);
        self.tracker.fit_views(&mut clip, &self.surface, &mut laid);
        self.views = clip.views();
    }
}
