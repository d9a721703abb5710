//! Round or nearly round marks.
//!
//! A dot is a cap of the angular radius `rho` with a soft edge. Its ink falls from 1 to 0 between
//! `rho - s` and `rho + s`, linearly in the cosine of the angle, which is cheap to compute. A
//! stretched dot has the radius `rho (1 + e cos(2 phi))`, `phi` the angle from its longer axis.

use crate::geometry::{Vec3, tangent_frame};

/// A round or nearly round mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Its middle.
    pub middle: Vec3,
    /// Its longer and its shorter axis, unit tangents at the middle.
    pub axes: [Vec3; 2],
    /// Its angular radius, radians.
    pub radius: f64,
    /// Half the angle over which its edge fades, radians.
    pub softness: f64,
    /// Share of the light that its ink takes, in [0, 1].
    pub darkness: f32,
    /// (long axis - short axis) / (long + short).
    pub elongation: f32,
    /// Streaks of the pen.
    pub streaks: Streaks,
}

/// Lines that a pen leaves thinner.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Streaks {
    /// Maximum part of the ink that is missing, in [0, 1].
    pub depth: f32,
    /// Lines over the dot's radius.
    pub frequency: f32,
    /// Their phase, radians.
    pub phase: f32,
}

impl Spot {
    /// A round mark of even ink.
    pub fn round(middle: Vec3, radius: f64, softness: f64, darkness: f32) -> Self {
        Self {
            middle,
            axes: tangent_frame(&middle),
            radius,
            softness,
            darkness,
            elongation: 0.0,
            streaks: Streaks::default(),
        }
    }

    /// The mark, stretched along the part of `along` that is tangent to the ball.
    pub fn stretched(mut self, along: Vec3, elongation: f32) -> Self {
        let tangent = along - self.middle * along.dot(&self.middle);
        if let Some(axis) = tangent.try_normalize(1e-6) {
            self.axes = [axis, self.middle.cross(&axis)];
        }
        self.elongation = elongation;
        self
    }

    /// Angle from the middle beyond which there is no ink, radians.
    pub fn reach(&self) -> f64 {
        self.radius * (1.0 + f64::from(self.elongation)) + self.softness
    }
}
