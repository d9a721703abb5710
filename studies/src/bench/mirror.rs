//! How often are the images of a flipped camera distinguished from those of an upright one?
//!
//!     cargo run --release -p spindoe-studies -- mirror --help
//!
//! Flipped images of a ball are images of a ball with the pattern's mirror image. Its scenes before the default camera
//! are rendered, and read by the estimator of the pattern itself. A flipped view is recognized where that gives no
//! pose; where it gives one, the view is taken for one of the pattern. Frames without an outline are left out.

use rayon::prelude::*;
use spindoe::camera::{CameraConditions, CameraTrials};
use spindoe::clip::verdict::mirrored_pattern;
use spindoe::recognize::RecognizerRejection;
use spindoe::vision::{DetectorName, Estimator, FrameRejection};
use spindoe_studies::frames::{Patterns, Workspace, alone, workspaces};
use spindoe_studies::score::share;
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// Seed of the scenes.
const SEED: u64 = 15_600_001;

#[derive(clap::Args)]
pub struct Args {
    /// Frames of a pattern.
    #[arg(long, default_value_t = 3000)]
    frames: u64,
    #[command(flatten)]
    patterns: Patterns,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let frames = self.frames;
        let trials = CameraTrials::new(CameraConditions::default(), SEED);
        println!("{frames} frames a pattern, seed {SEED}");
        let table = Table::new([
            "pattern",
            "dots",
            "frames with an outline",
            "named mirrored",
            "taken for the pattern",
        ]);
        for (name, pattern) in self.patterns.read()? {
            let mirrored = mirrored_pattern(&pattern)?;
            let estimator = Estimator::new(&pattern, trials.estimator, DetectorName::Cnn.build()?)?;
            let ours = std::array::from_ref(&estimator);
            let one = |ws: &mut Workspace, k: u64| {
                let scene = trials.conditions.scene(&mirrored, SEED, k)?;
                Ok(alone(&estimator, &scene.render()?.image, ws))
            };
            let found = (0..frames).into_par_iter();
            let found = found.map_init(|| workspaces(ours), |ws, k| one(&mut ws[0], k));
            let mut found: Vec<_> = found.collect::<spindoe::Result<_>>()?;
            found.retain(|f| f.outline.is_some());
            let mirrored = Err(FrameRejection::Recognizer(RecognizerRejection::Mirrored));
            row!(
                table; name, pattern.len(), found.len(), share(&found, |f| f.outcome == mirrored),
                share(&found, |f| f.pose().is_some())
            );
        }
        Ok(())
    }
}
