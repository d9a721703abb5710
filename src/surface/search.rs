//! Where a face lies on the surface when nothing is known: every rotation tried on blurred brightness.
//!
//! The correlation of the blurred face with the blurred surface under `R` is computed for rotations that cover all evenly (M. Alexa,
//! "Super-Fibonacci Spirals", CVPR 2022), and the best are climbed from.

use fearless_simd::{Level, Simd, dispatch};
use nalgebra::Matrix3;

use super::face::Face;
use super::surface_map::{PlaceGrid, SurfaceMap};
use crate::geometry::{Rotation, Vec3, spiral_directions, spread_rotation, tangent_frame};

/// Rotations tried: neighbors are some 11 degrees apart.
const ROTATIONS: usize = 12_000;
/// Directions on the ball that are compared, those of the visible ones some 6.5 degrees apart, and the least z of these.
const CELLS: usize = 500;
const MIN_Z: f64 = 0.35;
/// Blur, radians: half the width of the box.
const BLUR: f64 = 0.09;
/// Cells along the side of a cube's face in which the surface is looked up, and room for those of all faces: a power of two.
const CUBE: usize = 24;
const TABLE: usize = 4_096;
const _: () = assert!(6 * CUBE * CUBE <= TABLE);
/// The best of the rotations are climbed from, as far as none is beside a better one, radians.
const CLIMBED: usize = 24;
const BESIDE: f64 = 0.2;
/// So many of the best are put in order at a time.
const ORDERED: usize = 400;
/// First and last step of the climb, radians.
const STEPS: [f64; 2] = [0.08, 0.02];

/// Cells that are summed side by side.
const LANES: usize = 8;

/// What does not depend on face and surface.
#[derive(Debug)]
pub(crate) struct Search {
    level: Level,
    rotations: Vec<Rotation>,
    cells: Vec<Vec3>,
    /// Their x, y and z, as many at a time as are turned side by side.
    lanes: Vec<[[f32; LANES]; 3]>,
    /// The cube's cells that the cells meet under each of the rotations, one rotation after the other.
    met: Vec<u16>,
    /// The directions of a cube's cells.
    cube: Vec<Vec3>,
}

/// A blurred face: its cells' brightness, and the sum of their squares.
#[derive(Debug)]
struct BlurredFace {
    values: Vec<f32>,
    squares: f32,
}

/// A blurred surface, by the cube's cells; 0 where it is not known.
#[derive(Debug)]
pub(crate) struct Blurred([f32; TABLE]);

impl Search {
    /// Rotations, and cells to compare.
    pub fn new() -> Self {
        let mut cells: Vec<Vec3> = spiral_directions(CELLS).filter(|d| d.z > MIN_Z).collect();
        // No lane is left empty: the last few, next to the limb, are left out.
        cells.truncate(cells.len() / LANES * LANES);
        let (chunks, _) = cells.as_chunks::<LANES>();
        let lanes =
            (chunks.iter()).map(|chunk| [0, 1, 2].map(|axis| chunk.map(|c| c[axis] as f32)));
        let cube = (0..6 * CUBE * CUBE).map(cube_direction).collect();
        let rotations: Vec<Rotation> = (0..ROTATIONS)
            .map(|k| spread_rotation(k, ROTATIONS))
            .collect();
        let met = rotations.iter().flat_map(|rotation| {
            let back = rotation.inverse().to_rotation_matrix();
            cells
                .iter()
                .map(move |cell| cube_cell(&(back * cell)) as u16)
        });
        Self {
            level: Level::new(),
            met: met.collect(),
            lanes: lanes.collect(),
            rotations,
            cells,
            cube,
        }
    }

