//! Dimples: the hollows of a golf ball, as a change of the surface's normal.
//!
//! Hollows lie at even distances on a spiral. Within one, at the angle `a` from its middle of `radius`, the normal leans by
//! `slope a / radius` towards the middle, as that of a shallow spherical hollow does; outside it is the ball's own. The outline stays
//! round: a hollow of a golf ball is 0.2 mm deep, a hundredth of the radius.

use crate::geometry::{Vec3, spiral_directions};

/// The hollows of a ball.
#[derive(Debug, Clone, PartialEq)]
pub struct Dimples {
    /// In the order of z.
    middles: Vec<Vec3>,
    /// Angular radius of each, radians.
    radius: f64,
    /// How far the normal leans at a hollow's edge, radians.
    slope: f64,
}

impl Dimples {
    /// So many hollows of this angular radius, at whose edge the normal leans by `slope`, radians.
    pub fn new(count: usize, radius: f64, slope: f64) -> Self {
        let mut middles: Vec<Vec3> = spiral_directions(count).collect();
        middles.sort_by(|a, b| a.z.total_cmp(&b.z));
        Self {
            middles,
            radius,
            slope,
        }
    }

    /// Those of a golf ball of 42.67 mm: 336 hollows of 3.6 mm, 0.18 mm deep.
    pub fn golf() -> Self {
        Self::new(336, 0.084, 0.2)
    }

    /// The surface's normal at a direction, both unit vectors in the pattern's frame.
    pub fn normal(&self, at: &Vec3) -> Vec3 {
        let cos = self.radius.cos();
        // Directions differ by no more in z than by their angle.
        let from = self.middles.partition_point(|m| m.z < at.z - self.radius);
        let within = self.middles[from..]
            .iter()
            .take_while(|m| m.z < at.z + self.radius)
            .find(|middle| middle.dot(at) > cos);
        let Some(middle) = within else {
            return *at;
        };
        let towards = middle - at * middle.dot(at);
        let lean = self.slope * towards.norm() / self.radius;
        match towards.try_normalize(1e-9) {
            Some(direction) => (at + direction * lean).normalize(),
            None => *at,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_lean_inwards_by_the_slope_at_the_edge_and_are_the_balls_own_outside() {
        let dimples = Dimples::golf();
        for (k, middle) in dimples.middles.iter().enumerate() {
            assert!(dimples.normal(middle).angle(middle) < 1e-6, "{k}");
            let [e1, e2] = crate::geometry::tangent_frame(middle);
            for turn in 0..8 {
                let (s, c) = (f64::from(turn) * 0.785).sin_cos();
                let out = e1 * c + e2 * s;
                let at = |angle: f64| middle * angle.cos() + out * angle.sin();
                let edge = at(0.98 * dimples.radius);
                let normal = dimples.normal(&edge);
                assert!((normal.angle(&edge) - 0.98 * 0.2).abs() < 0.01, "{k}");
                assert!((normal - edge).dot(&out) < -0.1, "{k}: outwards");
            }
        }
        // Hollows do not overlap, and leave ground between them.
        let bare = spiral_directions(5_000).filter(|d| dimples.normal(d) == *d);
        let share = bare.count() as f64 / 5_000.0;
        let hollow = 336.0 * 0.5 * (1.0 - 0.084f64.cos());
        assert!((share - (1.0 - hollow)).abs() < 0.02, "{share}");
    }
}
