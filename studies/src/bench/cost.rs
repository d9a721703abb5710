//! What does a frame cost that is answered, and one that is not?
//!
//! Crops in all and in good conditions, each alone; CPU time of the one thread, under several limits of the
//! recognizer's runs.
//!
//!     cargo run --release -p spindoe-studies -- cost --help

use std::error::Error;

use cpu_time::ThreadTime;
use nalgebra::{Quaternion, UnitQuaternion};
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::frames;
use spindoe::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};

const FAILURE_DEG: f64 = 20.0;

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Frames of each kind.
    #[arg(long, default_value_t = 800)]
    frames: usize,
    /// Seed of the frames.
    #[arg(long, default_value_t = 515_151)]
    seed: u64,
    /// Limits of the recognizer's runs; the default of a budget without one.
    #[arg(long)]
    runs: Vec<usize>,
}

impl Args {
    /// Measures and prints.
    ///
    /// # Errors
    /// What hinders the measurement.
    pub fn run(&self) -> Result<(), Box<dyn Error>> {
        let (count, seed) = (self.frames, self.seed);
        let runs = match self.runs.as_slice() {
            [] => vec![Budget::default().runs],
            runs => runs.to_vec(),
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
                    runs,
                    ..Budget::default()
                };
                let (mut counts, mut spent, mut made, mut wrong) = ([0usize; 2], [0.0; 2], 0, 0);
                for frame in &frames {
                    let begun = ThreadTime::now();
                    estimator.estimate(&frame.image, &Prior::default(), &budget, &mut ws, &mut out);
                    let ms = 1e3 * begun.elapsed().as_secs_f64();
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
}
