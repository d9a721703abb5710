//! Estimates the orientation of the ball in every image of a folder, and its spin.
//!
//!     cargo run --release --example estimate_folder -- PATTERN.csv DIR
//!
//! File names are times in nanoseconds, as SpinDOE has them.

use spindoe::clip::{self, BatchConfig, SequenceOutcome};
use spindoe::vision::DetectorName;
use spindoe::{Estimator, EstimatorConfig, Pattern};

fn main() -> spindoe::Result<()> {
    let mut arguments = std::env::args_os().skip(1);
    let (Some(pattern), Some(dir)) = (arguments.next(), arguments.next()) else {
        eprintln!("usage: estimate_folder PATTERN.csv DIR");
        return Ok(());
    };
    let pattern = Pattern::read_csv(pattern.as_ref())?;
    let detector = DetectorName::Cnn.build()?;
    let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector)?;
    let batch = clip::run(&estimator, &[dir.into()], &BatchConfig::default(), &())?;
    for frame in &batch.frames {
        match &frame.estimate().outcome {
            Ok(pose) => {
                let [w, x, y, z] = spindoe::geometry::to_wxyz(&pose.rotation);
                let p = pose.confidence;
                println!("{}: {w:.4} {x:.4} {y:.4} {z:.4}, p = {p:.3}", frame.name);
            }
            Err(rejection) => println!("{}: {rejection}", frame.name),
        }
    }
    match &batch.sequence {
        SequenceOutcome::Estimated { spin: Ok(fit), .. } => {
            println!(
                "{:.2} rps, spin {:?} rad/s",
                fit.motion.rps(),
                fit.motion.spin
            );
        }
        SequenceOutcome::Estimated {
            spin: Err(rejection),
            ..
        } => println!("no spin: {rejection}"),
        SequenceOutcome::NoTimes => println!("no spin: the frames have no times"),
        SequenceOutcome::TimesNotIncreasing => println!("no spin: the times do not increase"),
        _ => {}
    }
    Ok(())
}
