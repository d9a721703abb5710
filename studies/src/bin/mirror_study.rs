//! How often are the images of a flipped camera told apart from those of an upright one?
//!
//!     cargo run --release -p spindoe-studies --bin mirror_study -- [FRAMES] [PATTERN.csv ...]
//!
//! Flipped images of a ball are images of a ball with the pattern's mirror image. Its scenes before
//! the default camera are detected as the `camera` protocol has it, and read by the estimator of the
//! pattern itself. A flipped view is told apart where that gives no pose; where it gives one, the
//! view is taken for one of the pattern. Frames without an outline are left out.

use std::error::Error;

use rayon::prelude::*;
use spindoe::Pattern;
use spindoe::predict::{CameraConditions, DetectionModel};
use spindoe::recognize::RecognizerRejection;
use spindoe::stats::Proportion;
use spindoe::synth::dataset::frame_rng;
use spindoe::vision::verdict::mirrored_pattern;
use spindoe::vision::{BlobConfig, BlobDetector, Estimator, EstimatorConfig, FrameRejection};

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Seed of the scenes.
const SEED: u64 = 15_600_001;
/// Frames worked on by one task.
const CHUNK: u64 = 50;

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1);
    let frames: u64 = arguments.next().map_or(Ok(3000), |a| a.parse())?;
    let mut paths: Vec<String> = arguments.collect();
    if paths.is_empty() {
        let designs = [
            "dots12",
            "dots16",
            "dots20",
            "dots20-paper",
            "dots24",
            "dots32",
        ];
        paths = designs.map(|d| format!("designs/{d}/pattern.csv")).to_vec();
    }
    let model = DetectionModel::shipped()?;
    let conditions = CameraConditions::default();
    println!("| pattern | dots | named mirrored | taken for the pattern |");
    println!("|---|---|---|---|");
    for path in paths {
        let pattern = Pattern::read_csv(path.as_ref())?;
        let mirrored = mirrored_pattern(&pattern)?;
        let detector = BlobDetector::new(BlobConfig::default());
        let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector)?;
        let chunks: Outcome<Vec<[u64; 3]>> = (0..frames.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let (mut ws, mut terms) = (estimator.workspace(), Default::default());
                let mut counts = [0; 3];
                for k in chunk * CHUNK..((chunk + 1) * CHUNK).min(frames) {
                    let ball = conditions.scene(&mirrored, SEED, k)?.seen()?;
                    let mut rng = frame_rng(SEED + 1, k);
                    let found = model.detect(&ball, None, &mut terms, &mut rng);
                    let Some(mut frame) = found.map(|f| f.frame) else {
                        continue;
                    };
                    estimator.estimate_pose(None, &mut ws, &mut frame);
                    let is_named = matches!(
                        frame.outcome,
                        Err(FrameRejection::Recognizer(RecognizerRejection::Mirrored))
                    );
                    let found = [true, is_named, frame.pose().is_some()];
                    for (count, found) in counts.iter_mut().zip(found) {
                        *count += u64::from(found);
                    }
                }
                Ok(counts)
            })
            .collect();
        let mut counts = [0; 3];
        for chunk in chunks? {
            for (count, own) in counts.iter_mut().zip(chunk) {
                *count += own;
            }
        }
        let [all, named, taken] = counts;
        println!(
            "| {path} | {} | {} of {all} | {} of {all} |",
            pattern.len(),
            Proportion::new(named, all),
            Proportion::new(taken, all),
        );
    }
    Ok(())
}
