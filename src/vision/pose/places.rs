//! A ball's rotation from where its dots may be.
//!
//! A detector that is in doubt still knows more than its dots say: how likely each place of the ball shows one. With the
//! probability `q(c)` of a dot in cell `c` and the share `b` of cells that show one, the cell's pixels are `r(c) = q / (1 - q) (1 - b) / b`
//! times as likely with a dot as without. Where a share `m` of the dots cannot be seen, and a share `f` of the cells show what is
//! no dot of the pattern, a dot in cell `c` adds
//!
//! ```text
//! t(c) = ln (m + (1 - m) r(c)) - ln (1 + f r(c))
//! ```
//!
//! the logarithm of the ratio of the likelihoods of "the pattern is there, turned by R" and "dots lie anywhere". All rotations are
//! searched ([`rotations`](super::rotations)); the best are improved step by step, with the outline.

use super::rotations::{
    self, RotationMatch, RotationSearch, SearchWorkspace, Terms, TriedRotation, cell, min_depth,
    on_plane,
};
use super::trust::PlacesEvidence;
use crate::geometry::{Rotation, Vec3};
use crate::vision::dots::heat::Heat;
use crate::vision::net::graph::CELLS;

/// Share of the cells of a ball that show a dot.
const SHARE: f32 = 0.02;
/// Share of the cells that show what is no dot of the pattern.
const FALSE: f32 = 0.002;
/// Share of the facing dots that cannot be seen.
const MISSED: f32 = 0.2;
/// No cell is surer.
const SURE: f32 = 0.999;
/// So many of the best rotations are considered for those that are not next to each other.
const CONSIDERED: usize = 64;
/// First and last step of the improvement, radians: 4 and 0.5 degrees.
const STEPS: [f64; 2] = [0.07, 0.009];
/// Standard deviations of the outline's center per axis and of its radius, radii.
const SHIFT: f64 = 0.04;
const SCALE: f64 = 0.05;

/// The terms of a dot in each cell, where a dot up to so many cells beside it counts as the cell's.
fn fill_terms(heat: &Heat, reach: usize, terms: &mut Terms) {
    let largest_beside = |row: usize, column: usize| {
        let rows = row.saturating_sub(reach)..(row + reach + 1).min(CELLS);
        let columns = column.saturating_sub(reach)..(column + reach + 1).min(CELLS);
        rows.flat_map(|r| heat.values()[r * CELLS..][columns.clone()].iter())
            .fold(0.0f32, |a, b| a.max(*b))
    };
    for row in 0..CELLS {
        for column in 0..CELLS {
            let q = largest_beside(row, column).min(SURE);
            let ratio = q / (1.0 - q) * (1.0 - SHARE) / SHARE;
            let explained = MISSED + (1.0 - MISSED) * ratio;
            terms[row * CELLS + column] = (explained / (1.0 + FALSE * ratio)).ln();
        }
    }
}

/// A rotation with the outline about which its terms are summed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PosedOutline {
    /// Pattern to view frame.
    pub rotation: Rotation,
    /// Ball radii over the camera's distance.
    pub inverse_distance: f64,
    /// How far the ball's center lies to the right of the patch's and below it, radii.
    pub shift: [f64; 2],
    /// The ball's radius over that of the patch's circle.
    pub scale: f64,
}

/// The best rotation of the dots under a camera whose distance is known, or one that may stand anywhere.
pub(super) fn best(
    dots: &[Vec3],
    heat: &Heat,
    inverse_distance: Option<f64>,
    search: &RotationSearch,
    ws: &mut SearchWorkspace,
    found: &mut Vec<RotationMatch<PosedOutline>>,
) -> Option<(PosedOutline, PlacesEvidence)> {
    fill_terms(heat, 1, &mut ws.terms);
    let (at, none) = (inverse_distance, std::iter::empty());
    search.fit_best(at, CONSIDERED, none, ws, found, |start, terms| {
        Some(improve(dots, terms, PosedOutline::new(&start)))
    });
    let (best, others) = rotations::best(found, |fit| fit.rotation)?;
    fill_terms(heat, 0, &mut ws.terms);
    let evidence = PlacesEvidence {
        score: best.score,
        margin: best.score - others.unwrap_or(0.0).max(0.0),
    };
    Some((improve(dots, &ws.terms, best.fit).0, evidence))
}

/// Turns about each axis, shifts and scales, as long as that gains, by ever smaller steps.
fn improve(dots: &[Vec3], terms: &Terms, start: PosedOutline) -> (PosedOutline, f64) {
    let mut best = (start, score(dots, terms, &start));
    let mut step = STEPS[0];
    while step > STEPS[1] {
        let before = best.1;
        for parameter in 0..6 {
            for change in [step, -step] {
                let fit = best.0.changed(parameter, change);
                let score = score(dots, terms, &fit);
                if score > best.1 {
                    best = (fit, score);
                }
            }
        }
        if best.1 <= before {
            step *= 0.5;
        }
    }
    best
}

