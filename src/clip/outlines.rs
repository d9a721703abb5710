//! The outlines of a clip whose dots are not known: those that leave the path of their neighbors are looked for on it.
//!
//! A ball's outline moves on a smooth path ([`expected_outline`]), what else is round mostly does not, and a frame that shows the ball
//! badly lies between frames that do not. A frame whose outline lies off the path of the nearest others, or that has none, is
//! searched again near the path; what is found there is its outline. Guarantees: frames on the path keep their outlines.

use crate::vision::frame::estimate::FrameEstimate;
use crate::vision::frame::outline::OutlineSource;
use crate::vision::frame::prior::{OutlinePrior, Prior};
use crate::vision::optics::camera::BallCircle;
use crate::vision::outline::path::{expected_outline, off};

/// The nearest others that make the path: enough that a few neighbors in a row may be wrong, all for the same mark on the ball.
const NEIGHBORS: usize = 24;
/// Outlines that lie farther off the path than this, in radii, are not on it.
const OFF: f64 = 0.12;
/// Standard deviation of an expected outline, in radii: it is where to look, and no outline.
const SPREAD: f64 = 0.1;
/// Rounds of doubt: in each those that were settled help others.
pub(crate) const ROUNDS: usize = 3;

/// The frames whose outlines lie off their neighbors' path, and what that expects. `times_s` ascend, one a frame.
pub(crate) fn off_the_path(times_s: &[f64], frames: &[FrameEstimate]) -> Vec<(usize, BallCircle)> {
    let seen = |k: usize| Some((times_s[k], frames[k].outline?.circle));
    let all: Vec<Option<(f64, BallCircle)>> = (0..frames.len()).map(seen).collect();
    let in_doubt = (0..frames.len()).filter_map(|k| {
        let expected = expected_at(k, times_s, &all)?;
        let is_on_it = all[k].is_some_and(|(_, own)| off(&own, &expected) < OFF);
        (!is_on_it).then_some((k, expected))
    });
    in_doubt.collect()
}

/// The outline that the nearest others expect.
fn expected_at(k: usize, times_s: &[f64], all: &[Option<(f64, BallCircle)>]) -> Option<BallCircle> {
    let mut around: Vec<(f64, BallCircle)> = Vec::with_capacity(NEIGHBORS);
    let (mut before, mut after) = (k, k + 1);
    while around.len() < NEIGHBORS && (before > 0 || after < all.len()) {
        let ago = before.checked_sub(1).map(|b| times_s[k] - times_s[b]);
        let ahead = times_s.get(after).map(|t| t - times_s[k]);
        let is_before = ago.is_some_and(|ago| ahead.is_none_or(|ahead| ago <= ahead));
        let next = match is_before {
            true => {
                before -= 1;
                before
            }
            false => {
                after += 1;
                after - 1
            }
        };
        around.extend(all[next].map(|(time_s, circle)| (time_s - times_s[k], circle)));
    }
    expected_outline(&around)
}

/// Where to look again.
pub(crate) fn near(expected: &BallCircle) -> Prior {
    Prior {
        outline: Some(OutlinePrior::found(*expected, SPREAD * expected.radius)),
        ..Prior::default()
    }
}

/// Whether what was found near the path is on it.
pub(crate) fn is_settled(found: &mut FrameEstimate, expected: &BallCircle) -> bool {
    let Some(outline) = found.outline.as_mut() else {
        return false;
    };
    outline.source = OutlineSource::Neighbors;
    off(&outline.circle, expected) < OFF
}
