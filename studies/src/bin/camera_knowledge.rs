//! What is it worth to know the camera's distance?
//!
//! Frames in good conditions (balls of 60 px, cameras at 6 to 60 radii) are estimated with the distance
//! unknown, taken for infinite, and known.
//!
//!     cargo run --release -p spindoe-studies --bin camera_knowledge [FRAMES] [SEED] [PATTERN.csv]

use std::error::Error;

use rayon::prelude::*;
use spindoe::geometry::Rotation;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{Frame, frames};
use spindoe::validate::Proportion;
use spindoe::vision::estimator::CameraModel;
use spindoe::vision::{
    Budget, Camera, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior,
};

/// The paper's limit of failure.
const FAILURE_DEG: f64 = 20.0;

/// How a frame's camera is taken.
type Knowledge = fn(&Frame) -> CameraModel;

/// The error of the answer, degrees.
fn error_deg(
    pattern: &Pattern,
    camera: CameraModel,
    frame: &Frame,
) -> Result<Option<f64>, spindoe::Error> {
    let config = EstimatorConfig {
        camera,
        ..EstimatorConfig::default()
    };
    let estimator = Estimator::new(pattern, config, DetectorName::Cnn.build()?)?;
    let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
    estimator.estimate(
        &frame.image,
        &Prior::default(),
        &Budget::default(),
        &mut ws,
        &mut out,
    );
    // With intrinsics the pose is in the camera's frame, else in the view frame.
    let [w, x, y, z] = match camera {
        CameraModel::Known(Camera::Perspective(_)) => frame.truth.camera_quaternion_wxyz,
        _ => frame.truth.quaternion_wxyz,
    };
    let truth = Rotation::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
    Ok(out.pose().map(|p| p.rotation.angle_to(&truth).to_degrees()))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let count: usize = arguments.next().map_or(Ok(500), |a| a.parse())?;
    let seed: u64 = arguments.next().map_or(Ok(5), |a| a.parse())?;
    let path = arguments
        .next()
        .unwrap_or("designs/dots20/pattern.csv".into());
    let pattern = Pattern::read_csv(path.as_ref())?;
    let frames = frames(&pattern, &SynthConfig::good(), seed, count)?;
    println!("{count} frames, seed {seed}, {path}\n");
    println!("| camera | correct | wrong | unanswered | median error |\n|---|---|---|---|---|");
    let knowledge: [(&str, Knowledge); 4] = [
        ("unknown", |_| CameraModel::default()),
        ("parallel rays", |_| Camera::Orthographic.into()),
        ("distance known", |frame| {
            let inverse_distance = frame.truth.distance.map_or(0.0, f64::recip);
            Camera::Near { inverse_distance }.into()
        }),
        ("intrinsics known", |frame| {
            let camera = frame.truth.intrinsics.map(Camera::Perspective);
            camera.unwrap_or_default().into()
        }),
    ];
    for (name, camera) in knowledge {
        let errors: Result<Vec<Option<f64>>, spindoe::Error> = frames
            .par_iter()
            .map(|frame| error_deg(&pattern, camera(frame), frame))
            .collect();
        let answers: Vec<f64> = errors?.into_iter().flatten().collect();
        let mut correct: Vec<f64> = answers
            .iter()
            .copied()
            .filter(|e| *e < FAILURE_DEG)
            .collect();
        correct.sort_by(f64::total_cmp);
        let share = |n: usize| Proportion::new(n as u64, count as u64);
        println!(
            "| {name} | {} | {} | {} | {:.2} deg |",
            share(correct.len()),
            share(answers.len() - correct.len()),
            share(count - answers.len()),
            correct.get(correct.len() / 2).copied().unwrap_or(f64::NAN)
        );
    }
    Ok(())
}
