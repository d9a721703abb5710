//! Random cameras before which predictions are compared with what is rendered.

use rand::RngExt;
use spindoe::predict::{CameraConditions, Surroundings};
use spindoe::synth::dataset::frame_rng;

/// Balls of 25 to 150 pixels, exposures of 0.05 to 0.5 ms, spins up to 20 to 150 rps, dots of 0.07 to
/// 0.13 ball diameters, every second before dark and the others before any surroundings, half of them with
/// distance, blur and noise stated.
pub fn random_conditions(seed: u64, camera: u64) -> CameraConditions {
    let mut rng = frame_rng(seed, 1 << 60 | camera);
    let mut log = |low: f64, high: f64| low * (high / low).powf(rng.random::<f64>());
    let base = CameraConditions {
        ball_px: log(25.0, 150.0),
        exposure_s: log(5e-5, 5e-4),
        dot_diameter: log(0.07, 0.13),
        rps: [0.0, log(20.0, 150.0)],
        surroundings: Surroundings::ALL[(camera % 2) as usize],
        ..CameraConditions::default()
    };
    let stated = CameraConditions {
        distance_radii: Some(log(7.0, 50.0)),
        defocus_px: Some(log(0.2, 1.2) * base.ball_px / 60.0),
        noise_levels: Some(log(0.3, 6.0)),
        ..base
    };
    if (camera / 2).is_multiple_of(2) {
        base
    } else {
        stated
    }
}
