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

use nalgebra::Matrix3;

use crate::error::Result;
use crate::geometry::{Rotation, Vec3, angle_between, kabsch, pair_rotation};
use crate::pattern::Pattern;

/// A dot this near counts as lying on the mirror image, radians (12 degrees).
pub const MIRROR_NEAR_RAD: f64 = 12.0 * std::f64::consts::PI / 180.0;
/// Rotations that are refined.
const REFINED: usize = 60;
/// Rounds of a refinement.
const ROUNDS: usize = 12;
/// Pairs of pairs that are tried: all of those of 24 dots.
const MAX_POSES: usize = 160_000;

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
        // Of the mirror images, which differ by rotations, the one behind the plane z = 0.
        let mirrored: Vec<Vec3> = dots.iter().map(|d| Vec3::new(d.x, d.y, -d.z)).collect();
        let mut starts = starts(dots, &mirrored);
        // Stable: of equal ones the first pair comes first.
        starts.sort_by_key(|start| std::cmp::Reverse(start.near));
        let mut best = Self {
            near: 0,
            dots: dots.len(),
            rms_rad: 0.0,
        };
        for start in starts.iter().take(REFINED) {
            let rotation = Rotation::from_matrix(&start.rotation);
            let refined = refine(dots, &mirrored, rotation)?;
            if (refined.near, best.rms_rad) > (best.near, refined.rms_rad) {
                best = refined;
            }
        }
        Ok(best)
    }
}

/// A rotation that lays a pair of dots on a pair of the mirror image.
struct Start {
    rotation: Matrix3<f64>,
    /// Dots that it brings near some dot of the mirror image.
    near: usize,
}

fn starts(dots: &[Vec3], mirrored: &[Vec3]) -> Vec<Start> {
    let n = dots.len();
    let pairs: Vec<[usize; 2]> = (0..n)
        .flat_map(|i| (0..n).filter(move |&j| j != i).map(move |j| [i, j]))
        .collect();
    let cosine = MIRROR_NEAR_RAD.cos();
    let separation = |[i, j]: &[usize; 2], of: &[Vec3]| angle_between(&of[*i], &of[*j]);
    // Every pair of the one against every of the other, as far as that is affordable.
    let stride = (pairs.len() * pairs.len() / 2).div_ceil(MAX_POSES);
    let mut found = Vec::new();
    let tried = pairs.iter().filter(|[i, j]| i < j);
    let all = tried.flat_map(|a| pairs.iter().map(move |b| (a, b)));
    for (a, b) in all.step_by(stride.max(1)) {
        let off = (separation(a, dots) - separation(b, mirrored)).abs();
        if off > 2.0 * MIRROR_NEAR_RAD {
            continue;
        }
        let from = [&dots[a[0]], &dots[a[1]]];
        let to = [&mirrored[b[0]], &mirrored[b[1]]];
        let Some(rotation) = pair_rotation(from, to) else {
            continue;
        };
        let is_near = |d: &&Vec3| {
            let at = rotation * *d;
            mirrored.iter().any(|m| m.dot(&at) >= cosine)
        };
        let near = dots.iter().filter(is_near).count();
        found.push(Start { rotation, near });
    }
    found
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
