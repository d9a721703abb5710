//! A ball's orientation from where its dots may be, without first deciding what is a dot.
//!
//! A detector that is in doubt still knows more than its dots say: how likely each place of the ball shows one. With the
//! probability `q(c)` of a dot in cell `c` and the share `b` of cells that show one, the cell's pixels are `r(c) = q / (1 - q) (1 - b) / b`
//! times as likely with a dot as without. Where a share `m` of the dots cannot be seen, and a share `f` of the cells show what is
//! no dot of the pattern, an orientation has
//!
//! ```text
//! s(R) = sum over the visible dots j under R of  ln (m + (1 - m) r(c_j(R))) - ln (1 + f r(c_j(R)))
//! ```
//!
//! the logarithm of the ratio of the likelihoods of "the pattern is there, turned by R" and "dots lie anywhere". `s` is summed for
//! 60 000 orientations that cover all evenly (M. Alexa, "Super-Fibonacci Spirals", CVPR 2022) under two distances of the camera,
//! whose cells are tabulated; the best are then improved step by step. A template is matched with an image in the same way
//! (S. Hinterstoisser et al., "Gradient Response Maps", PAMI 34, 2012).
//!
//! The mirrored pattern is no ball's: its best orientation shows what chance alone reaches with these cells.

use crate::geometry::{Rotation, Vec3, spread_rotation};
use crate::vision::dots::heat::Heat;
use crate::vision::dots::patch::{MIDDLE, RADIUS};
use crate::vision::net::graph::CELLS;

/// Orientations tried: neighbors are some 6 degrees apart, one and a half cells in the ball's middle.
const ROTATIONS: usize = 60_000;
/// Share of the cells of a ball that show a dot.
const SHARE: f32 = 0.02;
/// Share of the cells that show what is no dot of the pattern.
const FALSE: f32 = 0.002;
/// Share of the facing dots that cannot be seen.
const MISSED: f32 = 0.2;
/// No cell is surer.
const SURE: f32 = 0.999;
/// Dots below this z are not counted.
const MIN_DEPTH: f64 = 0.2;
/// Distances of the camera that are tabulated, ball radii over distance.
const INVERSE_DISTANCES: [f64; 2] = [0.04, 0.14];
/// The best of these are improved, as far as none is next to a better one, of the pattern and of its mirror image each.
const CONSIDERED: usize = 64;
const IMPROVED: usize = 16;
/// So many are considered where pixels are matched: their sums have broad peaks.
const MANY: usize = 600;
/// Next to each other, radians: 9 degrees.
const BESIDE: f64 = 0.16;
/// First and last step of the improvement, radians: 4 and 0.5 degrees.
const STEPS: [f64; 2] = [0.07, 0.009];
/// Standard deviations of the outline's center per axis and of its radius, radii.
const SHIFT: f64 = 0.04;
const SCALE: f64 = 0.05;
/// Orientations that differ by more are different answers, radians: 20 degrees.
const DIFFERENT: f64 = 0.35;

/// What a dot in each cell of a patch adds to the logarithm of a likelihood.
pub(crate) type Terms = [f32; CELLS * CELLS];

/// The terms of a dot in each cell, where a dot up to so many cells beside it counts as the cell's.
fn terms_of(heat: &Heat, reach: usize, terms: &mut [f32; CELLS * CELLS]) {
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

/// The best orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DenseMatch {
    /// Pattern to view frame.
    pub rotation: Rotation,
    /// Ball radii over the camera's distance under which it was found.
    pub inverse_distance: f64,
    /// How far the ball's center lies to the right of the patch's and below it, radii.
    pub shift: [f64; 2],
    /// The ball's radius over that of the patch's circle.
    pub scale: f64,
    /// Its sum.
    pub score: f64,
    /// By how much it exceeds those of all other orientations and of the mirrored pattern.
    pub margin: f64,
}

