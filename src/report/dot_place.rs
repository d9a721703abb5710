//! Where a dot is to be drawn beside others that are on the ball: its straight distances from three of them.
//!
//! Two distances leave two places on the ball, mirrored by the plane through both dots and the ball's center. The
//! third dot stands off that plane, so that its distance decides.

use serde::{Deserialize, Serialize};

use crate::geometry::Vec3;

/// Volume of the three dots' parallelepiped from which on the third decides, without unit: at two dots a right angle
/// apart the third then stands 3 degrees and more off their plane.
const MIN_VOLUME: f64 = 0.05;

/// A place for a dot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DotPlace {
    /// The number that the dot will have.
    pub number: usize,
    /// Its direction, pattern frame.
    pub direction: [f64; 3],
    /// Dots that are drawn, near it, with their straight distances as a caliper takes them, mm.
    pub from: Vec<(usize, f64)>,
}

impl DotPlace {
    /// The place `direction` of dot `number` beside those that are `drawn` on a ball of this diameter.
    pub fn new(number: usize, direction: &Vec3, drawn: &[Vec3], ball_diameter_mm: f64) -> Self {
        let mut near: Vec<usize> = (0..drawn.len()).collect();
        let chord = |j: usize| (drawn[j] - direction).norm();
        near.sort_by(|&a, &b| chord(a).total_cmp(&chord(b)));
        if let [a, b, rest @ ..] = &mut near[..] {
            let normal = drawn[*a].cross(&drawn[*b]);
            let is_off = |j: &usize| normal.dot(&drawn[*j]).abs() >= MIN_VOLUME;
            if let Some(k) = rest.iter().position(is_off) {
                rest.swap(0, k);
            }
        }
        near.truncate(3);
        Self {
            number,
            direction: (*direction).into(),
            from: near
                .into_iter()
                .map(|j| (j, 0.5 * ball_diameter_mm * chord(j)))
                .collect(),
        }
    }
}

impl DotPlace {
    /// The places of the dots that come to the first ones, those `drawn`; none where nothing is drawn.
    pub(super) fn added(dots: &[Vec3], drawn: usize, ball_diameter_mm: f64) -> Vec<Self> {
        let (drawn, added) = dots.split_at(drawn.min(dots.len()));
        match drawn {
            [] => Vec::new(),
            _ => (drawn.len()..)
                .zip(added)
                .map(|(number, dot)| Self::new(number, dot, drawn, ball_diameter_mm))
                .collect(),
        }
    }
}

impl std::fmt::Display for DotPlace {
    /// As in "dot 20: 14.2 mm from dot 3, 15.1 mm from dot 7, 16.0 mm from dot 12".
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "dot {}:", self.number)?;
        for (k, (dot, mm)) in self.from.iter().enumerate() {
            let comma = if k == 0 { "" } else { "," };
            write!(f, "{comma} {mm:.1} mm from dot {dot}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::spiral_directions;

    #[test]
    fn three_distances_leave_one_place() {
        let drawn: Vec<Vec3> = spiral_directions(20).collect();
        for direction in spiral_directions(57) {
            let place = DotPlace::new(20, &direction, &drawn, 40.0);
            // Every direction whose distances from the three are these within half a millimeter.
            let fits = |v: &Vec3| {
                let mut each = place.from.iter();
                each.all(|(dot, mm)| (20.0 * (drawn[*dot] - v).norm() - mm).abs() < 0.5)
            };
            for other in spiral_directions(20_000).filter(fits) {
                let off = 20.0 * (other - direction).norm();
                assert!(off < 4.0, "{off} mm off by {:?}", place.from);
            }
        }
        let place = DotPlace::new(2, &Vec3::x(), &[Vec3::x(), -Vec3::x()], 40.0);
        assert_eq!(place.from, [(0, 0.0), (1, 40.0)]);
    }
}
