//! Hash features: bases, features, and the rule that selects the ordered pairs of dots for a table.
//!
//! The method is geometric hashing as in Gossard et al., "SpinDOE" (arXiv 2303.03879), Sec. II-C
//! and Alg. 1. An ordered pair of dots (d, d') spans the basis `B = [d, d', d x d']` (columns). Any
//! third dot d'' has the coordinates `h = B^-1 d''` in it. Since `R d x R d' = R (d x d')`, h does
//! not change when the ball rotates: it is the key under which an observed triple of dots is found.
//!
//! Every feature of an allowed pair is made exactly once. Features need not be distinct: a pattern
//! with symmetries has equal ones.
//!
//! For unit vectors d, d', cosine `c = d . d'` and normal `n = d x d'`, the inverse of
//! `B = [d, d', n]` has a closed form, because n is normal to both others:
//! `h = ((d - c d') . d'', (d' - c d) . d'', n . d'') / |n|^2`, and `det B = |n|^2`.

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::geometry::{Vec3, angle_between};

/// An ordered pair of a pattern's dots, by index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Basis {
    /// Index of the dot that is the first column of B.
    pub first: u16,
    /// Index of the dot that is the second column of B.
    pub second: u16,
}

/// A third dot's coordinates in a basis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feature {
    /// The basis.
    pub basis: Basis,
    /// Index of the third dot.
    pub dot: u16,
    /// `B^-1 d''`, without unit.
    pub value: [f64; 3],
}

/// The basis matrix `B = [d, d', d x d']` of two unit vectors, stored with its inverse.
#[derive(Debug, Clone, Copy)]
pub struct BasisFrame {
    first: Vec3,
    second: Vec3,
    normal: Vec3,
    cosine: f64,
    determinant: f64,
}

impl BasisFrame {
    /// The frame of two unit vectors; `None` where `|d x d'|` is below `min_cross` or is NaN.
    pub fn new(first: &Vec3, second: &Vec3, min_cross: f64) -> Option<Self> {
        let normal = first.cross(second);
        let determinant = normal.norm_squared();
        let usable = determinant > 0.0 && determinant.sqrt() >= min_cross;
        usable.then(|| Self {
            first: *first,
            second: *second,
            normal,
            cosine: first.dot(second),
            determinant,
        })
    }

    /// `det B = |d x d'|^2`, never negative.
    pub fn determinant(&self) -> f64 {
        self.determinant
    }

    /// `B` itself.
    pub fn matrix(&self) -> Matrix3<f64> {
        Matrix3::from_columns(&[self.first, self.second, self.normal])
    }

    /// `B^-1 point`: the hash value of a third dot.
    pub fn feature(&self, point: &Vec3) -> [f64; 3] {
        let (a, b) = (self.first.dot(point), self.second.dot(point));
        [
            (a - self.cosine * b) / self.determinant,
            (b - self.cosine * a) / self.determinant,
            self.normal.dot(point) / self.determinant,
        ]
    }

    /// `B h`: the point that has the hash value `h`.
    pub fn point(&self, h: &[f64; 3]) -> Vec3 {
        self.first * h[0] + self.second * h[1] + self.normal * h[2]
    }
}

/// Which ordered pairs of dots become bases of a table.
///
/// `|det B| = sin^2` of the angle between the two dots, so noise in a feature grows without bound
/// towards 0 and 180 degrees. A pair near 180 degrees is also rarely visible together, because both
/// dots must then lie on the ball's limb.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PairRule {
    /// Minimum `|d x d'|` (sine of the angle between the dots), in (0, 1).
    pub min_cross: f64,
    /// Maximum angle between the dots, radians, in (0, pi].
    pub max_angle_rad: f64,
}

impl Default for PairRule {
    /// Angles from 5.74 degrees (`|d x d'|` = 0.1) to 170 degrees.
    fn default() -> Self {
        Self {
            min_cross: 0.1,
            max_angle_rad: 170f64.to_radians(),
        }
    }
}

impl PairRule {
    /// The rule that excludes only pairs whose basis is singular to rounding.
    pub const ALL: Self = Self {
        min_cross: 1e-6,
        max_angle_rad: std::f64::consts::PI,
    };

    /// Checks the fields' domains.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the field.
    pub fn check(&self) -> Result<()> {
        if !(self.min_cross > 0.0 && self.min_cross < 1.0) {
            let problem = format!("expected a number in (0, 1), found {}", self.min_cross);
            return Err(Error::argument("pair_rule.min_cross", problem));
        }
        if !(self.max_angle_rad > 0.0 && self.max_angle_rad <= std::f64::consts::PI) {
            let problem = format!("expected an angle in (0, pi], found {}", self.max_angle_rad);
            return Err(Error::argument("pair_rule.max_angle_rad", problem));
        }
        Ok(())
    }

    /// The frame of an ordered pair of unit vectors, or `None` where the rule excludes the pair.
    pub fn frame(&self, first: &Vec3, second: &Vec3) -> Option<BasisFrame> {
        if angle_between(first, second) > self.max_angle_rad {
            return None;
        }
        BasisFrame::new(first, second, self.min_cross)
    }

    /// Number of features of `dots` under this rule.
    ///
    /// # Errors
    /// [`Error::Argument`] where the rule leaves out every pair.
    pub fn count(&self, dots: &[Vec3]) -> Result<usize> {
        let n = dots.len();
        let is_basis = |i: usize, j: usize| i != j && self.frame(&dots[i], &dots[j]).is_some();
        let pairs = (0..n).map(|i| (0..n).filter(|&j| is_basis(i, j)).count());
        match pairs.sum::<usize>() {
            0 => Err(Error::argument(
                "pair_rule",
                "leaves out every pair of the pattern's dots",
            )),
            pairs => Ok(pairs * (n - 2)),
        }
    }

    /// All features of `dots` (unit vectors, at most 65536) under this rule, ordered by first dot,
    /// second dot and third dot. Twenty dots with no excluded pair have 20 * 19 * 18 = 6840
    /// features.
    pub fn features<'a>(&'a self, dots: &'a [Vec3]) -> impl Iterator<Item = Feature> + 'a {
        let n = dots.len();
        let pairs = (0..n).flat_map(move |i| (0..n).filter(move |&j| j != i).map(move |j| (i, j)));
        pairs
            .filter_map(move |(i, j)| Some((i, j, self.frame(&dots[i], &dots[j])?)))
            .flat_map(move |(i, j, frame)| {
                let thirds = (0..n).filter(move |&k| k != i && k != j);
                thirds.map(move |k| Feature {
                    basis: Basis {
                        first: i as u16,
                        second: j as u16,
                    },
                    dot: k as u16,
                    value: frame.feature(&dots[k]),
                })
            })
    }
}
