//! Steady marks that the pattern lacks: a logo's corners, a seam's end, dirt, a dot drawn far off.
//!
//! Detections without a name are laid on the ball under their frame's orientation. What belongs to the
//! ball stays at one place there; what belongs to the light or the background does not. A mark is a
//! place at which, in a good part of the views that show it, such a detection lies.

use super::fitted::FittedFrame;
use crate::geometry::{Vec3, angle_between};

/// Detections within this angle are of one mark, radians: some three standard deviations of a
/// detection on a ball of 60 pixels.
const REACH_RAD: f64 = 0.06;
/// Minimum depth of the views that count: see [`FittedFrame::depth`].
const MIN_DEPTH: f64 = 0.3;
/// Minimum number of frames that show a mark.
const MIN_FOUND: usize = 5;
/// Minimum share of the views that show it.
const MIN_RATE: f64 = 0.5;
/// Steps of the search for a mark's middle; they settle in three or four.
const SHIFTS: usize = 5;

/// A steady mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FoundMark {
    /// Its middle, pattern frame.
    pub direction: Vec3,
    /// Frames in which it was found.
    pub found: usize,
    /// Frames in which it faced the camera.
    pub views: usize,
}

/// An unnamed detection on the ball.
#[derive(Debug, Clone, Copy)]
struct Stray {
    frame: usize,
    direction: Vec3,
}

/// The steady marks, those found most often first. `strays[k]` are the directions (pattern frame) of
/// the unnamed detections of frame `k`.
pub(super) fn steady_marks(frames: &[FittedFrame], strays: &[Vec<Vec3>]) -> Vec<FoundMark> {
    let mut left: Vec<Stray> = Vec::new();
    for (k, (frame, directions)) in frames.iter().zip(strays).enumerate() {
        let seen = directions.iter().filter(|d| frame.depth(d) >= MIN_DEPTH);
        left.extend(seen.map(|direction| Stray {
            frame: k,
            direction: *direction,
        }));
    }
    let mut marks = Vec::new();
    while left.len() >= MIN_FOUND {
        let crowd = |at: &Vec3| near(&left, at).count();
        let Some(densest) = left.iter().max_by_key(|s| crowd(&s.direction)) else {
            break;
        };
        let mut middle = densest.direction;
        for _ in 0..SHIFTS {
            let sum: Vec3 = near(&left, &middle).map(|s| s.direction).sum();
            middle = sum.try_normalize(0.0).unwrap_or(middle);
        }
        let mut found: Vec<usize> = near(&left, &middle).map(|s| s.frame).collect();
        found.sort_unstable();
        found.dedup();
        if found.len() < MIN_FOUND {
            break;
        }
        let faces = |f: &&FittedFrame| f.depth(&middle) >= MIN_DEPTH;
        let views = frames.iter().filter(faces).count().max(found.len());
        if found.len() as f64 >= MIN_RATE * views as f64 {
            marks.push(FoundMark {
                direction: middle,
                found: found.len(),
                views,
            });
        }
        // Whether it is one or not, its surroundings are settled.
        left.retain(|s| angle_between(&s.direction, &middle) > 1.5 * REACH_RAD);
    }
    marks
}

fn near<'a>(strays: &'a [Stray], at: &'a Vec3) -> impl Iterator<Item = &'a Stray> {
    let min_cosine = REACH_RAD.cos();
    strays
        .iter()
        .filter(move |s| s.direction.dot(at) > min_cosine)
}
