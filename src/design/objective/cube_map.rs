//! Tables over all directions: a square grid on each face of a cube around the sphere.
//!
//! [`DotIndex`] finds the dots near a direction, as bits of a word. [`Interpolated`] is a function of
//! the direction given by its values at the grid's nodes, bilinear in each cell: continuous, with a
//! derivative that is exact for the interpolated function.

use crate::geometry::Vec3;

/// Cells along a face's edge. A cell's diagonal is at most 10 degrees.
const CELLS: usize = 16;
const NODES: usize = CELLS + 1;

/// A place on the cube: the face, and coordinates in cells, each in [0, CELLS].
struct Place {
    axis: usize,
    sign: f64,
    u: f64,
    w: f64,
}

impl Place {
    fn of(d: &Vec3) -> Self {
        let axis = d.iamax();
        let sign = d[axis].signum();
        let scale = 0.5 * CELLS as f64;
        let [u, w] = [1, 2].map(|k| scale * (d[(axis + k) % 3] / d[axis].abs() + 1.0));
        Self { axis, sign, u, w }
    }

    fn direction(&self) -> Vec3 {
        let scale = 2.0 / CELLS as f64;
        let mut d = Vec3::zeros();
        d[self.axis] = self.sign;
        d[(self.axis + 1) % 3] = scale * self.u - 1.0;
        d[(self.axis + 2) % 3] = scale * self.w - 1.0;
        d.normalize()
    }

    fn face(&self) -> usize {
        2 * self.axis + usize::from(self.sign < 0.0)
    }

    /// The cell, as whole numbers of its corner of least coordinates.
    fn corner(&self) -> [usize; 2] {
        [self.u, self.w].map(|x| (x as usize).min(CELLS - 1))
    }
}

/// The places of all points of a grid with `edge` points along a face's edge.
fn places(edge: usize, offset: f64) -> impl Iterator<Item = Place> {
    (0..6 * edge * edge).map(move |k| {
        let (face, i, j) = (k / (edge * edge), k / edge % edge, k % edge);
        Place {
            axis: face / 2,
            sign: if face % 2 == 0 { 1.0 } else { -1.0 },
            u: i as f64 + offset,
            w: j as f64 + offset,
        }
    })
}

/// For each cell the dots that may lie within a distance of a direction in it.
pub(super) struct DotIndex {
    near: Vec<u64>,
}

impl DotIndex {
    /// An index of at most 64 dots for directions no farther away than `reach` (a chord).
    pub fn new(dots: &[Vec3], reach: f64) -> Self {
        let half = 0.5;
        let near = places(CELLS, half)
            .map(|center| {
                let middle = center.direction();
                let corner = |du: f64, dw: f64| Place {
                    u: center.u + du,
                    w: center.w + dw,
                    ..center
                };
                let radius = [(-half, -half), (-half, half), (half, -half), (half, half)]
                    .map(|(du, dw)| (corner(du, dw).direction() - middle).norm())
                    .into_iter()
                    .fold(0.0, f64::max);
                let squared = (reach + radius).powi(2);
                dots.iter().enumerate().fold(0, |bits, (j, d)| {
                    bits | u64::from((d - middle).norm_squared() <= squared) << j
                })
            })
            .collect();
        Self { near }
    }

    /// The dots that may lie near `d`, dot `j` as bit `j`; all that do are among them.
    pub fn near(&self, d: &Vec3) -> u64 {
        let place = Place::of(d);
        let [i, j] = place.corner();
        self.near[(place.face() * CELLS + i) * CELLS + j]
    }
}

/// A value between nodes.
pub(super) struct Interpolation {
    /// The value.
    pub value: f64,
    /// Its derivative with respect to the direction.
    pub gradient: Vec3,
    /// The nodes around, and the part of each.
    pub nodes: [(usize, f64); 4],
}

/// A function of the direction, given at nodes.
pub(super) struct Interpolated {
    values: Vec<f64>,
}

impl Interpolated {
    /// Takes the function's values at all nodes.
    pub fn new(function: impl Fn(&Vec3) -> f64) -> Self {
        Self {
            values: Self::directions().map(|d| function(&d)).collect(),
        }
    }

    /// The nodes' directions.
    pub fn directions() -> impl Iterator<Item = Vec3> {
        places(NODES, 0.0).map(|place| place.direction())
    }

    /// The value in the direction `d`.
    pub fn at(&self, d: &Vec3) -> Interpolation {
        let place = Place::of(d);
        let [i, j] = place.corner();
        let (s, t) = (place.u - i as f64, place.w - j as f64);
        let first = (place.face() * NODES + i) * NODES + j;
        let nodes = [
            (first, (1.0 - s) * (1.0 - t)),
            (first + 1, (1.0 - s) * t),
            (first + NODES, s * (1.0 - t)),
            (first + NODES + 1, s * t),
        ];
        let [a, b, c, e] = nodes.map(|(node, _)| self.values[node]);
        let by_u = (c - a) * (1.0 - t) + (e - b) * t;
        let by_w = (b - a) * (1.0 - s) + (e - c) * s;
        let half = 0.5 * CELLS as f64;
        let scale = half / d[place.axis].abs();
        let mut gradient = Vec3::zeros();
        gradient[(place.axis + 1) % 3] = scale * by_u;
        gradient[(place.axis + 2) % 3] = scale * by_w;
        // u = half (x / |major| + 1), hence du / d major = -(u - half) sign / |major|.
        gradient[place.axis] =
            -place.sign / d[place.axis].abs() * (by_u * (place.u - half) + by_w * (place.w - half));
        Interpolation {
            value: nodes
                .iter()
                .map(|&(node, part)| part * self.values[node])
                .sum(),
            gradient,
            nodes,
        }
    }
}
