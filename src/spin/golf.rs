//! A spin in golf's words: backspin, sidespin, the tilt of its axis, rpm.
//!
//! With the flight's horizontal direction `f`, up `z'` and the right of who looks along `f`, `r = f x z'`:
//!
//! ```text
//! backspin = w . r,   sidespin = -w . z',   rifle spin = w . f,   tilt = atan2(sidespin, backspin)
//! ```
//!
//! so that the top of a ball with backspin moves against its flight, and positive sidespin, clockwise from above, and a positive tilt
//! bend the flight to the right. A flight to the left or right of the picture is seen from the side by a camera that is level: up
//! is up in the picture. One up or down the picture is seen from above: up is towards the camera.
//!
//! ```
//! use spindoe::geometry::Vec3;
//! use spindoe::spin::golf::{GolfFlight, GolfSpin, SpinType};
//!
//! let spin = GolfSpin::new(&Vec3::new(0.0, -20.0, 300.0), None, GolfFlight::Right, SpinType::Measured);
//! assert!((spin.backspin_rpm - 2864.8).abs() < 0.1 && (spin.sidespin_rpm - 191.0).abs() < 0.1);
//! assert!((spin.tilt_deg - 3.81).abs() < 0.01);
//! ```

use std::f64::consts::TAU;

use nalgebra::Matrix3;

use crate::error::{Error, Result};
use crate::geometry::Vec3;

/// Diameter of a golf ball, mm: the least that the rules of golf allow.
pub const BALL_MM: f64 = 42.67;
/// The fastest golf spin that is considered, revolutions per second: 15 000 rpm.
pub const MAX_RPS: f64 = 250.0;

/// The direction of a flight in the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GolfFlight {
    /// To the left.
    Left,
    /// To the right.
    Right,
    /// Up.
    Up,
    /// Down.
    Down,
}

impl GolfFlight {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Left, Self::Right, Self::Up, Self::Down];

    /// The name on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Up => "up",
            Self::Down => "down",
        }
    }

    /// The flight's direction, camera frame.
    pub fn direction(self) -> Vec3 {
        match self {
            Self::Left => -Vec3::x(),
            Self::Right => Vec3::x(),
            Self::Up => Vec3::y(),
            Self::Down => -Vec3::y(),
        }
    }

    /// The nearest direction of a motion in the picture (u to the right, v down).
    pub fn of_motion([u, v]: [f64; 2]) -> Self {
        match (u.abs() >= v.abs(), u >= 0.0, v >= 0.0) {
            (true, true, _) => Self::Right,
            (true, false, _) => Self::Left,
            (false, _, true) => Self::Down,
            (false, _, false) => Self::Up,
        }
    }

    /// Up, camera frame: of the picture for who looks from the side, towards the camera for who looks from above.
    pub fn up(self) -> Vec3 {
        match self {
            Self::Left | Self::Right => Vec3::y(),
            Self::Up | Self::Down => Vec3::z(),
        }
    }
}

impl std::fmt::Display for GolfFlight {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

impl std::str::FromStr for GolfFlight {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "flight", name)
    }
}

/// How a spin is known, as launch monitors say it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SpinType {
    /// Three orientations or more agree on it, and odds of 20 to 1 or better exclude any other spin and any other order of the images.
    Measured,
    /// It rests on an assumption: that two orientations are right which nothing checks, that the slowest of several spins is the
    /// ball's, or that the likeliest of several orders of the images is theirs.
    Estimated,
}

impl SpinType {
    /// The word in JSON and Python.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Estimated => "estimated",
        }
    }
}

/// A spin in golf's words.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct GolfSpin {
    /// Magnitude, revolutions per minute.
    pub total_rpm: f64,
    /// About the horizontal axis across the flight; positive lifts the ball.
    pub backspin_rpm: f64,
    /// About the vertical; positive bends the flight to the right.
    pub sidespin_rpm: f64,
    /// About the line of flight.
    pub rifle_rpm: f64,
    /// Tilt of the spin's axis, degrees; positive bends the flight to the right.
    pub tilt_deg: f64,
    /// Standard deviations of backspin and sidespin, rpm, where the spin has a covariance.
    pub std_rpm: Option<[f64; 2]>,
    /// Whether it is measured or estimated.
    pub spin_type: SpinType,
}

impl GolfSpin {
    /// The words for a spin (camera frame, rad/s) with its covariance.
    pub fn new(
        spin: &Vec3,
        covariance: Option<&Matrix3<f64>>,
        flight: GolfFlight,
        spin_type: SpinType,
    ) -> Self {
        let rpm = 60.0 / TAU;
        let (along, up) = (flight.direction(), flight.up());
        let right = along.cross(&up);
        let backspin_rpm = rpm * spin.dot(&right);
        let sidespin_rpm = -rpm * spin.dot(&up);
        let std = |c: &Matrix3<f64>| {
            [right, up].map(|axis| rpm * (axis.dot(&(c * axis))).max(0.0).sqrt())
        };
        Self {
            total_rpm: rpm * spin.norm(),
            backspin_rpm,
            sidespin_rpm,
            rifle_rpm: rpm * spin.dot(&along),
            tilt_deg: sidespin_rpm.atan2(backspin_rpm).to_degrees(),
            std_rpm: covariance.map(std),
            spin_type,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backspin_lifts_and_sidespin_bends_to_the_right_whatever_the_flight() {
        for flight in GolfFlight::ALL {
            let (along, up) = (flight.direction(), flight.up());
            // Backspin: the top, at `up`, moves against the flight.
            let lifting = up.cross(&along) * -100.0;
            assert!(lifting.cross(&up).dot(&along) < 0.0);
            let words = GolfSpin::new(&lifting, None, flight, SpinType::Measured);
            assert!(words.backspin_rpm > 900.0 && words.sidespin_rpm.abs() < 1e-9);
            // The air's force is along w x v: up with backspin, to the right with positive sidespin.
            assert!(lifting.cross(&along).dot(&up) > 0.0);
            let words = GolfSpin::new(&(up * -100.0), None, flight, SpinType::Measured);
            let force = (up * -100.0).cross(&along);
            let right = along.cross(&up);
            assert!(words.sidespin_rpm > 900.0 && force.dot(&right) > 0.0);
        }
    }

    #[test]
    fn the_nearest_direction_of_a_motion() {
        for (motion, flight) in [
            ([3.0, -2.0], GolfFlight::Right),
            ([-3.0, 2.0], GolfFlight::Left),
            ([1.0, -2.0], GolfFlight::Up),
            ([1.0, 2.0], GolfFlight::Down),
        ] {
            assert_eq!(GolfFlight::of_motion(motion), flight);
        }
    }
}
