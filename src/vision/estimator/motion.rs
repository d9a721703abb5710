//! Where the ball of the frames before will be.
//!
//! Center and radius move evenly from frame to frame: constant velocity, by the last two outlines. A
//! longer memory would lag behind a ball that falls. The prediction serves to look in the right
//! place, and is no measurement.

use std::collections::VecDeque;

use crate::vision::camera::{BallCircle, Pixel};

/// Outlines that are remembered.
const SEEN: usize = 2;
/// The radius changes by at most this part from the last outline to the predicted one.
const MAX_GROWTH: f64 = 0.15;

/// The path of a ball's outline, up to the last frame.
#[derive(Debug, Clone)]
pub(super) struct OutlineMotion {
    seen: VecDeque<(f64, BallCircle)>,
}

impl Default for OutlineMotion {
    fn default() -> Self {
        Self {
            seen: VecDeque::with_capacity(SEEN + 1),
        }
    }
}

impl OutlineMotion {
    /// Nothing is known.
    pub fn clear(&mut self) {
        self.seen.clear();
    }

    /// Forgets outlines from before a time.
    pub fn forget(&mut self, oldest_s: f64) {
        while self.seen.front().is_some_and(|s| s.0 < oldest_s) {
            self.seen.pop_front();
        }
    }

    /// The outline at a time, later than all before.
    pub fn push(&mut self, time_s: f64, circle: BallCircle) {
        if self.seen.len() == SEEN {
            self.seen.pop_front();
        }
        self.seen.push_back((time_s, circle));
    }

    /// The outline as expected at a time.
    pub fn predict(&self, time_s: f64) -> Option<BallCircle> {
        let (last_s, last) = *self.seen.back()?;
        let &(first_s, first) = self.seen.front()?;
        if last_s <= first_s {
            return Some(last);
        }
        let steps = (time_s - last_s) / (last_s - first_s);
        let ahead = |from: f64, to: f64| to + steps * (to - from);
        let radius = ahead(first.radius, last.radius);
        let (min, max) = (1.0 - MAX_GROWTH, 1.0 + MAX_GROWTH);
        Some(BallCircle {
            center: Pixel {
                u: ahead(first.center.u, last.center.u),
                v: ahead(first.center.v, last.center.v),
            },
            radius: radius.clamp(min * last.radius, max * last.radius),
        })
    }
}
