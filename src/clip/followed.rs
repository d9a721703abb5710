//! The outline of one ball from frame to frame of a stream, and the times of these.

use crate::error::{Error, Result};
use crate::spin::MIN_INTERVAL_S;
use crate::vision::estimator::propose::NEARBY;
use crate::vision::frame::prior::OutlinePrior;
use crate::vision::optics::camera::BallCircle;
use crate::vision::outline::circle::{BallFit, WHOLE};
use crate::vision::outline::path::OutlineMotion;

/// After so many frames without a pose the ball is looked for in the whole frame.
const PATIENCE: usize = 3;

/// Where the ball was, and when.
#[derive(Debug)]
pub(super) struct FollowedOutline {
    motion: OutlineMotion,
    /// Frames since the last pose.
    missed: usize,
    last_s: Option<f64>,
    /// The shortest time between two frames so far, seconds.
    pub shortest_s: f64,
}

impl Default for FollowedOutline {
    /// Nothing was seen.
    fn default() -> Self {
        Self {
            motion: OutlineMotion::default(),
            missed: 0,
            last_s: None,
            shortest_s: f64::INFINITY,
        }
    }
}

impl FollowedOutline {
    /// Begins a frame; outlines from before `oldest_s` are forgotten.
    ///
    /// # Errors
    /// [`Error::Argument`] where the time is not finite or not later than that of the frame before; all then stays as it was.
    pub fn begin(&mut self, time_s: f64, memory_s: f64) -> Result<()> {
        let earliest = self.last_s.map(|last| last + MIN_INTERVAL_S);
        if !time_s.is_finite() || earliest.is_some_and(|earliest| time_s < earliest) {
            let expected = earliest.map_or("a finite number".to_owned(), |earliest| {
                format!("at least {earliest} s, later than the frame before")
            });
            return Err(Error::argument(
                "time_s",
                format!("expected {expected}, found {time_s}"),
            ));
        }
        if let Some(before) = self.last_s.replace(time_s) {
            self.shortest_s = self.shortest_s.min(time_s - before);
        }
        self.motion.forget(time_s - memory_s);
        Ok(())
    }

    /// Where the outline is expected: as given, or where those before lead.
    pub fn expected(&self, time_s: f64, given: Option<&OutlinePrior>) -> Option<OutlinePrior> {
        given.copied().or_else(|| {
            let circle = self.motion.predict(time_s)?;
            let sigma_px = match self.missed >= PATIENCE {
                true => f64::INFINITY,
                false => NEARBY * circle.radius / 3.0,
            };
            Some(OutlinePrior::found(circle, sigma_px))
        })
    }

    /// Takes the outline of a frame, which counts as the ball's by its pose, or, for some frames without one, by being whole.
    pub fn take(
        &mut self,
        time_s: f64,
        circle: Option<BallCircle>,
        fit: Option<&BallFit>,
        has_pose: bool,
    ) {
        self.missed = if has_pose { 0 } else { self.missed + 1 };
        let is_whole = || fit.is_some_and(|f| f.support >= WHOLE);
        let is_seen = has_pose || self.missed <= PATIENCE && is_whole();
        if let Some(circle) = circle.filter(|_| is_seen) {
            self.motion.push(time_s, circle);
        } else if self.missed > PATIENCE {
            self.motion.clear();
        }
    }

    /// Forgets where the ball was, and the time; the shortest step stays.
    pub fn reset(&mut self) {
        self.motion.clear();
        self.missed = 0;
        self.last_s = None;
    }
}
