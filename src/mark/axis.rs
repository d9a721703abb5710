//! The axis of the poles, as far from all dots as possible.
//!
//! The axis minimizes `max_i |n . d_i|` over unit normals `n`: its ends are then farthest from the
//! nearest dot. It is found on a grid of directions and refined by a pattern search around the best
//! of them; the result is a local optimum near the best grid point, within some hundredths of a
//! degree.

use crate::geometry::{Rotation, Vec3, spiral_directions, tangent_frame};

/// Directions of the grid: some 1.1 degrees apart.
const GRID: usize = 20_000;
/// The refinement starts with this step and ends below the second, radians.
const STEPS_RAD: (f64, f64) = (0.02, 1e-4);

/// An axis through the ball and how far its ends are from the dots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeAxis {
    /// Unit vector of the north pole, in the pattern's frame.
    pub direction: Vec3,
    /// Angle between either end and the nearest dot's center, radians.
    pub clearance_rad: f64,
}

impl FreeAxis {
    /// The rotation that brings the axis to +z, and then turns the ball about it by `turn_rad`.
    pub fn rotation(&self, turn_rad: f64) -> Rotation {
        let upright = Rotation::rotation_between(&self.direction, &Vec3::z())
            .unwrap_or_else(|| Rotation::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI));
        Rotation::from_axis_angle(&Vec3::z_axis(), turn_rad) * upright
    }
}

/// The axis whose ends are farthest from the directions `dots`.
pub fn free_axis(dots: &[Vec3]) -> FreeAxis {
    let nearest = |n: &Vec3| dots.iter().map(|d| d.dot(n).abs()).fold(0.0, f64::max);
    // One of each pair of opposite directions is enough.
    let start = spiral_directions(GRID).take(GRID / 2);
    let mut best = Vec3::z();
    let mut value = nearest(&best);
    for n in start {
        let found = nearest(&n);
        if found < value {
            (best, value) = (n, found);
        }
    }
    let mut step = STEPS_RAD.0;
    while step > STEPS_RAD.1 {
        let [u, v] = tangent_frame(&best);
        let better = (0..8)
            .map(|k| {
                let (sin, cos) = (std::f64::consts::FRAC_PI_4 * f64::from(k)).sin_cos();
                (best + step * (cos * u + sin * v)).normalize()
            })
            .map(|n| (nearest(&n), n))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match better {
            Some((found, n)) if found < value => (best, value) = (n, found),
            _ => step *= 0.5,
        }
    }
    FreeAxis {
        direction: best,
        clearance_rad: value.min(1.0).acos(),
    }
}
