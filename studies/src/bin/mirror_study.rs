//! How often are the images of a flipped camera told apart from those of an upright one?
//!
//!     cargo run --release -p spindoe-studies --bin mirror_study -- [FRAMES] [PATTERN.csv ...]
//!
//! Flipped images of a ball are images of a ball with the pattern's mirror image. Its scenes before
//! the default camera are rendered, and read by the estimator of the pattern itself. A flipped view is told apart where that gives no pose; where it gives one, the
//! view is taken for one of the pattern. Frames without an outline are left out.

use std::error::Error;

use rayon::prelude::*;
use spindoe::Pattern;
use spindoe::camera::{CameraConditions, CameraTrials};
use spindoe::recognize::RecognizerRejection;
use spindoe::stats::Proportion;
use spindoe::vision::verdict::mirrored_pattern;
use spindoe::vision::{Budget, DetectorName, Estimator, FrameEstimate, FrameRejection, Prior};

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Seed of the scenes.
const SEED: u64 = 15_600_001;

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
    let trials = CameraTrials::new(CameraConditions::default(), SEED);
    println!("| pattern | dots | named mirrored | taken for the pattern |");
    println!("|---|---|---|---|");
    for path in paths {
        let pattern = Pattern::read_csv(path.as_ref())?;
        let mirrored = mirrored_pattern(&pattern)?;
        let estimator = Estimator::new(&pattern, trials.estimator, DetectorName::Cnn.build()?)?;
        let counts: Result<Vec<[u64; 3]>, spindoe::Error> = (0..frames)
            .into_par_iter()
            .map_init(
                || estimator.workspace(),
                |ws, k| {
                    let image = trials.conditions.scene(&mirrored, SEED, k)?.render()?.image;
                    let mut found = FrameEstimate::default();
                    estimator.estimate(
                        &image,
                        &Prior::default(),
                        &Budget::default(),
                        ws,
                        &mut found,
                    );
                    let is_named = matches!(
                        found.outcome,
                        Err(FrameRejection::Recognizer(RecognizerRejection::Mirrored))
                    );
                    let seen = [found.outline.is_some(), is_named, found.pose().is_some()];
                    Ok(seen.map(u64::from))
                },
            )
            .collect();
        let [all, named, taken] = counts?
            .into_iter()
            .fold([0; 3], |sum, own| std::array::from_fn(|i| sum[i] + own[i]));
        println!(
            "| {path} | {} | {} of {all} | {} of {all} |",
            pattern.len(),
            Proportion::new(named, all),
            Proportion::new(taken, all),
        );
    }
    Ok(())
}
