//! Where to part the ball: the great circle that stays farthest from all dots.
//!
//! Maximizing `min_i |n . d_i|` over unit normals `n` is a max-min problem whose maximum is held down
//! by one, two or three dots: there, with suitable signs, `s_i n . d_i` are equal and `n` is a
//! non-negative combination of the `s_i d_i`. All such candidates are enumerated, so the result is the
//! global maximum and needs no start value.

use crate::geometry::Vec3;

/// A great circle and its distance from the dots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seam {
    /// Unit normal in the pattern's frame; half A holds the dots with a positive product.
    pub normal: Vec3,
    /// Least angle between a dot's direction and the seam plane, radians.
    pub margin_rad: f64,
}

/// The great circle that maximizes the least angle to the directions `dots`.
pub fn max_margin_seam(dots: &[Vec3]) -> Seam {
    let mut best = (Vec3::z(), -1.0);
    let mut consider = |n: Vec3| {
        let Some(n) = n.try_normalize(1e-9) else {
            return;
        };
        let mut least = 1.0;
        for d in dots {
            least = f64::min(least, n.dot(d).abs());
            if least <= best.1 {
                return;
            }
        }
        best = (n, least);
    };
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
    let (mut normal, sine) = best;
    // Half A holds the majority; of equals, the half that holds dot 0.
    let above = dots.iter().filter(|d| d.dot(&normal) > 0.0).count();
    let fewer = 2 * above < dots.len();
    let tie = 2 * above == dots.len() && dots.first().is_some_and(|d| d.dot(&normal) < 0.0);
    if fewer || tie {
        normal = -normal;
    }
    Seam {
        normal,
        margin_rad: sine.clamp(0.0, 1.0).asin(),
    }
}
