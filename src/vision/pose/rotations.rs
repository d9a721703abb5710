//! All rotations searched for the one that an image of the ball speaks for, without first deciding what is a dot.
//!
//! A source says what a dot in each cell of a patch about the ball adds to the logarithm of a likelihood: what a detector makes of each
//! cell ([`places`](super::places)), or the pixels of a small ball ([`pixels`](super::pixels)). Of a rotation `R` the terms of its
//! visible dots are summed,
//!
//! ```text
//! s(R) = sum over the visible dots j under R of  t(cell of dot j under R)
//! ```
//!
//! for 60 000 rotations that cover all evenly (M. Alexa, "Super-Fibonacci Spirals", CVPR 2022) under two distances of the camera,
//! whose cells are tabulated. The best that are not next to each other are fitted as the source does. A template is matched with an image in the same way
//! (S. Hinterstoisser et al., "Gradient Response Maps", PAMI 34, 2012).
//!
//! The mirrored pattern is no ball's: its best rotation shows what chance alone reaches with these cells.

use crate::geometry::{Rotation, Vec3, spread_rotation};
use crate::vision::dots::patch::{MIDDLE, RADIUS};
use crate::vision::net::graph::CELLS;

/// Rotations tried: neighbors are some 6 degrees apart, one and a half cells in the ball's middle.
const ROTATIONS: usize = 60_000;
/// Dots below this z are not counted.
const MIN_DEPTH: f64 = 0.2;
/// Distances of the camera that are tabulated, ball radii over distance.
const INVERSE_DISTANCES: [f64; 2] = [0.04, 0.14];
/// So many of the best, none of them next to a better one, are fitted, of the pattern and of its mirror image each.
pub(super) const STARTS: usize = 16;
/// Next to each other, radians: 9 degrees.
const BESIDE: f64 = 0.16;
/// Rotations that differ by more are different answers, radians: 20 degrees.
const DIFFERENT: f64 = 0.35;

/// What a dot in each cell of a patch adds to the logarithm of a likelihood.
pub(super) type Terms = [f32; CELLS * CELLS];

/// A rotation to be fitted, under a camera at `1 / inverse_distance` radii.
#[derive(Debug, Clone, Copy)]
pub(super) struct TriedRotation {
    /// Pattern to view frame.
    pub rotation: Rotation,
    pub inverse_distance: f64,
    /// Whether it is one of the mirrored ball, in which the mirrored pattern is the pattern.
    pub is_mirrored: bool,
}

/// What was fitted to a rotation that was tried.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RotationMatch<F> {
    pub fit: F,
    pub is_mirrored: bool,
    /// The logarithm of its likelihood, but for a constant.
    pub score: f64,
}

/// The best match of the pattern, and the best score of all other rotations and of the mirrored pattern.
pub(super) fn best<F: Copy>(
    found: &[RotationMatch<F>],
    rotation: impl Fn(&F) -> Rotation,
) -> Option<(RotationMatch<F>, Option<f64>)> {
    let of_pattern = found.iter().filter(|m| !m.is_mirrored);
    let best = *of_pattern.max_by(|a, b| a.score.total_cmp(&b.score))?;
    let answer = rotation(&best.fit);
    let is_other =
        |m: &&RotationMatch<F>| m.is_mirrored || rotation(&m.fit).angle_to(&answer) > DIFFERENT;
    let others = found.iter().filter(is_other).map(|m| m.score);
    Some((best, others.max_by(f64::total_cmp)))
}

/// A pattern, ready to be searched for.
#[derive(Debug, Clone)]
pub(crate) struct RotationSearch {
    tables: [CellTable; 2],
}

/// The cells of the visible dots under each rotation, for one distance.
#[derive(Debug, Clone)]
struct CellTable {
    inverse_distance: f64,
    min_depth: f64,
    /// Where the cells of each rotation end.
    ends: Vec<u32>,
    cells: Vec<u16>,
}

/// Working memory of a [`RotationSearch`].
#[derive(Debug, Clone)]
pub(crate) struct SearchWorkspace {
    pub(super) terms: Terms,
    scores: Vec<(f32, u32)>,
    starts: Vec<Rotation>,
}

impl Default for SearchWorkspace {
    fn default() -> Self {
        Self {
            terms: [0.0; CELLS * CELLS],
            scores: Vec::new(),
            // Those proposed, too: they are fewer.
            starts: Vec::with_capacity(2 * STARTS),
        }
    }
}

impl RotationSearch {
    /// For a pattern's dots (unit vectors, pattern frame). Takes some 30 ms and 2 bytes for each rotation and visible dot.
    pub fn new(dots: &[Vec3]) -> Self {
        let mut tables = INVERSE_DISTANCES.map(|k| CellTable::with_room(dots.len(), k));
        for k in 0..ROTATIONS {
            let turn = rotation(k).to_rotation_matrix();
            for dot in dots {
                let seen = turn * dot;
                tables.iter_mut().for_each(|table| table.see(&seen));
            }
            tables.iter_mut().for_each(CellTable::end);
        }
        Self { tables }
    }

