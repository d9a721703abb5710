//! Rotations that lay a pair of dots on another pair, and the dots that then coincide.

use nalgebra::Matrix3;

use super::cells::Cells;
use super::{Kernel, MIN_COUNT, WINDOW_RAD};
use crate::geometry::Vec3;

/// A dot that comes to lie near another.
#[derive(Debug, Clone, Copy)]
pub(super) struct Match {
    /// The dot that is seen.
    pub seen: u16,
    /// The dot that the rotation brings there.
    pub other: u16,
    /// How well they coincide, in [0, 1].
    pub value: f64,
    /// The derivative of `value` by the squared distance of the two.
    pub slope: f64,
}

/// A false pose: a rotation that lays a pair of dots on another.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rival {
    /// Maps the other dots onto the seen ones.
    pub rotation: Matrix3<f64>,
    /// The seen pair, and the pair that is laid on it.
    pub pair: [usize; 2],
    pub onto: [usize; 2],
    /// Where its matches begin and end.
    pub matches: [usize; 2],
}

/// All rivals from some of the pairs.
#[derive(Debug, Default)]
pub(super) struct Rivals {
    pub rivals: Vec<Rival>,
    pub matches: Vec<Match>,
}

impl Rivals {
    pub fn matches_of(&self, rival: &Rival) -> &[Match] {
        let [from, to] = rival.matches;
        &self.matches[from..to]
    }
}

/// A rotation that keeps the midpoint of a pair and its normal: columns midpoint, normal, and their
/// product; `None` for pairs nearly equal or opposite.
pub(super) fn frame(a: &Vec3, b: &Vec3) -> Option<Matrix3<f64>> {
    const MIN_SINE: f64 = 0.02;
    let normal = a.cross(b).try_normalize(MIN_SINE)?;
    let mid = (a + b).normalize();
    Some(Matrix3::from_columns(&[mid, normal, mid.cross(&normal)]))
}

/// Finds the rivals that lay any pair of dots on one of these seen pairs, as far as enough dots then
/// coincide.
pub(super) fn rivals(dots: &[Vec3], kernel: &Kernel, pairs: &[[usize; 2]]) -> Rivals {
    let n = dots.len();
    let cells = Cells::new(dots, kernel.reach);
    let mut others: Vec<Other> = Vec::with_capacity(n * (n - 1));
    for i in 0..n {
        for j in (0..n).filter(|&j| j != i) {
            if let Some(frame) = frame(&dots[i], &dots[j]) {
                let angle = dots[i].cross(&dots[j]).norm().atan2(dots[i].dot(&dots[j]));
                others.push(Other {
                    angle,
                    dots: [i, j],
                    frame,
                });
            }
        }
    }
    others.sort_by(|a, b| a.angle.total_cmp(&b.angle).then(a.dots.cmp(&b.dots)));
    // Two dots laid symmetrically on two others are off by half the difference of the angles each.
    let max_gap = 4.0 * (0.5 * kernel.pair_reach_squared.sqrt()).min(1.0).asin();
    let max_trace = 1.0 + 2.0 * WINDOW_RAD[0].cos();
    let mut found = Rivals::default();
    for &pair in pairs {
        let [i, k] = pair;
        let Some(seen) = frame(&dots[i], &dots[k]) else {
            continue;
        };
        let angle = dots[i].cross(&dots[k]).norm().atan2(dots[i].dot(&dots[k]));
        let from = others.partition_point(|o| o.angle < angle - max_gap);
        for other in others[from..]
            .iter()
            .take_while(|o| o.angle < angle + max_gap)
        {
            let rotation = seen * other.frame.transpose();
            if rotation.trace() >= max_trace {
                continue;
            }
            let begin = found.matches.len();
            coincidences(dots, &cells, kernel, &rotation, &mut found.matches);
            // Fewer coincide in views of many dots: nothing that counts.
            if found.matches.len() - begin < MIN_COUNT {
                found.matches.truncate(begin);
                continue;
            }
            found.rivals.push(Rival {
                rotation,
                pair,
                onto: other.dots,
                matches: [begin, found.matches.len()],
            });
        }
    }
    found
}

/// A pair of dots with its frame.
struct Other {
    angle: f64,
    dots: [usize; 2],
    frame: Matrix3<f64>,
}

/// All dots that a rotation brings within the reach of a dot.
fn coincidences(
    dots: &[Vec3],
    cells: &Cells,
    kernel: &Kernel,
    rotation: &Matrix3<f64>,
    found: &mut Vec<Match>,
) {
    let reach_squared = kernel.reach * kernel.reach;
    let back = rotation.transpose();
    for (seen, dot) in dots.iter().enumerate() {
        let at = back * dot;
        for &other in cells.near(&at) {
            let squared = (at - dots[usize::from(other)]).norm_squared();
            if squared < reach_squared {
                let (value, slope) = kernel.at(squared);
                found.push(Match {
                    seen: seen as u16,
                    other,
                    value,
                    slope,
                });
            }
        }
    }
}
