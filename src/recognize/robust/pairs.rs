//! The pattern in the frames of all ordered pairs of its dots.
//!
//! Two directions a, b span the frame x = (a + b)/|a + b|, z = a x b/|a x b|, y = z x x. A rotation
//! that aligns an observed pair with a pattern pair maps one frame to the other. In these frames
//! the other dots are compared directly, and nothing has to be rotated.

use nalgebra::Matrix3;
use wide::f32x4;

use crate::geometry::{Vec3, angle_between};

/// Number of values handled together; patterns are padded to a multiple of it.
pub(super) const LANES: usize = 4;
/// Pattern pairs nearer to parallel or opposite than this sine are left out.
const MIN_SINE: f64 = 0.075;

/// An ordered pair of pattern dots.
#[derive(Debug, Clone, Copy)]
pub(super) struct PatternPair {
    cosine: f64,
    pub angle_rad: f64,
    pub first: u16,
    pub second: u16,
}

/// All ordered pairs in the order of their cosine, with the pattern in the frame of each.
#[derive(Debug, Clone)]
pub(super) struct PatternPairs {
    pairs: Vec<PatternPair>,
    /// x, y and z of all dots, then the next pair's.
    coordinates: Vec<f32x4>,
    /// Length of one coordinate's row.
    row: usize,
}

impl PatternPairs {
    pub fn new(dots: &[Vec3]) -> Self {
        let mut pairs = Vec::with_capacity(dots.len() * dots.len());
        for (i, a) in dots.iter().enumerate() {
            for (j, b) in dots.iter().enumerate() {
                if i != j && a.cross(b).norm() > MIN_SINE {
                    pairs.push(PatternPair {
                        cosine: a.dot(b),
                        angle_rad: angle_between(a, b),
                        first: i as u16,
                        second: j as u16,
                    });
                }
            }
        }
        pairs.sort_by(|p, q| p.cosine.total_cmp(&q.cosine));
        let row = dots.len().div_ceil(LANES);
        let mut coordinates = Vec::with_capacity(pairs.len() * 3 * row);
        for pair in &pairs {
            let (a, b) = (
                &dots[usize::from(pair.first)],
                &dots[usize::from(pair.second)],
            );
            let to_frame = frame(a, b).transpose();
            for axis in 0..3 {
                for some in dots.chunks(LANES) {
                    let mut lane = [0.0; LANES];
                    for (to, dot) in lane.iter_mut().zip(some) {
                        *to = to_frame.row(axis).transpose().dot(dot) as f32;
                    }
                    coordinates.push(f32x4::new(lane));
                }
            }
        }
        Self {
            pairs,
            coordinates,
            row,
        }
    }

    /// Positions of the pairs whose cosines lie in [low, high].
    pub fn between(&self, low: f64, high: f64) -> std::ops::Range<usize> {
        let from = self.pairs.partition_point(|p| p.cosine < low);
        let to = self.pairs.partition_point(|p| p.cosine <= high);
        from..to.max(from)
    }

    pub fn pair(&self, index: usize) -> PatternPair {
        self.pairs[index]
    }

    /// x, y and z of all dots in the frame of a pair, padded with zeros.
    pub fn in_frame(&self, index: usize) -> [&[f32x4]; 3] {
        let block = &self.coordinates[index * 3 * self.row..][..3 * self.row];
        let (x, rest) = block.split_at(self.row);
        let (y, z) = rest.split_at(self.row);
        [x, y, z]
    }

    /// Length of a coordinate's row.
    pub fn row(&self) -> usize {
        self.row
    }
}

/// The frame of two directions, balanced between them, as columns.
pub(super) fn frame(a: &Vec3, b: &Vec3) -> Matrix3<f64> {
    let x = (a + b).normalize();
    let z = a.cross(b).normalize();
    Matrix3::from_columns(&[x, z.cross(&x), z])
}
