//! The fewest dots that any view shows, exactly.
//!
//! Dot `d_i` is visible from the directions `v` with `d_i . v > limit`: those within its circle of
//! visibility `C_i`. The circles of all dots divide the sphere of directions into cells, and from all
//! directions of a cell the same dots are visible. Whoever crosses `C_i` outwards loses dot `i`, so a
//! cell with the fewest dots lies outside of every circle that bounds it. It is therefore enough to go
//! along each circle, just outside of it. On `C_i` dot `j`, at the angle `theta` from dot `i`, is
//! visible where
//!
//! ```text
//! cos(phi - phi_j) > limit tan(theta / 2) / sqrt(1 - limit^2),
//! ```
//!
//! an interval of the azimuth `phi` about that of dot `j`. The ends of these intervals, in order, divide
//! the circle into arcs, each beside one cell.
//!
//! Guaranteed: the minimum over all cells, in a time of `n^2 log n`. Arcs shorter than [`ROUNDING`] are
//! left out: where several circles meet in one point, rounding makes cells that are none.

use std::f64::consts::TAU;

use crate::geometry::{Vec3, tangent_frame};

/// An arc or an angle below this is taken for rounding, radians (6e-6 degrees): near where circles
/// touch, the ends of an interval are wrong by the root of a number's rounding.
const ROUNDING: f64 = 1e-7;

/// Minimum number of dots with `z > limit` over all viewing directions. Directions from which a dot is
/// exactly at the limit do not count.
pub(super) fn min_visible(dots: &[Vec3], limit: f64) -> usize {
    // No dot is visible, or from every direction but one.
    if limit >= 1.0 {
        return 0;
    }
    if limit <= -1.0 {
        return dots.len();
    }
    let mut ends = Vec::with_capacity(2 * dots.len());
    (0..dots.len())
        .map(|i| min_along_circle(dots, i, limit, &mut ends))
        .min()
        .unwrap_or(0)
}

/// Minimum number of visible dots just outside of one dot's circle. `ends` is memory.
fn min_along_circle(dots: &[Vec3], i: usize, limit: f64, ends: &mut Vec<(f64, i32)>) -> usize {
    let [a, b] = tangent_frame(&dots[i]);
    let steepness = limit / (1.0 - limit * limit).sqrt();
    ends.clear();
    // Visible at the azimuth 0, and from there on at each end.
    let mut visible = 0;
    for dot in dots
        .iter()
        .enumerate()
        .filter(|(j, _)| *j != i)
        .map(|(_, d)| d)
    {
        let (cos, x, y) = (dots[i].dot(dot), a.dot(dot), b.dot(dot));
        let sin = x.hypot(y);
        if sin < ROUNDING {
            // Opposite: both circles are concentric, and at a limit of 0 the same, dot `j` outside of it.
            visible += i32::from(limit <= 0.0);
            continue;
        }
        let cos_width = steepness * (1.0 - cos) / sin;
        if cos_width >= 1.0 {
            continue;
        }
        if cos_width <= -1.0 {
            visible += 1;
            continue;
        }
        let (middle, width) = (y.atan2(x), cos_width.acos());
        let [from, to] = [middle - width, middle + width].map(|end| end.rem_euclid(TAU));
        visible += i32::from(from > to);
        ends.extend([(from, 1), (to, -1)]);
    }
    if ends.is_empty() {
        return visible as usize;
    }
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let next = ends.iter().skip(1).map(|end| end.0);
    let next: Vec<f64> = next.chain([ends[0].0 + TAU]).collect();
    let mut fewest = i32::MAX;
    for ((at, step), next) in ends.iter().zip(next) {
        visible += step;
        if next - at > ROUNDING {
            fewest = fewest.min(visible);
        }
    }
    fewest as usize
}
