//! An index over directions: which dots lie within a reach of a direction.
//!
//! The faces of a cube around the sphere are cut into squares. Each square lists the dots within the
//! reach of any of its directions, so that a look-up reads one short list.

use crate::geometry::Vec3;

/// Squares along the edge of a face.
const EDGE: usize = 12;

/// Lists of dots by direction.
pub(super) struct Cells {
    /// Where the list of a cell begins; one more than there are cells.
    begins: Vec<u32>,
    dots: Vec<u16>,
}

impl Cells {
    /// For dots (unit vectors) within `reach`, a chord.
    pub fn new(dots: &[Vec3], reach: f64) -> Self {
        let mut cells = Self {
            begins: Vec::with_capacity(6 * EDGE * EDGE + 1),
            dots: Vec::new(),
        };
        for cell in 0..6 * EDGE * EDGE {
            cells.begins.push(cells.dots.len() as u32);
            let (middle, radius) = bounds(cell);
            let near = dots.iter().enumerate().filter(|(_, d)| {
                // Chords obey the triangle inequality.
                (*d - middle).norm() <= reach + radius
            });
            cells.dots.extend(near.map(|(j, _)| j as u16));
        }
        cells.begins.push(cells.dots.len() as u32);
        cells
    }

    /// All dots that may lie within the reach of a direction.
    pub fn near(&self, direction: &Vec3) -> &[u16] {
        let cell = cell_of(direction);
        let (from, to) = (self.begins[cell], self.begins[cell + 1]);
        &self.dots[from as usize..to as usize]
    }
}

/// The number of the cell that a direction lies in.
fn cell_of(d: &Vec3) -> usize {
    let [x, y, z] = [d.x.abs(), d.y.abs(), d.z.abs()];
    let (face, major, u, v) = if x >= y && x >= z {
        (usize::from(d.x < 0.0), x, d.y, d.z)
    } else if y >= z {
        (2 + usize::from(d.y < 0.0), y, d.z, d.x)
    } else {
        (4 + usize::from(d.z < 0.0), z, d.x, d.y)
    };
    let scale = 0.5 * EDGE as f64;
    // A cast saturates: what is not finite lands in some cell.
    let at = |c: f64| ((c / major + 1.0) * scale).min(EDGE as f64 - 0.5) as usize;
    (face * EDGE + at(u)) * EDGE + at(v)
}

/// A cell's middle direction, and the largest chord from it to any of its directions.
fn bounds(cell: usize) -> (Vec3, f64) {
    let (face, u, v) = (cell / (EDGE * EDGE), cell / EDGE % EDGE, cell % EDGE);
    let at = |u: f64, v: f64| {
        let [u, v] = [u, v].map(|c| 2.0 * c / EDGE as f64 - 1.0);
        let sign = if face % 2 == 0 { 1.0 } else { -1.0 };
        match face / 2 {
            0 => Vec3::new(sign, u, v),
            1 => Vec3::new(v, sign, u),
            _ => Vec3::new(u, v, sign),
        }
        .normalize()
    };
    let (u, v) = (u as f64, v as f64);
    let middle = at(u + 0.5, v + 0.5);
    // A cell is bounded by great circles: no direction in it is farther than the farthest corner.
    let corners = [(u, v), (u + 1.0, v), (u, v + 1.0), (u + 1.0, v + 1.0)];
    let radius = corners
        .into_iter()
        .map(|(u, v)| (at(u, v) - middle).norm())
        .fold(0.0, f64::max);
    (middle, radius + 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{random_direction, spiral_directions};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn no_dot_within_the_reach_is_left_out() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let dots: Vec<Vec3> = (0..40).map(|_| random_direction(&mut rng)).collect();
        let cells = Cells::new(&dots, 0.2);
        let mut listed = 0;
        for direction in spiral_directions(5000).chain(dots.iter().copied()) {
            let near = cells.near(&direction);
            listed += near.len();
            for (j, d) in dots.iter().enumerate() {
                if (d - direction).norm() <= 0.2 {
                    assert!(near.contains(&(j as u16)), "{direction} {j}");
                }
            }
        }
        // Lists are short: a fifth of the dots would be 40 000.
        assert!(listed < 25_000, "{listed}");
    }
}