    /// The surface as it is searched.
    pub fn blurred(&self, grid: &PlaceGrid, surface: &SurfaceMap) -> Blurred {
        let mut sums = vec![(0.0f32, 0.0f32); self.cube.len()];
        for (k, place) in grid.directions.iter().enumerate() {
            if surface.weights[k] > 0.0 {
                let sum = &mut sums[cube_cell(place)];
                sum.0 += surface.values[k];
                sum.1 += 1.0;
            }
        }
        // A box of cells about each: those of other faces of the cube are found by their directions.
        let off = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|o| o * BLUR);
        let blur = |direction: &Vec3| {
            let [e1, e2] = tangent_frame(direction);
            let (mut sum, mut count) = (0.0f32, 0.0f32);
            for a in off {
                for b in off {
                    let near = sums[cube_cell(&(direction + e1 * a + e2 * b))];
                    sum += near.0;
                    count += near.1;
                }
            }
            sum / count.max(1.0)
        };
        let mut blurred = [0.0; TABLE];
        for (value, direction) in blurred.iter_mut().zip(&self.cube) {
            *value = blur(direction);
        }
        Blurred(blurred)
    }

    /// The likeliest rotations, best first, with their correlations; within `within` radians of one where it is given.
    pub fn find(
        &self,
        surface: &Blurred,
        face: &Face,
        near: Option<(&Rotation, f64)>,
    ) -> Vec<(Rotation, f64)> {
        let seen = self.face_cells(face);
        let met = self.met.chunks_exact(self.cells.len());
        let tried = self.rotations.iter().zip(met).filter(|(r, _)| match near {
            Some((about, within)) => are_near(about, r, within),
            None => true,
        });
        let mut scored: Vec<(f64, &Rotation)> = tried
            .map(|(r, met)| (correlation(surface, &seen, met), r))
            .collect();
        let mut best: Vec<(Rotation, f64)> = Vec::with_capacity(CLIMBED);
        // The best are among the first few: the others need no order.
        let mut rest = scored.as_mut_slice();
        while best.len() < CLIMBED && !rest.is_empty() {
            let first = ORDERED.min(rest.len());
            if first < rest.len() {
                rest.select_nth_unstable_by(first, |a, b| b.0.total_cmp(&a.0));
            }
            let (ordered, others) = rest.split_at_mut(first);
            ordered.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
            for (score, rotation) in ordered.iter() {
                if best.len() < CLIMBED && best.iter().all(|b| !are_near(&b.0, rotation, BESIDE)) {
                    best.push((**rotation, *score));
                }
            }
            rest = others;
        }
        for (rotation, score) in &mut best {
            self.climb(surface, &seen, rotation, score);
        }
        best.sort_unstable_by(|a, b| b.1.total_cmp(&a.1));
        let mut apart: Vec<(Rotation, f64)> = Vec::new();
        for found in best {
            if apart.iter().all(|b| !are_near(&b.0, &found.0, BESIDE)) {
                apart.push(found);
            }
        }
        apart
    }

    /// The blurred face.
    fn face_cells(&self, face: &Face) -> BlurredFace {
        let off = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|o| o * BLUR);
        let blur = |cell: &Vec3| {
            let [e1, e2] = tangent_frame(cell);
            let mut sum = 0.0;
            for a in off {
                for b in off {
                    sum += face.at(&(cell + e1 * a + e2 * b).normalize());
                }
            }
            (sum / (off.len() * off.len()) as f64) as f32
        };
        let values: Vec<f32> = self.cells.iter().map(blur).collect();
        let squares = values.iter().map(|x| x * x).sum();
        BlurredFace { values, squares }
    }

    fn score(&self, surface: &Blurred, seen: &BlurredFace, rotation: &Rotation) -> f64 {
        let back = rotation.inverse().to_rotation_matrix();
        let back = back.matrix().map(|x| x as f32);
        let (mut own, mut both) = ([0.0f32; LANES], [0.0f32; LANES]);
        let mut met = [0; LANES];
        let (chunks, _) = seen.values.as_chunks::<LANES>();
        for (directions, values) in self.lanes.iter().zip(chunks) {
            dispatch!(self.level, simd => simd.vectorize(
                #[inline(always)]
                || turned_cells(&back, directions, &mut met)
            ));
            for lane in 0..LANES {
                let other = surface.0[met[lane] as usize % TABLE];
                own[lane] += other * other;
                both[lane] += values[lane] * other;
            }
        }
        seen.correlation(own, both)
    }

    fn climb(
        &self,
        surface: &Blurred,
        seen: &BlurredFace,
        rotation: &mut Rotation,
        score: &mut f64,
    ) {
        let mut step = STEPS[0];
        while step > STEPS[1] {
            let mut moved = false;
            for axis in [Vec3::x(), Vec3::y(), Vec3::z()] {
                for sign in [step, -step] {
                    let tried = Rotation::from_scaled_axis(axis * sign) * *rotation;
                    let found = self.score(surface, seen, &tried);
                    if found > *score {
                        (*rotation, *score, moved) = (tried, found, true);
                    }
                }
            }
            if !moved {
                step *= 0.5;
            }
        }
    }
}

/// Whether two rotations differ by less than so many radians.
fn are_near(one: &Rotation, other: &Rotation, within: f64) -> bool {
    one.coords.dot(&other.coords).abs() > (0.5 * within).cos()
}

