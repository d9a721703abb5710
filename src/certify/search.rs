//! Branch and bound over rotations for the distance of a pattern from its nearest confusions.
//!
//! For a rotation `G` let `f_k(G)` be the smallest angle within which `k` dots that some view shows
//! together lie of `k` different other dots, at least one of them not its own. Turning `G` by an angle
//! changes `f_k` by no more than that angle. Rotation vectors fill the ball of radius pi, and two that
//! are `h` apart differ by a rotation of at most `h` (R. Hartley, F. Kahl, "Global optimization through
//! rotation space search", IJCV 82, 2009). So in a cube of center `c` and half edge `h`
//!
//! ```text
//! f_k(G) >= f_k(exp c) - sqrt(3) h ,
//! ```
//!
//! and a cube that cannot hold less than the smallest value found so far is left. All others are cut
//! into eight. The result is the minimum to within the tolerance.

use nalgebra::Rotation3;

use super::visible::VisibleSets;
use super::{MAX_COUNT, MIN_COUNT};
use crate::geometry::Vec3;

/// A dot and one that it may be taken for.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Edge {
    dot: usize,
    other: usize,
    angle: f64,
}

/// Dots that are taken for others under a rotation.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Found {
    pub rotation_vector: Vec3,
    pub seen: Vec<usize>,
    pub other: Vec<usize>,
    pub angle: f64,
}

/// A cube of rotation vectors.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cube {
    pub center: Vec3,
    pub half: f64,
}

impl Cube {
    /// All rotations.
    pub fn all() -> Self {
        Self {
            center: Vec3::zeros(),
            half: std::f64::consts::PI,
        }
    }

    /// Angle by which a rotation of the cube differs from its center's at most.
    pub fn radius(&self) -> f64 {
        3f64.sqrt() * self.half
    }

    /// Its eight parts, but those beyond the ball of all rotations.
    pub fn parts(self) -> impl Iterator<Item = Self> {
        let half = 0.5 * self.half;
        (0..8).filter_map(move |k| {
            let sign = |bit: usize| if k >> bit & 1 == 0 { -half } else { half };
            let center = self.center + Vec3::new(sign(0), sign(1), sign(2));
            let part = Self { center, half };
            (center.norm() - part.radius() <= std::f64::consts::PI).then_some(part)
        })
    }
}

/// The pattern and what its dots are taken for.
pub(super) struct Problem<'a> {
    dots: &'a [Vec3],
    others: Vec<Vec3>,
    visible: &'a VisibleSets,
    mirrored: bool,
}

impl<'a> Problem<'a> {
    pub fn new(dots: &'a [Vec3], visible: &'a VisibleSets, mirrored: bool) -> Self {
        let sign = if mirrored { -1.0 } else { 1.0 };
        let others = dots.iter().map(|d| sign * d).collect();
        Self {
            dots,
            others,
            visible,
            mirrored,
        }
    }

    /// The nearest confusion of each number of dots, to within `tolerance`; `None` where no view shows
    /// so many dots.
    pub fn nearest(&self, tolerance: f64) -> [Option<Found>; MAX_COUNT + 1] {
        let mut best: [Option<Found>; MAX_COUNT + 1] = Default::default();
        let mut cubes = vec![Cube::all()];
        let mut edges = Vec::new();
        while !cubes.is_empty() {
            let mut next = Vec::new();
            for cube in cubes.into_iter().flat_map(Cube::parts) {
                let widest = (MIN_COUNT..=MAX_COUNT)
                    .map(|k| best[k].as_ref().map_or(std::f64::consts::PI, |b| b.angle))
                    .fold(0.0, f64::max);
                self.edges(&cube.center, widest + cube.radius(), &mut edges);
                let mut open = false;
                let counts = best.iter_mut().enumerate().skip(MIN_COUNT);
                for (k, best) in counts.take_while(|(k, _)| *k <= self.visible.max_count()) {
                    open |= self.look(&cube, k, tolerance, &edges, best);
                }
                if open {
                    next.push(cube);
                }
            }
            cubes = next;
        }
        best
    }

    /// Looks at one number of dots in a cube: takes a nearer confusion at its center, and says whether
    /// the cube may hold one that is nearer by more than the tolerance.
    fn look(
        &self,
        cube: &Cube,
        k: usize,
        tolerance: f64,
        edges: &[Edge],
        best: &mut Option<Found>,
    ) -> bool {
        let limit = |best: &Option<Found>| best.as_ref().map_or(std::f64::consts::PI, |b| b.angle);
        // What the center has is the smallest of all edge lists that hold a confusion.
        while let Some(found) = self.confusion(edges, k, limit(best)) {
            let angle = found.iter().map(|e| e.angle).fold(0.0, f64::max);
            *best = Some(Found {
                rotation_vector: cube.center,
                seen: found.iter().map(|e| e.dot).collect(),
                other: found.iter().map(|e| e.other).collect(),
                angle,
            });
        }
        let reach = limit(best) - tolerance + cube.radius();
        reach > 0.0 && self.confusion(edges, k, reach).is_some()
    }

