//! A shot as golf simulators read it: the fields and the numbers of the format's own document.

use nalgebra::Matrix3;
use serde_json::{Value, json};
use spindoe::geometry::{Position, Vec3};
use spindoe::spin::golf::{GolfFlight, GolfSpin, SpinType};
use spindoe::spin::golf_shot::{Launch, Shot};

/// Speed, directions and spin of the document's example: 147.5 mph, 2.3 deg to the right, 14.3 deg up, an axis of -13.2 deg at 3250 rpm.
const SPEED_M_S: f64 = 147.5 * 1609.344 / 3600.0;
const RIGHT_DEG: f64 = 2.3;
const UP_DEG: f64 = 14.3;

/// The axes of who looks along a flight in the picture: ahead, right and up.
fn axes(flight: GolfFlight) -> [Vec3; 3] {
    let (x, y, z) = (Vec3::x(), Vec3::y(), Vec3::z());
    match flight {
        // A level camera to the player's right sees the ball fly to the left, and the other way round.
        GolfFlight::Right => [x, z, y],
        GolfFlight::Left => [-x, -z, y],
        // One that looks down.
        GolfFlight::Up => [y, x, z],
        GolfFlight::Down => [-y, -x, z],
    }
}

fn shot(flight: GolfFlight, rifle_rad_s: f64) -> Shot {
    let [ahead, right, up] = axes(flight);
    let (h, v) = (RIGHT_DEG.to_radians(), UP_DEG.to_radians());
    let velocity = SPEED_M_S * (v.cos() * (h.cos() * ahead + h.sin() * right) + v.sin() * up);
    let at = |time_s: f64| {
        let position = Position {
            center_m: Vec3::new(0.1, -0.2, -0.6) + velocity * time_s,
            covariance: Matrix3::identity() * 1e-8,
            with_rotation: None,
        };
        (time_s, position)
    };
    let launch = Launch::through(&[at(0.0), at(0.9e-3), at(2.1e-3)]).unwrap();
    assert!((launch.velocity_m_s - velocity).norm() < 1e-9);
    // Backspin turns the ball's top against the flight: about the player's right.
    let tilt = (-13.2f64).to_radians();
    let rate = 3250.0 * std::f64::consts::TAU / 60.0;
    let spin = rate * (tilt.cos() * right - tilt.sin() * up) + rifle_rad_s * ahead;
    let spin = GolfSpin::new(&spin, None, flight, SpinType::Estimated);
    Shot {
        number: 13,
        spin,
        launch: Some(launch),
        flight,
    }
}

#[test]
fn the_numbers_of_the_formats_example_come_back() {
    for flight in GolfFlight::ALL {
        let shot = shot(flight, 30.0);
        let message: Value = serde_json::from_str(&json!(shot).to_string()).unwrap();
        for name in [
            "DeviceID",
            "Units",
            "APIversion",
            "BallData",
            "ShotDataOptions",
        ] {
            assert!(message.get(name).is_some(), "{name}: {message}");
        }
        assert_eq!(
            (&message["APIversion"], &message["ShotNumber"]),
            (&json!("1"), &json!(13))
        );
        let ball = |name: &str| message["BallData"][name].as_f64().unwrap();
        for (name, expected) in [
            ("Speed", 147.5),
            ("SpinAxis", -13.2),
            ("TotalSpin", 3250.0),
            ("HLA", RIGHT_DEG),
            ("VLA", UP_DEG),
            ("BackSpin", 3250.0 * 13.2f64.to_radians().cos()),
            ("SideSpin", -3250.0 * 13.2f64.to_radians().sin()),
        ] {
            assert!(
                (ball(name) - expected).abs() < 1e-6,
                "{flight} {name}: {message}"
            );
        }
        assert_eq!(message["ShotDataOptions"]["ContainsBallData"], true);
        assert_eq!(message["ShotDataOptions"]["ContainsClubData"], false);
        assert_eq!(message["SpinType"], "estimated");
    }
}

#[test]
fn what_is_not_known_is_not_said() {
    let known = shot(GolfFlight::Right, 0.0);
    let message = json!(Shot {
        launch: None,
        ..known
    });
    let ball = message["BallData"].as_object().unwrap();
    let names: Vec<&str> = ball.keys().map(String::as_str).collect();
    let mut expected = ["SpinAxis", "TotalSpin", "BackSpin", "SideSpin"];
    expected.sort_unstable();
    assert!(
        expected.iter().all(|name| names.contains(name)) && names.len() == 4,
        "{names:?}"
    );
    assert_eq!(message["ShotDataOptions"]["ContainsBallData"], false);
    assert!(Launch::through(&[]).is_none());
}