/// The correlation, about 0, of a face with the surface at the cells of the cube that its cells meet: places that are not known take from it.
fn correlation(surface: &Blurred, seen: &BlurredFace, met: &[u16]) -> f64 {
    let (mut own, mut both) = ([0.0f32; LANES], [0.0f32; LANES]);
    let ((values, _), (met, _)) = (seen.values.as_chunks::<LANES>(), met.as_chunks::<LANES>());
    for (values, met) in values.iter().zip(met) {
        for lane in 0..LANES {
            let other = surface.0[usize::from(met[lane]) % TABLE];
            own[lane] += other * other;
            both[lane] += values[lane] * other;
        }
    }
    seen.correlation(own, both)
}

impl BlurredFace {
    /// By the sums of the surface's squares and of both values' products.
    fn correlation(&self, own: [f32; LANES], both: [f32; LANES]) -> f64 {
        let [own, both] = [own, both].map(|lanes| lanes.iter().sum::<f32>());
        f64::from(both / (own.max(1e-6) * self.squares.max(1e-6)).sqrt())
    }
}

/// The cells of a cube about the ball that directions meet when they are turned: [`cube_cell`] of each.
#[inline(always)]
fn turned_cells(turn: &Matrix3<f32>, [xs, ys, zs]: &[[f32; LANES]; 3], met: &mut [u32; LANES]) {
    for lane in 0..LANES {
        let [x, y, z] = std::array::from_fn(|row| {
            turn[(row, 0)] * xs[lane] + turn[(row, 1)] * ys[lane] + turn[(row, 2)] * zs[lane]
        });
        let is_x = (x.abs() >= y.abs()) & (x.abs() >= z.abs());
        let is_y = !is_x & (y.abs() >= z.abs());
        let of = |x: f32, y: f32, z: f32| match (is_x, is_y) {
            (true, _) => x,
            (_, true) => y,
            _ => z,
        };
        let (along, u, v) = (of(x, y, z), of(y, z, x), of(z, x, y));
        let scale = 0.5 / along.abs().max(1e-9);
        let cell = |x: f32| (((x * scale + 0.5) * CUBE as f32) as i32).clamp(0, CUBE as i32 - 1);
        let axis = if is_x { 0 } else { 2 - i32::from(is_y) };
        let face = 2 * axis + i32::from(along < 0.0);
        met[lane] = ((face * CUBE as i32 + cell(v)) * CUBE as i32 + cell(u)) as u32;
    }
}

/// The cell of a cube about the ball that a direction meets.
fn cube_cell(d: &Vec3) -> usize {
    let axis = d.iamax();
    let along = d[axis];
    let face = 2 * axis + usize::from(along < 0.0);
    let scale = 0.5 / along.abs();
    let cell = |x: f64| (((x * scale + 0.5) * CUBE as f64) as usize).min(CUBE - 1);
    let (u, v) = (cell(d[(axis + 1) % 3]), cell(d[(axis + 2) % 3]));
    (face * CUBE + v) * CUBE + u
}

/// The direction of the middle of a cube's cell.
fn cube_direction(cell: usize) -> Vec3 {
    let (face, v, u) = (cell / (CUBE * CUBE), cell / CUBE % CUBE, cell % CUBE);
    let at = |k: usize| 2.0 * (k as f64 + 0.5) / CUBE as f64 - 1.0;
    let axis = face / 2;
    let mut d = Vec3::zeros();
    d[axis] = if face % 2 == 0 { 1.0 } else { -1.0 };
    d[(axis + 1) % 3] = at(u);
    d[(axis + 2) % 3] = at(v);
    d.normalize()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::geometry::random_rotation;

    #[test]
    fn turned_lanes_meet_the_cells_of_the_cube() {
        let search = Search::new();
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let (mut same, mut all) = (0, 0);
        for _ in 0..50 {
            let turn = random_rotation(&mut rng).to_rotation_matrix();
            let single = turn.matrix().map(|x| x as f32);
            for (cells, lanes) in search.cells.chunks(LANES).zip(&search.lanes) {
                let mut met = [0; LANES];
                turned_cells(&single, lanes, &mut met);
                for (cell, met) in cells.iter().zip(met) {
                    same += u32::from(cube_cell(&(turn * cell)) == met as usize);
                    all += 1;
                }
            }
        }
        // But for borders, within the single precision.
        assert!(same + all / 2_000 >= all, "{same} of {all}");
    }
}