    /// Whether a rotation lets `k` dots be taken for others within less than `angle`, for any `k` dots
    /// that a view shows.
    pub fn guaranteed(&self, k: usize, angle: f64) -> bool {
        let mut cubes = vec![Cube::all()];
        let mut edges = Vec::new();
        while !cubes.is_empty() {
            let mut next = Vec::new();
            for cube in cubes.into_iter().flat_map(Cube::parts) {
                self.edges(&cube.center, angle + cube.radius(), &mut edges);
                if self.confusion(&edges, k, angle).is_some() {
                    return false;
                }
                if self.confusion(&edges, k, angle + cube.radius()).is_some() {
                    // At the limit of double precision a cube proves nothing.
                    if cube.half < 1e-7 {
                        return false;
                    }
                    next.push(cube);
                }
            }
            cubes = next;
        }
        true
    }

    /// All pairs of a rotated dot and another that are nearer than `reach`, nearest first.
    fn edges(&self, rotation_vector: &Vec3, reach: f64, edges: &mut Vec<Edge>) {
        let rotation = Rotation3::new(*rotation_vector).into_inner();
        let min_cosine = if reach < std::f64::consts::PI {
            reach.cos()
        } else {
            -2.0
        };
        edges.clear();
        for (dot, d) in self.dots.iter().enumerate() {
            let at = rotation * d;
            for (other, o) in self.others.iter().enumerate() {
                let cosine = at.dot(o);
                if cosine > min_cosine {
                    edges.push(Edge {
                        dot,
                        other,
                        angle: at.cross(o).norm().atan2(cosine),
                    });
                }
            }
        }
        edges.sort_unstable_by(|a, b| a.angle.total_cmp(&b.angle));
    }

    /// `k` edges shorter than `limit` between different dots that a view shows, not all of them from
    /// dots to themselves; `None` where there are none.
    fn confusion(&self, edges: &[Edge], k: usize, limit: f64) -> Option<Vec<Edge>> {
        let short = &edges[..edges.partition_point(|e| e.angle < limit)];
        let (mut starts, mut foreign, mut ends) = (0u64, 0u64, 0u64);
        for e in short {
            starts |= 1 << e.dot;
            ends |= 1 << e.other;
            foreign |= u64::from(self.is_foreign(e)) << e.dot;
        }
        let few = |bits: u64| (bits.count_ones() as usize) < k;
        if few(starts) || few(ends) || foreign == 0 {
            return None;
        }
        for &view in self.visible.sets() {
            if few(starts & view) || foreign & view == 0 {
                continue;
            }
            let found = self.matching(short, view, k);
            if found.is_some() {
                return found;
            }
        }
        None
    }

    fn is_foreign(&self, edge: &Edge) -> bool {
        self.mirrored || edge.dot != edge.other
    }

    /// As [`Problem::confusion`], in one view: a matching through each foreign edge in turn.
    fn matching(&self, edges: &[Edge], view: u64, k: usize) -> Option<Vec<Edge>> {
        let n = self.dots.len();
        let first = edges
            .iter()
            .filter(|e| self.is_foreign(e) && view >> e.dot & 1 == 1);
        for forced in first {
            let mut taken_by: Vec<Option<Edge>> = vec![None; n];
            let mut count = 1;
            let usable = |e: &&Edge| {
                view >> e.dot & 1 == 1 && e.dot != forced.dot && e.other != forced.other
            };
            let mut tried = 0u64;
            for e in edges.iter().filter(usable) {
                if tried >> e.dot & 1 == 1 {
                    continue;
                }
                tried |= 1 << e.dot;
                if augment(e.dot, edges, &usable, &mut 0, &mut taken_by) {
                    count += 1;
                    if count == k {
                        let rest = taken_by.into_iter().flatten();
                        return Some(std::iter::once(*forced).chain(rest).collect());
                    }
                }
            }
            // The largest matching has at most one edge more than the largest through a given edge.
            if count + 1 < k {
                return None;
            }
        }
        None
    }
}

/// Finds a place for a dot, moving others where needed (H. W. Kuhn's augmenting paths).
fn augment(
    dot: usize,
    edges: &[Edge],
    usable: &dyn Fn(&&Edge) -> bool,
    visited: &mut u64,
    taken_by: &mut [Option<Edge>],
) -> bool {
    for e in edges.iter().filter(|e| e.dot == dot).filter(usable) {
        if *visited >> e.other & 1 == 1 {
            continue;
        }
        *visited |= 1 << e.other;
        let free = match taken_by[e.other] {
            None => true,
            Some(owner) => augment(owner.dot, edges, usable, visited, taken_by),
        };
        if free {
            taken_by[e.other] = Some(*e);
            return true;
        }
    }
    false
}
