//! The painted surface: the values of faces at places all over the ball, and their slopes.

use super::face::Face;
use super::fit::Laid;
use crate::geometry::{Vec3, spiral_directions};

/// Places, 2 degrees apart.
pub const PLACES: usize = 10_000;
/// Places so near, radians, give the slope.
const SLOPE: f64 = 0.062;
/// Depth from which a view shows a place well enough to be kept.
const FACING: f64 = 0.4;
/// Depth from which it is seen well, and views by which those that show it less well are not needed.
const WELL: f64 = 0.6;
const ENOUGH: u32 = 3;
/// Steps of the values up to [`FARTHEST`] either way, of which the median is taken.
const STEPS: usize = 128;
const FARTHEST: f64 = 2.56;
/// Steps about the median whose mean is the place's brightness.
const ABOUT: usize = 4;
/// A running mean follows what is new: no more than so many views stand against it.
const MOST: f32 = 12.0;

/// A neighbor of a place and its part in the slope there.
#[derive(Debug, Clone, Copy)]
struct Neighbor {
    place: u32,
    weight: [f32; 3],
}

/// The places, which all surfaces share.
#[derive(Debug)]
pub(super) struct Grid {
    pub(super) directions: Vec<Vec3>,
    /// Where the neighbors of each place begin; they end where the next begin.
    first: Vec<u32>,
    neighbors: Vec<Neighbor>,
}

impl Default for Grid {
    fn default() -> Self {
        let directions: Vec<Vec3> = spiral_directions(PLACES).collect();
        let cos = SLOPE.cos();
        let (mut first, mut neighbors) = (vec![0], Vec::new());
        for place in &directions {
            // The spiral falls evenly in z, and directions differ by no more in z than by their angle.
            let from = directions.partition_point(|d| d.z > place.z + SLOPE);
            let near = directions.iter().enumerate().skip(from);
            let near = near.take_while(|(_, d)| d.z >= place.z - SLOPE);
            // On the plane, the slope by least squares is the sum of offset times difference over half the squared offsets.
            let about = neighbors.len();
            let mut squares: f64 = 0.0;
            for (k, other) in near.filter(|(_, d)| d.dot(place) > cos) {
                let off = other - place * other.dot(place);
                squares += 0.5 * off.norm_squared();
                neighbors.push(Neighbor {
                    place: k as u32,
                    weight: [off.x as f32, off.y as f32, off.z as f32],
                });
            }
            let scale = 1.0 / squares.max(1e-12) as f32;
            for neighbor in &mut neighbors[about..] {
                neighbor.weight = neighbor.weight.map(|w| w * scale);
            }
            first.push(neighbors.len() as u32);
        }
        Self {
            directions,
            first,
            neighbors,
        }
    }
}

/// A ball's paint, in the frame of the surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    pub(super) values: Vec<f32>,
    /// Views of each place; 0 where none shows it.
    pub(super) weights: Vec<f32>,
    /// `p x grad m` of each place.
    pub(super) turns: Vec<[f32; 3]>,
}

impl Surface {
    /// Nothing is known.
    pub(super) fn unknown() -> Self {
        Self {
            values: vec![0.0; PLACES],
            weights: vec![0.0; PLACES],
            turns: vec![[0.0; 3]; PLACES],
        }
    }

    /// Share of the ball that is known.
    pub fn known(&self) -> f64 {
        let known = self.weights.iter().filter(|w| **w > 0.0).count();
        known as f64 / PLACES as f64
    }

    /// Takes one more view in.
    pub(super) fn add(&mut self, grid: &Grid, face: &Face, laid: &Laid) {
        for (k, place) in grid.directions.iter().enumerate() {
            let seen = laid.rotation * place;
            let depth = face.depth(&seen);
            if depth < FACING {
                continue;
            }
            let value = face.at(&seen) as f32;
            let weight = (depth * depth) as f32;
            let sum = self.weights[k] + weight;
            self.values[k] += (value - self.values[k]) * weight / sum;
            self.weights[k] = sum.min(MOST);
        }
        self.slope(grid);
    }

    /// By all views: the median of each place's, so that what is before the ball in some of them leaves.
    pub(super) fn of<'a>(
        grid: &Grid,
        views: impl Iterator<Item = (&'a Face, &'a Laid)> + Clone,
    ) -> Self {
        let mut well = vec![[0u16; STEPS]; PLACES];
        let mut poorly = well.clone();
        for (face, laid) in views {
            let turn = laid.rotation.to_rotation_matrix();
            for (k, place) in grid.directions.iter().enumerate() {
                let seen = turn * place;
                let depth = face.depth(&seen);
                if depth < FACING {
                    continue;
                }
                let part = (face.at(&seen) + FARTHEST) / (2.0 * FARTHEST);
                let step = (part * STEPS as f64).max(0.0) as usize;
                let counts = if depth < WELL { &mut poorly } else { &mut well };
                let count = &mut counts[k][step.min(STEPS - 1)];
                *count = count.saturating_add(1);
            }
        }
        let mut surface = Self::unknown();
        let sum = |counts: &[u16; STEPS]| counts.iter().map(|n| u32::from(*n)).sum::<u32>();
        for (k, (well, poorly)) in well.iter_mut().zip(&poorly).enumerate() {
            if sum(well) < ENOUGH {
                for (all, more) in well.iter_mut().zip(poorly) {
                    *all = all.saturating_add(*more);
                }
            }
            let views = sum(well);
            if views > 0 {
                surface.values[k] = middle(well, views);
                surface.weights[k] = views as f32;
            }
        }
        surface.slope(grid);
        surface
    }

    pub(super) fn slope(&mut self, grid: &Grid) {
        for (k, place) in grid.directions.iter().enumerate() {
            if self.weights[k] <= 0.0 {
                continue;
            }
            let range = grid.first[k] as usize..grid.first[k + 1] as usize;
            let mut slope = [0.0f32; 3];
            for neighbor in &grid.neighbors[range] {
                let j = neighbor.place as usize;
                if self.weights[j] > 0.0 {
                    let step = self.values[j] - self.values[k];
                    for (s, w) in slope.iter_mut().zip(neighbor.weight) {
                        *s += step * w;
                    }
                }
            }
            let slope = Vec3::from(slope.map(f64::from));
            let turn = place.cross(&slope);
            self.turns[k] = [turn.x as f32, turn.y as f32, turn.z as f32];
        }
    }
}

/// The mean of what lies about the median.
fn middle(counts: &[u16; STEPS], views: u32) -> f32 {
    let (mut below, mut at) = (0, 0);
    for (step, count) in counts.iter().enumerate() {
        below += u32::from(*count);
        if 2 * below >= views {
            at = step;
            break;
        }
    }
    let near = at.saturating_sub(ABOUT)..(at + ABOUT + 1).min(STEPS);
    let (mut sum, mut count) = (0.0, 0.0);
    for step in near {
        let n = f32::from(counts[step]);
        sum += n * (step as f32 + 0.5);
        count += n;
    }
    FARTHEST as f32 * (2.0 * sum / count / STEPS as f32 - 1.0)
}
