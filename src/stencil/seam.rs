//! The seam: great circles that stay far from all dots.
//!
//! Maximizing `min_i |n . d_i|` over unit normals `n` is a max-min problem whose maximum is
//! determined by one, two or three dots. There, with suitable signs, `s_i n . d_i` are equal and
//! `n` is a non-negative combination of the `s_i d_i`. All such candidates are enumerated, so the
//! best of them is the global maximum and needs no start value.

use crate::geometry::{Vec3, spiral_directions};

/// Candidates nearer to each other than this count as one, radians.
const SAME_RAD: f64 = 0.035;
/// Maximum number of candidates handed on.
const MAX: usize = 300;
/// Evenly spread planes added to the candidates, for patterns whose best planes leave no place for
/// a hinge.
const SPREAD: usize = 1000;

/// A great circle and its distance from the dots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seam {
    /// Unit normal in the pattern's frame; half A holds the dots with a positive product.
    pub normal: Vec3,
    /// Minimum angle between a dot's direction and the seam plane, radians.
    pub margin_rad: f64,
}

impl Seam {
    /// The seam with normal `n`, a unit vector.
    fn new(n: Vec3, dots: &[Vec3]) -> Self {
        let min_sine = dots.iter().map(|d| n.dot(d).abs()).fold(1.0, f64::min);
        Self {
            normal: n,
            margin_rad: min_sine.clamp(0.0, 1.0).asin(),
        }
    }

    /// The same plane with the normal turned so that half A holds the majority; of equals, the half
    /// that holds dot 0.
    fn with_majority(self, dots: &[Vec3]) -> Self {
        let above = dots.iter().filter(|d| d.dot(&self.normal) > 0.0).count();
        let fewer = 2 * above < dots.len();
        let first_below = dots.first().is_some_and(|d| d.dot(&self.normal) < 0.0);
        if fewer || (2 * above == dots.len() && first_below) {
            Self {
                normal: -self.normal,
                ..self
            }
        } else {
            self
        }
    }
}

/// Calls `consider` with every normal (not normalized) at which the margin can have its maximum.
fn enumerate(dots: &[Vec3], consider: &mut dyn FnMut(Vec3)) {
    let signs = [1.0, -1.0];
    for i in 0..dots.len() {
        consider(dots[i]);
        for j in 0..i {
            for sj in signs {
                let dj = sj * dots[j];
                consider(dots[i] + dj);
                for dk in &dots[..j] {
                    for sk in signs {
                        consider((dots[i] - dj).cross(&(dots[i] - sk * dk)));
                    }
                }
            }
        }
    }
}

/// The great circle that maximizes the minimum angle to the directions `dots`.
pub fn max_margin_seam(dots: &[Vec3]) -> Seam {
    let mut best = Seam {
        normal: Vec3::z(),
        margin_rad: -1.0,
    };
    enumerate(dots, &mut |n| {
        if let Some(n) = n.try_normalize(1e-9) {
            let seam = Seam::new(n, dots);
            if seam.margin_rad > best.margin_rad {
                best = seam;
            }
        }
    });
    best.with_majority(dots)
}

/// Different great circles, farthest from the dots first; the first is [`max_margin_seam`]'s.
pub(super) fn seam_candidates(dots: &[Vec3]) -> Vec<Seam> {
    let mut all = Vec::new();
    enumerate(dots, &mut |n| {
        if let Some(n) = n.try_normalize(1e-9) {
            all.push(Seam::new(n, dots));
        }
    });
    all.extend(spiral_directions(SPREAD).map(|n| Seam::new(n, dots)));
    all.sort_by(|a, b| b.margin_rad.total_cmp(&a.margin_rad));
    let mut kept: Vec<Seam> = Vec::new();
    for seam in all {
        let known = kept
            .iter()
            .any(|k| k.normal.dot(&seam.normal).abs() > SAME_RAD.cos());
        if !known {
            kept.push(seam.with_majority(dots));
            if kept.len() == MAX {
                break;
            }
        }
    }
    kept
}
