//! How much of a pattern lies near its own mirror image.
//!
//! A flipped image shows the mirror image of the ball. Where a rotation lays many dots of the pattern
//! near dots of its mirror image, flipped images are hard to tell from others, and an estimator that
//! allows for both confuses them.
//!
//! The rotations that are tried lay a pair of dots on a pair of the mirror image. From the best of
//! them dots are assigned one to one, nearest first, and the rotation is fitted to them again, until
//! nothing changes. Up to 24 dots all pairs of pairs are tried, beyond a sample. The result is the
//! best that was found; a better rotation may exist.

use crate::error::Result;
use crate::geometry::{Rotation, Vec3, angle_between, kabsch};
use crate::pattern::Pattern;

use super::objective::poses::{Image, Kernel, PoseSearch};

/// A dot this near counts as lying on the mirror image, radians (12 degrees).
pub const MIRROR_NEAR_RAD: f64 = 12.0 * std::f64::consts::PI / 180.0;
/// Rotations that are refined.
const REFINED: usize = 60;
/// Rounds of a refinement.
const ROUNDS: usize = 12;
/// Pairs of pairs that are tried.
const MAX_POSES: f64 = 60_000.0;

/// The rotation that lays most dots near the mirror image.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MirrorLikeness {
    /// Dots within [`MIRROR_NEAR_RAD`] of a dot of the mirror image of their own.
    pub near: usize,
    /// All dots.
    pub dots: usize,
    /// Root mean square angle of those near to their dots, radians; 0 where there are none.
    pub rms_rad: f64,
}

impl MirrorLikeness {
    /// Finds it for a pattern.
    ///
    /// # Errors
    /// None for a valid pattern: as [`kabsch`].
    pub fn of(pattern: &Pattern) -> Result<Self> {
        let dots = pattern.dots();
        let mirrored = Image::Mirrored.of(dots);
        let reach = 2.0 * (0.5 * MIRROR_NEAR_RAD).sin();
        let search = PoseSearch {
            image: Image::Mirrored,
            kernel: Kernel::new(reach, 0.9, 1.0),
            pair_kernel: Kernel::new(reach, 0.9, 1.0),
            min_matches: 1,
            max_poses: MAX_POSES,
            seed: 0,
        };
        let found = search.run(dots);
        let mut order: Vec<usize> = (0..found.poses.len()).collect();
        order.sort_by_key(|&k| (std::cmp::Reverse(found.poses[k].matches.len()), k));
        let mut best = Self {
            near: 0,
            dots: dots.len(),
            rms_rad: 0.0,
        };
        for &k in order.iter().take(REFINED) {
            let rotation = Rotation::from_matrix(&found.poses[k].rotation);
            let refined = refine(dots, &mirrored, rotation)?;
            if (refined.near, best.rms_rad) > (best.near, refined.rms_rad) {
                best = refined;
            }
        }
        Ok(best)
    }
}

/// Assigns and fits in turn from a rotation; the best assignment met.
fn refine(dots: &[Vec3], mirrored: &[Vec3], mut rotation: Rotation) -> Result<MirrorLikeness> {
    let mut best = MirrorLikeness {
        near: 0,
        dots: dots.len(),
        rms_rad: 0.0,
    };
    for _ in 0..ROUNDS {
        let pairs = assign(dots, mirrored, &rotation);
        if pairs.len() < 3 {
            break;
        }
        let from: Vec<Vec3> = pairs.iter().map(|p| dots[p.dot]).collect();
        let to: Vec<Vec3> = pairs.iter().map(|p| mirrored[p.other]).collect();
        let sum: f64 = pairs.iter().map(|p| p.angle * p.angle).sum();
        let here = MirrorLikeness {
            near: pairs.len(),
            rms_rad: (sum / pairs.len() as f64).sqrt(),
            ..best
        };
        if (here.near, best.rms_rad) > (best.near, here.rms_rad) {
            best = here;
        }
        let fitted = kabsch(&from, &to, None)?;
        if fitted.angle_to(&rotation) < 1e-9 {
            break;
        }
        rotation = fitted;
    }
    Ok(best)
}

/// A dot near one of the mirror image.
struct Near {
    dot: usize,
    other: usize,
    angle: f64,
}

/// Pairs of dots near each other, nearest first, each dot once.
fn assign(dots: &[Vec3], mirrored: &[Vec3], rotation: &Rotation) -> Vec<Near> {
    let mut all = Vec::new();
    for (dot, d) in dots.iter().enumerate() {
        let at = rotation * d;
        for (other, m) in mirrored.iter().enumerate() {
            let angle = angle_between(&at, m);
            if angle <= MIRROR_NEAR_RAD {
                all.push(Near { dot, other, angle });
            }
        }
    }
    all.sort_by(|a, b| a.angle.total_cmp(&b.angle));
    let (mut used, mut taken) = (vec![false; dots.len()], vec![false; dots.len()]);
    all.retain(|near| {
        let free = !used[near.dot] && !taken[near.other];
        if free {
            used[near.dot] = true;
            taken[near.other] = true;
        }
        free
    });
    all
}