/// A pattern, ready to be matched.
#[derive(Debug, Clone)]
pub struct DenseMatcher {
    dots: Vec<Vec3>,
    tables: [CellTable; 2],
}

/// The cells of the visible dots under each orientation, for one distance.
#[derive(Debug, Clone)]
struct CellTable {
    inverse_distance: f64,
    /// Where the cells of each orientation end.
    ends: Vec<u32>,
    cells: Vec<u16>,
}

/// Working memory of a [`DenseMatcher`].
#[derive(Debug, Clone)]
pub struct DenseWorkspace {
    terms: [f32; CELLS * CELLS],
    scores: Vec<(f32, u32)>,
    starts: Vec<Rotation>,
    found: Vec<Peak>,
}

impl Default for DenseWorkspace {
    fn default() -> Self {
        Self {
            terms: [0.0; CELLS * CELLS],
            scores: Vec::new(),
            starts: Vec::new(),
            found: Vec::new(),
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Peak {
    fit: Alignment,
    score: f64,
    is_mirrored: bool,
}

impl CellTable {
    fn new(dots: &[Vec3], inverse_distance: f64) -> Self {
        let mut ends = Vec::with_capacity(ROTATIONS);
        let mut cells = Vec::with_capacity(ROTATIONS * dots.len() / 2);
        let depth = min_depth(inverse_distance);
        for k in 0..ROTATIONS {
            let turn = rotation(k).to_rotation_matrix();
            for dot in dots {
                let seen = turn * dot;
                if seen.z > depth {
                    let at = cell(on_plane(&seen, inverse_distance));
                    let [column, row] = at.map(|x| (x.round().max(0.0) as usize).min(CELLS - 1));
                    cells.push((row * CELLS + column) as u16);
                }
            }
            ends.push(cells.len() as u32);
        }
        Self {
            inverse_distance,
            ends,
            cells,
        }
    }

    fn score_into(&self, terms: &[f32; CELLS * CELLS], scores: &mut Vec<(f32, u32)>) {
        scores.clear();
        let mut start = 0;
        scores.extend(self.ends.iter().enumerate().map(|(k, &end)| {
            let cells = &self.cells[start..end as usize];
            start = end as usize;
            // A power of two: the index needs no check.
            let term = |&c: &u16| terms[usize::from(c) % (CELLS * CELLS)];
            (cells.iter().map(term).sum(), k as u32)
        }));
    }
}

impl DenseMatcher {
    /// For a pattern's dots (unit vectors, pattern frame). Takes some 50 ms and 2 bytes for each orientation and visible dot.
    pub fn new(dots: &[Vec3]) -> Self {
        Self {
            dots: dots.to_vec(),
            tables: INVERSE_DISTANCES.map(|k| CellTable::new(dots, k)),
        }
    }

    /// The best orientation under a camera whose distance is known, or one that may stand anywhere.
    pub fn best(
        &self,
        heat: &Heat,
        inverse_distance: Option<f64>,
        ws: &mut DenseWorkspace,
    ) -> Option<DenseMatch> {
        ws.found.clear();
        for is_mirrored in [false, true] {
            terms_of(heat, 1, &mut ws.terms);
            if is_mirrored {
                // The mirrored pattern in this patch is the pattern in the mirrored patch.
                ws.terms.chunks_mut(CELLS).for_each(<[f32]>::reverse);
            }
            for table in self.in_question(inverse_distance) {
                table.score_into(&ws.terms, &mut ws.scores);
                self.improve_best(table, inverse_distance, is_mirrored, ws);
            }
        }
        let by_score = |a: &&Peak, b: &&Peak| a.score.total_cmp(&b.score);
        let best = *ws
            .found
            .iter()
            .filter(|f| !f.is_mirrored)
            .max_by(by_score)?;
        let is_other =
            |f: &&Peak| f.is_mirrored || f.fit.rotation.angle_to(&best.fit.rotation) > DIFFERENT;
        let others = ws.found.iter().filter(is_other).map(|f| f.score);
        let others = others.fold(0.0, f64::max);
        terms_of(heat, 0, &mut ws.terms);
        let (fit, _) = self.improve(&ws.terms, best.fit);
        Some(DenseMatch {
            rotation: fit.rotation,
            inverse_distance: fit.inverse_distance,
            shift: fit.shift,
            scale: fit.scale,
            score: best.score,
            margin: best.score - others,
        })
    }

    /// Improves the best of the orientations tried that are not next to each other.
    fn improve_best(
        &self,
        table: &CellTable,
        inverse_distance: Option<f64>,
        is_mirrored: bool,
        ws: &mut DenseWorkspace,
    ) {
        ws.starts.clear();
        best_apart(&mut ws.scores, CONSIDERED, IMPROVED, &mut ws.starts);
        let at = inverse_distance.unwrap_or(table.inverse_distance);
        for &start in &ws.starts {
            let (fit, score) = self.improve(&ws.terms, Alignment::new(start, at));
            ws.found.push(Peak {
                fit,
                score,
                is_mirrored,
            });
        }
    }

    /// Adds the best of the orientations tried that are not next to each other or to those that are there, up to so many
    /// in all, for a camera at `1 / inverse_distance` radii.
    pub(crate) fn starts(
        &self,
        terms: &Terms,
        inverse_distance: f64,
        count: usize,
        ws: &mut DenseWorkspace,
        starts: &mut Vec<Rotation>,
    ) {
        let [far, near] = &self.tables;
        let middle = 0.5 * (far.inverse_distance + near.inverse_distance);
        let table = if inverse_distance < middle { far } else { near };
        table.score_into(terms, &mut ws.scores);
        best_apart(&mut ws.scores, MANY, count, starts);
    }

    /// The tables nearest to a distance.
    fn in_question(&self, inverse_distance: Option<f64>) -> &[CellTable] {
        let [far, near] = INVERSE_DISTANCES;
        match inverse_distance {
            None => &self.tables,
            Some(k) if k < 0.5 * (far + near) => &self.tables[..1],
            Some(_) => &self.tables[1..],
        }
    }

    /// Turns about each axis, shifts and scales, as long as that gains, by ever smaller steps.
    fn improve(&self, terms: &[f32; CELLS * CELLS], start: Alignment) -> (Alignment, f64) {
        let mut best = (start, self.score(terms, &start));
        let mut step = STEPS[0];
        while step > STEPS[1] {
            let before = best.1;
            for parameter in 0..6 {
                for change in [step, -step] {
                    let fit = best.0.changed(parameter, change);
                    let score = self.score(terms, &fit);
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
    fn score(&self, terms: &[f32; CELLS * CELLS], fit: &Alignment) -> f64 {
        let turn = fit.rotation.to_rotation_matrix();
        let k = fit.inverse_distance;
        let depth = min_depth(k);
        let seen = self.dots.iter().map(|dot| turn * dot);
        let terms = seen.filter(|d| d.z > depth).map(|d| {
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
        terms.sum::<f64>() - 0.5 * off
    }
}

/// What is improved.
#[derive(Debug, Clone, Copy)]
struct Alignment {
    rotation: Rotation,
    inverse_distance: f64,
    shift: [f64; 2],
    scale: f64,
}

impl Alignment {
    fn new(rotation: Rotation, inverse_distance: f64) -> Self {
        Self {
            rotation,
            inverse_distance,
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

/// Least z of a dot that is counted.
fn min_depth(inverse_distance: f64) -> f64 {
    MIN_DEPTH.max(inverse_distance + 0.05)
}

/// Where a direction (view frame) is seen by a camera at `1 / k` radii: to the right and down, radii.
fn on_plane(direction: &Vec3, k: f64) -> [f64; 2] {
    let scale = (1.0 - k * k).sqrt() / (1.0 - k * direction.z);
    [direction.x * scale, -direction.y * scale]
}

/// Adds the best of some scored orientations that are not next to each other or to those that are there, up to `count` in all; so many
/// are considered.
fn best_apart(
    scores: &mut [(f32, u32)],
    considered: usize,
    count: usize,
    starts: &mut Vec<Rotation>,
) {
    let by_score = |a: &(f32, u32), b: &(f32, u32)| b.0.total_cmp(&a.0).then_with(|| a.1.cmp(&b.1));
    scores.select_nth_unstable_by(considered, by_score);
    let considered = &mut scores[..considered];
    considered.sort_unstable_by(by_score);
    for &(_, k) in &*considered {
        let start = rotation(k as usize);
        let is_beside = |r: &Rotation| r.angle_to(&start) < BESIDE;
        if starts.len() < count && !starts.iter().any(is_beside) {
            starts.push(start);
        }
    }
}

/// The place of a cell: to the right and down, radii.
pub(crate) fn place(column: usize, row: usize) -> [f64; 2] {
    [column, row].map(|k| (2.0 * k as f64 + 0.5 - MIDDLE) / RADIUS)
}

/// The column and row of a place, in cells.
fn cell(place: [f64; 2]) -> [f64; 2] {
    // A cell is two values wide, the first one's middle at 0.5.
    place.map(|x| 0.5 * (MIDDLE + RADIUS * x - 0.5))
}

/// The k-th of [`ROTATIONS`] orientations.
fn rotation(k: usize) -> Rotation {
    spread_rotation(k, ROTATIONS)
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
    fn an_orientation_is_found_though_dots_are_missing_and_the_outline_is_off() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let designs = shipped_designs().expect("the shipped designs");
        let design = designs.iter().find(|d| d.name == "dots20");
        let pattern = &design.expect("a shipped design").pattern;
        let matcher = DenseMatcher::new(pattern.dots());
        let mut ws = DenseWorkspace::default();
        for trial in 0..20 {
            let truth = random_rotation(&mut rng);
            let k = if trial % 2 == 0 { 0.05 } else { 0.15 };
            let missing = trial % 3;
            let heat = seen(pattern.dots(), &truth, k, [0.03, -0.02], missing);
            for known in [None, Some(k)] {
                let found = matcher.best(&heat, known, &mut ws).expect("an orientation");
                let error = found.rotation.angle_to(&truth);
                // Near the ball some seven dots are visible: without one of them, others may explain as much.
                let is_clear = missing == 0 && k < 0.1;
                assert!(!is_clear || found.margin > 1.0, "{trial}: {found:?}");
                assert!(
                    found.margin < 1.0 || error < 0.17,
                    "{trial}: {error} rad, {found:?}"
                );
            }
        }
    }

    #[test]
    fn a_mirrored_ball_and_a_blank_one_have_no_margin() {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let pattern = random_pattern(20, 0.3, &mut rng).expect("a pattern");
        let matcher = DenseMatcher::new(pattern.dots());
        let mirrored: Vec<Vec3> = pattern
            .dots()
            .iter()
            .map(|d| Vec3::new(-d.x, d.y, d.z))
            .collect();
        let mut ws = DenseWorkspace::default();
        for _ in 0..10 {
            let turn = random_rotation(&mut rng);
            let heat = seen(&mirrored, &turn, 0.05, [0.0; 2], 0);
            let found = matcher.best(&heat, None, &mut ws).expect("an orientation");
            assert!(found.margin < 0.0, "{found:?}");
        }
        let found = matcher
            .best(&Heat::default(), None, &mut ws)
            .expect("an orientation");
        assert!(found.margin <= 0.0, "{found:?}");
    }

    #[test]
    fn every_orientation_is_near_one_that_is_tried() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let all: Vec<Rotation> = (0..ROTATIONS).map(rotation).collect();
        for _ in 0..100 {
            let any = random_rotation(&mut rng);
            let nearest = all
                .iter()
                .map(|r| r.angle_to(&any))
                .fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.14, "{nearest} rad");
        }
    }
}
