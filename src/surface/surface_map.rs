//! The painted surface: the values of faces at places all over the ball, and their slopes.

use super::face::Face;
use super::laid::{ALIGNED, Laid};
use super::viewed::{Facing, ViewedPlaces};
use crate::geometry::{Rotation, Vec3, spiral_directions};

/// Places, 2 degrees apart.
pub const PLACES: usize = 10_000;
/// Places so near, radians, give the slope.
const SLOPE: f64 = 0.062;
/// The steepest places: those on which faces are laid.
const STEEP: usize = 4_000;
/// By every so many-th place a face is compared with the surface.
const COMPARED: usize = 2;
/// Views of a place that count.
const FACING: Facing = Facing {
    well: 0.6,
    least: ALIGNED,
    enough: 3,
};
/// A running mean follows what is new: no more than so many views stand against it.
const MOST: f32 = 12.0;

/// A neighbor of a place and its part in the slope there.
#[derive(Debug, Clone, Copy)]
struct SlopeTerm {
    place: u32,
    weight: [f32; 3],
}

/// The places, which all surfaces share.
#[derive(Debug)]
pub(crate) struct PlaceGrid {
    pub(crate) directions: Vec<Vec3>,
    /// Where the neighbors of each place begin; they end where the next begin.
    first: Vec<u32>,
    neighbors: Vec<SlopeTerm>,
}

impl Default for PlaceGrid {
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
                neighbors.push(SlopeTerm {
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

impl PlaceGrid {
    /// Places all over the ball by which a face is compared with the surface.
    pub(crate) fn compared(&self) -> impl Iterator<Item = (usize, &Vec3)> {
        self.directions.iter().enumerate().step_by(COMPARED)
    }
}

/// A ball's paint, in the frame of the surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceMap {
    pub(crate) values: Vec<f32>,
    /// Views of each place; 0 where none shows it.
    pub(crate) weights: Vec<f32>,
    /// `p x grad m` of each place.
    pub(crate) turns: Vec<[f32; 3]>,
    /// The steepest places.
    pub(crate) steep: Vec<u32>,
}

impl SurfaceMap {
    /// Nothing is known.
    pub(crate) fn unknown() -> Self {
        Self {
            values: vec![0.0; PLACES],
            weights: vec![0.0; PLACES],
            turns: vec![[0.0; 3]; PLACES],
            steep: Vec::new(),
        }
    }

    /// Share of the ball that is known.
    pub fn known(&self) -> f64 {
        let known = self.weights.iter().filter(|w| **w > 0.0).count();
        known as f64 / self.weights.len() as f64
    }

    /// Takes one more view in.
    pub(crate) fn add(&mut self, grid: &PlaceGrid, face: &Face, laid: &Laid) {
        for (k, place) in grid.directions.iter().enumerate() {
            let seen = laid.rotation * place;
            let depth = face.depth(&seen);
            if depth < ALIGNED {
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

    /// By all views.
    pub(crate) fn of(grid: &PlaceGrid, views: &[(&Face, Rotation)]) -> Self {
        let map = ViewedPlaces::new(&grid.directions, views, FACING);
        let mut surface = Self {
            values: map.values().to_vec(),
            weights: map.views().iter().map(|n| *n as f32).collect(),
            ..Self::unknown()
        };
        surface.slope(grid);
        surface
    }

    pub(crate) fn slope(&mut self, grid: &PlaceGrid) {
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
        self.find_steep();
    }

    fn find_steep(&mut self) {
        let steepness = |k: &u32| self.turns[*k as usize].iter().map(|t| t * t).sum::<f32>();
        let known = (0..self.weights.len() as u32).filter(|k| self.weights[*k as usize] > 0.0);
        let mut steep: Vec<u32> = known.collect();
        if steep.len() > STEEP {
            steep.select_nth_unstable_by(STEEP, |a, b| steepness(b).total_cmp(&steepness(a)));
            steep.truncate(STEEP);
        }
        steep.sort_unstable();
        self.steep = steep;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a value that grows along a line through the ball, `m = a . p`: the slope on the ball is what of `a` lies across `p`, and turns it
    /// by `p x a`.
    #[test]
    fn the_slope_of_an_even_growth_is_its_own() {
        let grid = PlaceGrid::default();
        let mut map = SurfaceMap::unknown();
        let along = Vec3::new(0.3, -0.5, 0.2);
        for (k, place) in grid.directions.iter().enumerate() {
            map.values[k] = along.dot(place) as f32;
            map.weights[k] = 1.0;
        }
        map.slope(&grid);
        // At the ends of the spiral neighbors do not lie evenly about a place.
        let (mut found, mut all) = (0.0, 0.0);
        for (place, turn) in grid.directions.iter().zip(&map.turns) {
            let expected = place.cross(&along);
            found += expected.dot(&Vec3::from(turn.map(f64::from)));
            all += expected.norm_squared();
        }
        assert!((found / all - 1.0).abs() < 0.02, "{}", found / all);
    }
}
