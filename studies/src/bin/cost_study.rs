//! What does a frame cost that is answered, and one that is not?
//!
//! Crops in all and in good conditions, each alone; CPU time of the one thread, by `/proc/thread-self/schedstat` (Linux), under
//! several limits of the recognizer's runs.
//!
//!     cargo run --release -p spindoe-studies --bin cost_study -- [FRAMES] [SEED] [RUNS..]

use std::error::Error;

use nalgebra::{Quaternion, UnitQuaternion};
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::frames;
use spindoe::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};

const FAILURE_DEG: f64 = 20.0;

/// CPU time of this thread so far, milliseconds.
fn cpu_ms() -> Result<f64, Box<dyn Error>> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat")?;
    let first = text.split_whitespace().next().unwrap_or_default();
    Ok(1e-6 * first.parse::<f64>()?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let numbers = std::env::args().skip(1).map(|a| a.parse::<u64>());
    let numbers = numbers.collect::<Result<Vec<_>, _>>()?;
    let count = numbers.first().copied().unwrap_or(800) as usize;
    let seed = numbers.get(1).copied().unwrap_or(515_151);
    let runs = match numbers.get(2..) {
        Some(runs) if !runs.is_empty() => runs.to_vec(),
        _ => vec![Budget::default().runs as u64],
    };
    let pattern = Pattern::read_csv(std::path::Path::new("designs/dots20/pattern.csv"))?;
    let detector = DetectorName::Cnn.build()?;
    let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector)?;
    let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
    println!("{count} frames of each kind, seed {seed}\n");
    println!(
        "| frames | runs | answered | wrong | mean, ms | not answered | mean, ms | runs made | all, ms |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for (name, config) in [
        ("all conditions", SynthConfig::default()),
        ("good conditions", SynthConfig::good()),
    ] {
        let frames = frames(&pattern, &config, seed, count)?;
        for &runs in &runs {
            let budget = Budget {
                runs: runs as usize,
                ..Budget::default()
            };
            let (mut counts, mut spent, mut made, mut wrong) = ([0usize; 2], [0.0; 2], 0, 0);
            for frame in &frames {
                let begun = cpu_ms()?;
                estimator.estimate(&frame.image, &Prior::default(), &budget, &mut ws, &mut out);
                let ms = cpu_ms()? - begun;
                let kind = usize::from(out.pose().is_none());
                counts[kind] += 1;
                spent[kind] += ms;
                made += kind * out.attempts();
                let [w, x, y, z] = frame.truth.quaternion_wxyz;
                let truth = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
                let off = out.pose().map(|p| p.rotation.angle_to(&truth).to_degrees());
                wrong += usize::from(off.is_some_and(|off| off > FAILURE_DEG));
            }
            let mean = |kind: usize| spent[kind] / counts[kind].max(1) as f64;
            println!(
                "| {name} | {runs} | {} | {wrong} | {:.2} | {} | {:.2} | {:.1} | {:.2} |",
                counts[0],
                mean(0),
                counts[1],
                mean(1),
                made as f64 / counts[1].max(1) as f64,
                (spent[0] + spent[1]) / frames.len() as f64,
            );
        }
    }
    Ok(())
}
