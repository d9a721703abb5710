//! The golf shot of an exposure.

use super::strobe::StrobeHypothesis;
use crate::geometry::CameraFrame;
use crate::spin::MIN_FRAMES;
use crate::spin::golf::{GolfSpin, SpinType};
use crate::spin::golf_shot::{Launch, Shot};

/// A spin is measured where the order of its images has odds of 20 to 1, as elsewhere.
const SURE: f64 = 20.0 / 21.0;

impl StrobeHypothesis {
    /// The spin in golf's words, where `frame` is that of the orientations.
    pub fn golf(&self, frame: CameraFrame) -> Option<GolfSpin> {
        let (fit, others) = self.spin.as_ref().ok()?;
        let is_checked = fit.inliers >= MIN_FRAMES && others.is_empty();
        let spin_type = match is_checked && self.probability >= SURE {
            true => SpinType::Measured,
            false => SpinType::Estimated,
        };
        // The turn between the axes is its own inverse.
        let fit = fit.turned(&frame.turn());
        let covariance = fit.spin_covariance.as_ref();
        let spin = &fit.motion.spin;
        Some(GolfSpin::new(spin, covariance, self.flight, spin_type))
    }

    /// The velocity with which the ball flies off, where `frame` is that of the orientations; `None` where its positions are not known.
    pub fn launch(&self, frame: CameraFrame) -> Option<Launch> {
        let rows = self.orientations.rows.iter();
        let timed: Option<Vec<_>> = rows
            .map(|row| Some((row.time_s, row.position?.turned(&frame.turn()))))
            .collect();
        Launch::through(&timed?)
    }

    /// The shot as simulators read it, where `frame` is that of the orientations; `None` without a spin.
    pub fn shot(&self, number: u64, frame: CameraFrame) -> Option<Shot> {
        Some(Shot {
            number,
            spin: self.golf(frame)?,
            launch: self.launch(frame),
            flight: self.flight,
        })
    }
}
