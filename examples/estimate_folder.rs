//! Estimates the ball's orientation in every image of a folder, and its spin.
//!
//!     cargo run --release --example estimate_folder -- PATTERN.csv DIR
//!
//! File names are times in nanoseconds, as in the SpinDOE data.

use spindoe::pattern::Pattern;
use spindoe::vision::estimator::{SequenceConfig, estimate_spin, track_sequence};
use spindoe::vision::{DetectorName, Estimator, EstimatorConfig, FrameEstimate, input};

fn main() -> spindoe::Result<()> {
    let mut arguments = std::env::args_os().skip(1);
    let (Some(pattern), Some(dir)) = (arguments.next(), arguments.next()) else {
        eprintln!("usage: estimate_folder PATTERN.csv DIR");
        return Ok(());
    };
    let pattern = Pattern::read_csv(pattern.as_ref())?;
    let detector = DetectorName::Cnn.build()?;
    let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector)?;
    let mut workspace = estimator.workspace();
    let (mut names, mut times, mut frames) = (Vec::new(), Vec::new(), Vec::new());
    for source in input::sources(&[dir.into()])? {
        input::read_frames(&source, &mut |frame| {
            let mut seen = FrameEstimate::default();
            estimator.estimate_frame(&frame.image, None, None, &mut workspace, &mut seen);
            times.push(frame.time_s);
            names.push(frame.name);
            frames.push(seen);
            Ok(())
        })?;
    }
    let times: Option<Vec<f64>> = times.into_iter().collect();
    let config = SequenceConfig::default();
    if let Some(times) = &times {
        track_sequence(&estimator, &config, times, &mut frames, &mut workspace);
    }
    for (name, frame) in names.iter().zip(&frames) {
        match &frame.outcome {
            Ok(pose) => {
                let q = pose.rotation.into_inner();
                let [w, x, y, z] = [q.w, q.i, q.j, q.k];
                println!(
                    "{name}: {w:.4} {x:.4} {y:.4} {z:.4}, p = {:.3}",
                    pose.pose_confidence
                );
            }
            Err(rejection) => println!("{name}: {rejection}"),
        }
    }
    if let Some(times) = &times {
        match estimate_spin(&config, times, &frames) {
            Ok(fit) => println!(
                "{:.2} rps, spin {:?} rad/s",
                fit.motion.rps(),
                fit.motion.spin
            ),
            Err(rejection) => println!("no spin: {rejection}"),
        }
    }
    Ok(())
}
