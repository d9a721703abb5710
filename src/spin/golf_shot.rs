//! A golf shot as simulators read it: GSPro's [Open Connect V1], which others take as well.
//!
//! One JSON object a shot. `BallData` has `TotalSpin`, `BackSpin` and `SideSpin` (rpm) and `SpinAxis` (degrees, positive bends the flight to
//! the right), with `BackSpin = TotalSpin cos(SpinAxis)` and `SideSpin = TotalSpin sin(SpinAxis)`: the rifle spin, which bends no
//! flight, is not part of these. `Speed` (mph), `HLA` and `VLA` (degrees to the right of the line of flight and above the horizontal)
//! are there where the ball's positions are, and `ContainsBallData` says so: the format requires them. `SpinType`, measured or
//! estimated, is this crate's own word beside the format's.
//!
//! Guarantees: what is not known is not in the object. The line of flight is the [`GolfFlight`] in the picture: left or right of a level camera
//! that stands square to the target line, up or down of one that looks down on it.
//!
//! [Open Connect V1]: https://gsprogolf.com/GSProConnectV1.html

use serde::Serialize;

use super::golf::{GolfFlight, GolfSpin, SpinType};
use crate::geometry::{Position, Vec3};

/// A mile an hour, m/s.
const MPH: f64 = 0.447_04;

/// How a ball flies off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Launch {
    /// Velocity, camera frame, m/s.
    pub velocity_m_s: Vec3,
}

impl Launch {
    /// The straight line through a ball's positions (camera frame) at these times, s, by least squares; `None` for fewer than two times.
    pub fn through(timed: &[(f64, Position)]) -> Option<Self> {
        let count = timed.len() as f64;
        let mean_s = timed.iter().map(|t| t.0).sum::<f64>() / count;
        let spread: f64 = timed.iter().map(|t| (t.0 - mean_s).powi(2)).sum();
        if timed.len() < 2 || spread <= 0.0 {
            return None;
        }
        let weighed = timed
            .iter()
            .map(|(time_s, p)| p.center_m * ((time_s - mean_s) / spread));
        Some(Self {
            velocity_m_s: weighed.sum(),
        })
    }
}

/// A shot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// Its number, from 1 on.
    pub number: u64,
    /// Its spin.
    pub spin: GolfSpin,
    /// Where it flies, if the ball's positions are known.
    pub launch: Option<Launch>,
    /// The line of flight in the picture.
    pub flight: GolfFlight,
}

#[derive(Serialize)]
#[serde(rename_all = "PascalCase")]
struct Message {
    #[serde(rename = "DeviceID")]
    device: &'static str,
    units: &'static str,
    shot_number: u64,
    #[serde(rename = "APIversion")]
    version: &'static str,
    ball_data: BallData,
    shot_data_options: Options,
    spin_type: SpinType,
}

#[derive(Serialize)]
#[serde(rename_all = "PascalCase")]
struct BallData {
    #[serde(skip_serializing_if = "Option::is_none")]
    speed: Option<f64>,
    spin_axis: f64,
    total_spin: f64,
    back_spin: f64,
    side_spin: f64,
    #[serde(rename = "HLA", skip_serializing_if = "Option::is_none")]
    horizontal: Option<f64>,
    #[serde(rename = "VLA", skip_serializing_if = "Option::is_none")]
    vertical: Option<f64>,
}

#[derive(Serialize)]
#[serde(rename_all = "PascalCase")]
struct Options {
    contains_ball_data: bool,
    contains_club_data: bool,
}

impl Serialize for Shot {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let (along, up) = (self.flight.direction(), self.flight.up());
        let right = along.cross(&up);
        let velocity = self.launch.map(|launch| launch.velocity_m_s);
        let ahead = |v: Vec3| v.dot(&along).hypot(v.dot(&right));
        let spin = &self.spin;
        let message = Message {
            device: concat!("spindoe ", env!("CARGO_PKG_VERSION")),
            units: "Yards",
            shot_number: self.number,
            version: "1",
            ball_data: BallData {
                speed: velocity.map(|v| v.norm() / MPH),
                spin_axis: spin.tilt_deg,
                total_spin: spin.backspin_rpm.hypot(spin.sidespin_rpm),
                back_spin: spin.backspin_rpm,
                side_spin: spin.sidespin_rpm,
                horizontal: velocity.map(|v| v.dot(&right).atan2(v.dot(&along)).to_degrees()),
                vertical: velocity.map(|v| v.dot(&up).atan2(ahead(v)).to_degrees()),
            },
            shot_data_options: Options {
                contains_ball_data: velocity.is_some(),
                contains_club_data: false,
            },
            spin_type: spin.spin_type,
        };
        message.serialize(serializer)
    }
}
