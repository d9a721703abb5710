//! How often are the images of a flipped camera told apart from those of an upright one?
//!
//!     cargo run --release -p spindoe-studies -- mirror --help
//!
//! Flipped images of a ball are images of a ball with the pattern's mirror image. Its scenes before
//! the default camera are rendered, and read by the estimator of the pattern itself. A flipped view is told apart where that gives no pose; where it gives one, the
//! view is taken for one of the pattern. Frames without an outline are left out.

use std::error::Error;
use std::path::PathBuf;

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

/// The patterns that are measured by default.
const DESIGNS: [&str; 6] = [
    "designs/dots12/pattern.csv",
    "designs/dots16/pattern.csv",
    "designs/dots20/pattern.csv",
    "designs/dots20-paper/pattern.csv",
    "designs/dots24/pattern.csv",
    "designs/dots32/pattern.csv",
];

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Frames of a pattern.
    #[arg(long, default_value_t = 3000)]
    frames: u64,
    /// Patterns.
    #[arg(default_values = DESIGNS, value_name = "PATTERN.csv")]
    patterns: Vec<PathBuf>,
}

impl Args {
    /// Measures and prints.
    ///
    /// # Errors
    /// What hinders the measurement.
    pub fn run(&self) -> Outcome<()> {
        let frames = self.frames;
        let trials = CameraTrials::new(CameraConditions::default(), SEED);
        println!("| pattern | dots | named mirrored | taken for the pattern |");
        println!("|---|---|---|---|");
        for path in &self.patterns {
            let pattern = Pattern::read_csv(path)?;
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
                "| {} | {} | {} of {all} | {} of {all} |",
                path.display(),
                pattern.len(),
                Proportion::new(named, all),
                Proportion::new(taken, all),
            );
        }
        Ok(())
    }
}