/// The sum for any orientation and outline, terms interpolated between cells, less what the outline is off by.
fn score(dots: &[Vec3], terms: &Terms, fit: &PosedOutline) -> f64 {
    let turn = fit.rotation.to_rotation_matrix();
    let k = fit.inverse_distance;
    let depth = min_depth(k);
    let seen = dots.iter().map(|dot| turn * dot);
    let values = seen.filter(|d| d.z > depth).map(|d| {
        let [x, y] = on_plane(&d, k);
        let x = fit.scale * x + fit.shift[0];
        let y = fit.scale * y + fit.shift[1];
        let [column, row] = cell([x, y]).map(|x| x.clamp(0.0, (CELLS - 1) as f64 - 1e-6));
        let (i, j) = (column as usize, row as usize);
        let (x, y) = ((column - i as f64) as f32, (row - j as f64) as f32);
        let at = |j: usize, i: usize| terms[j * CELLS + i];
        let mix = |j: usize| at(j, i) * (1.0 - x) + at(j, i + 1) * x;
        f64::from(mix(j) * (1.0 - y) + mix(j + 1) * y)
    });
    let [x, y] = fit.shift;
    let off = (x * x + y * y) / (SHIFT * SHIFT) + ((fit.scale - 1.0) / SCALE).powi(2);
    values.sum::<f64>() - 0.5 * off
}

impl PosedOutline {
    fn new(start: &TriedRotation) -> Self {
        Self {
            rotation: start.rotation,
            inverse_distance: start.inverse_distance,
            shift: [0.0; 2],
            scale: 1.0,
        }
    }

    fn changed(mut self, parameter: usize, by: f64) -> Self {
        let axis = |axis: Vec3| Rotation::from_scaled_axis(axis * by) * self.rotation;
        match parameter {
            0 => self.rotation = axis(Vec3::x()),
            1 => self.rotation = axis(Vec3::y()),
            2 => self.rotation = axis(Vec3::z()),
            3 => self.shift[0] += by,
            4 => self.shift[1] += by,
            _ => self.scale += by,
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::geometry::random_rotation;
    use crate::pattern::{random_pattern, shipped_designs};

    /// The probabilities of a perfect detector: a peak at each visible dot.
    fn seen(dots: &[Vec3], rotation: &Rotation, k: f64, shift: [f64; 2], missing: usize) -> Heat {
        let mut values = [0.01f32; CELLS * CELLS];
        let in_sight = dots.iter().map(|d| rotation * d);
        let in_sight = in_sight.filter(|d| d.z > min_depth(k)).skip(missing);
        for [x, y] in in_sight.map(|d| on_plane(&d, k)) {
            let [column, row] = cell([x + shift[0], y + shift[1]]);
            for (at, value) in values.iter_mut().enumerate() {
                let (u, v) = ((at % CELLS) as f64 - column, (at / CELLS) as f64 - row);
                *value = value.max((-0.5 * (u * u + v * v)).exp() as f32);
            }
        }
        let mut heat = Heat::default();
        heat.fill(values.into_iter());
        heat
    }

    #[test]
    fn a_rotation_is_found_though_dots_are_missing_and_the_outline_is_off() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let designs = shipped_designs().expect("the shipped designs");
        let design = designs.iter().find(|d| d.name == "dots20");
        let pattern = &design.expect("a shipped design").pattern;
        let search = RotationSearch::new(pattern.dots());
        let mut ws = SearchWorkspace::default();
        let mut all = Vec::new();
        for trial in 0..20 {
            let truth = random_rotation(&mut rng);
            let k = if trial % 2 == 0 { 0.05 } else { 0.15 };
            let missing = trial % 3;
            let heat = seen(pattern.dots(), &truth, k, [0.03, -0.02], missing);
            for known in [None, Some(k)] {
                let (fit, evidence) =
                    best(pattern.dots(), &heat, known, &search, &mut ws, &mut all)
                        .expect("a rotation");
                let error = fit.rotation.angle_to(&truth);
                // Near the ball some seven dots are visible: without one of them, others may explain as much.
                let is_clear = missing == 0 && k < 0.1;
                assert!(!is_clear || evidence.margin > 1.0, "{trial}: {evidence:?}");
                assert!(
                    evidence.margin < 1.0 || error < 0.17,
                    "{trial}: {error} rad, {evidence:?}"
                );
            }
        }
    }

    #[test]
    fn a_mirrored_ball_and_a_blank_one_have_no_margin() {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let pattern = random_pattern(20, 0.3, &mut rng).expect("a pattern");
        let search = RotationSearch::new(pattern.dots());
        let mirrored: Vec<Vec3> = pattern
            .dots()
            .iter()
            .map(|d| Vec3::new(-d.x, d.y, d.z))
            .collect();
        let mut ws = SearchWorkspace::default();
        let mut all = Vec::new();
        for _ in 0..10 {
            let turn = random_rotation(&mut rng);
            let heat = seen(&mirrored, &turn, 0.05, [0.0; 2], 0);
            let (_, evidence) =
                best(pattern.dots(), &heat, None, &search, &mut ws, &mut all).expect("a rotation");
            assert!(evidence.margin < 0.0, "{evidence:?}");
        }
        let (_, evidence) = best(
            pattern.dots(),
            &Heat::default(),
            None,
            &search,
            &mut ws,
            &mut all,
        )
        .expect("a rotation");
        assert!(evidence.margin <= 0.0, "{evidence:?}");
    }
}
