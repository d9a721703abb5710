//! How much a pattern's dots crowd each other: near neighbors cost detections.

use crate::geometry::Vec3;

/// Dots crowd each other within about this chord.
pub(crate) const CROWD: f64 = 0.3;

/// How near two dots are to each other, as they crowd each other.
pub(crate) fn nearness(a: &Vec3, b: &Vec3) -> f64 {
    (-0.5 * (a - b).norm_squared() / (CROWD * CROWD)).exp()
}

/// How much the other dots crowd each one.
pub(crate) fn crowds(dots: &[Vec3]) -> Vec<f64> {
    let all = dots.iter().enumerate();
    all.map(|(i, a)| {
        let others = dots.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, b)| nearness(a, b)).sum()
    })
    .collect()
}
