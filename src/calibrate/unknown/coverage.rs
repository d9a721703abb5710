//! Whether a map is a pattern: most frames hang together, and they show the whole ball.

use super::map::{Map, NEW_DEPTH};
use super::{MIN_VIEWS, UnknownRejection};
use crate::geometry::{Vec3, spiral_directions};
use crate::pattern::Pattern;

/// Depth from which a view faces a place well enough for a dot there to be taken in.
pub(super) const FACING: f64 = NEW_DEPTH;
/// Share of the frames that must hang together.
const MIN_PLACED: f64 = 0.6;
/// Places at which the coverage is looked up.
const PLACES: usize = 400;
/// Share of the places that may lack views: less than one dot of twenty hides there. Where the number of
/// dots is known and found, none does, and more may.
const MAX_BLIND: f64 = 0.05;
const MAX_BLIND_COUNTED: f64 = 0.15;

impl Map<'_> {
    /// The pattern, or what is missing for one.
    pub fn finish(
        self,
        rich: usize,
        expected: Option<usize>,
    ) -> std::result::Result<Pattern, UnknownRejection> {
        let placed = self.count();
        if (placed as f64) < MIN_PLACED * rich as f64 || placed < self.config.min_frames {
            return Err(UnknownRejection::Disconnected {
                placed,
                frames: rich,
            });
        }
        let blind = self.blind();
        let names = self.like_dots(&self.established(), expected);
        let found = names.len();
        let max_blind = match expected == Some(found) {
            true => MAX_BLIND_COUNTED,
            false => MAX_BLIND,
        };
        if blind > max_blind {
            return Err(UnknownRejection::NotCovered { blind });
        }
        if let Some(expected) = expected.filter(|n| *n != found) {
            return Err(UnknownRejection::WrongNumber { expected, found });
        }
        let directions = names.iter().map(|&j| self.dots[j].direction).collect();
        Pattern::new(directions).map_err(|_| UnknownRejection::NoPattern { found })
    }

    /// Share of the ball's surface that hardly any placed frame shows.
    fn blind(&self) -> f64 {
        let faced = |place: &Vec3| {
            let frames = self.frames.iter().zip(&self.placed);
            let views = frames.filter(|(frame, placed)| {
                placed
                    .as_ref()
                    .is_some_and(|p| frame.depth(&(p.rotation * place)) >= FACING)
            });
            views.take(MIN_VIEWS).count() == MIN_VIEWS
        };
        let blind = spiral_directions(PLACES)
            .filter(|place| !faced(place))
            .count();
        blind as f64 / PLACES as f64
    }
}