    /// Fits the best rotations by the workspace's terms and those `proposed`, for a camera whose distance is known or one that may stand
    /// anywhere. So many of the best are `considered` for those that are not next to each other.
    pub(super) fn fit_best<F>(
        &self,
        inverse_distance: Option<f64>,
        considered: usize,
        proposed: impl Iterator<Item = Rotation>,
        ws: &mut SearchWorkspace,
        found: &mut Vec<RotationMatch<F>>,
        mut fit: impl FnMut(TriedRotation, &Terms) -> Option<(F, f64)>,
    ) {
        let SearchWorkspace {
            terms,
            scores,
            starts,
        } = ws;
        found.clear();
        starts.clear();
        starts.extend(proposed);
        for is_mirrored in [false, true] {
            for table in self.in_question(inverse_distance) {
                table.score_into(terms, scores);
                best_apart(scores, considered, starts);
                let inverse_distance = inverse_distance.unwrap_or(table.inverse_distance);
                found.extend(starts.drain(..).filter_map(|rotation| {
                    let start = TriedRotation {
                        rotation,
                        inverse_distance,
                        is_mirrored,
                    };
                    let (fit, score) = fit(start, terms)?;
                    Some(RotationMatch {
                        fit,
                        is_mirrored,
                        score,
                    })
                }));
            }
            // The mirrored pattern in this patch is the pattern in the mirrored patch.
            terms.chunks_mut(CELLS).for_each(<[f32]>::reverse);
        }
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
}

impl CellTable {
    fn with_room(dots: usize, inverse_distance: f64) -> Self {
        Self {
            inverse_distance,
            min_depth: min_depth(inverse_distance),
            ends: Vec::with_capacity(ROTATIONS),
            cells: Vec::with_capacity(ROTATIONS * dots / 2),
        }
    }

    /// Adds the cell of a dot (view frame) to the rotation in hand, where it is visible.
    fn see(&mut self, dot: &Vec3) {
        if dot.z > self.min_depth {
            let at = cell(on_plane(dot, self.inverse_distance));
            // What is cut off makes it the nearest.
            let [column, row] = at.map(|x| ((x + 0.5).max(0.0) as usize).min(CELLS - 1));
            self.cells.push((row * CELLS + column) as u16);
        }
    }

    /// The rotation in hand is whole.
    fn end(&mut self) {
        self.ends.push(self.cells.len() as u32);
    }

    fn score_into(&self, terms: &Terms, scores: &mut Vec<(f32, u32)>) {
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

/// Adds [`STARTS`] of the best of some scored rotations that are not next to each other or to those that are there; so many are
/// considered.
fn best_apart(scores: &mut [(f32, u32)], considered: usize, starts: &mut Vec<Rotation>) {
    let by_score = |a: &(f32, u32), b: &(f32, u32)| b.0.total_cmp(&a.0).then_with(|| a.1.cmp(&b.1));
    scores.select_nth_unstable_by(considered, by_score);
    let considered = &mut scores[..considered];
    considered.sort_unstable_by(by_score);
    let count = starts.len() + STARTS;
    for &(_, k) in &*considered {
        let start = rotation(k as usize);
        let is_beside = |r: &Rotation| r.angle_to(&start) < BESIDE;
        if starts.len() < count && !starts.iter().any(is_beside) {
            starts.push(start);
        }
    }
}

/// Least z of a dot that is counted.
pub(super) fn min_depth(inverse_distance: f64) -> f64 {
    MIN_DEPTH.max(inverse_distance + 0.05)
}

/// Where a direction (view frame) is seen by a camera at `1 / k` radii: to the right and down, radii.
pub(super) fn on_plane(direction: &Vec3, k: f64) -> [f64; 2] {
    let scale = (1.0 - k * k).sqrt() / (1.0 - k * direction.z);
    [direction.x * scale, -direction.y * scale]
}

/// The place of a cell: to the right and down, radii.
pub(super) fn place(column: usize, row: usize) -> [f64; 2] {
    [column, row].map(|k| (2.0 * k as f64 + 0.5 - MIDDLE) / RADIUS)
}

/// The column and row of a place, in cells.
pub(super) fn cell(place: [f64; 2]) -> [f64; 2] {
    // A cell is two values wide, the first one's middle at 0.5.
    place.map(|x| 0.5 * (MIDDLE + RADIUS * x - 0.5))
}

/// The k-th of [`ROTATIONS`] rotations.
fn rotation(k: usize) -> Rotation {
    spread_rotation(k, ROTATIONS)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::geometry::random_rotation;

    #[test]
    fn every_rotation_is_near_one_that_is_tried() {
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
