//! How often does the estimator answer images that show no ball?
//!
//! Noise of five spectra (white; white after a Gaussian of 1, 2 and 4 px; pink) and of sides from 40 to 200 px is
//! estimated, and beside it frames of balls. The table gives the share answered at a confidence of 0.5 and of 0.9.
//!
//!     cargo run --release -p spindoe-studies -- noise --help

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::image::GrayImage;
use spindoe::pattern::Pattern;
use spindoe::synth::{SynthConfig, SynthKind};
use spindoe::vision::FrameEstimate;
use spindoe_studies::frames::{
    DOTS20, FrameSet, all_conditions, alone, each, estimator, good_conditions,
};
use spindoe_studies::noise::NoiseField;
use spindoe_studies::score::share;
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

#[derive(clap::Args)]
pub struct Args {
    /// Images of a line.
    #[arg(long, default_value_t = 300)]
    images: usize,
    /// Seed of the images.
    #[arg(long, default_value_t = 90)]
    seed: u64,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (count, seed) = (self.images, self.seed);
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        let estimator = [estimator(&pattern)?];
        println!("{count} images a line, seed {seed}");
        let table = Table::new(["images", "outline found", "answered at 0.5", "at 0.9"]);
        // Whether an outline is found, and the confidence of the answer.
        let seen = |found: &FrameEstimate| {
            (
                found.circle.is_some(),
                found.pose().map_or(0.0, |p| p.confidence),
            )
        };
        let line = |name: &str, seen: &[(bool, f64)]| {
            let above = [0.5, 0.9].map(|limit| share(seen, |s| s.1 >= limit));
            row!(table; name, share(seen, |s| s.0); above);
        };
        let field = |k: usize| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(k as u64);
            let field = NoiseField::random(&mut rng, k as u64);
            let image = GrayImage::new(field.side, field.side, field.values)?;
            Ok(seen(&alone(
                &estimator[0],
                &image,
                &mut estimator[0].workspace(),
            )))
        };
        let fields = (0..count).into_par_iter().map(field);
        line("noise", &fields.collect::<spindoe::Result<Vec<_>>>()?);
        let rendered = FrameSet {
            name: "rendered noise",
            config: SynthConfig {
                kind: SynthKind::Noise,
                ..SynthConfig::default()
            },
        };
        for set in [rendered, all_conditions(), good_conditions()] {
            let found = each(&estimator, &set.config, seed, count, |_, [found]| {
                seen(&found)
            })?;
            let balls = format!("balls, {}", set.name);
            let is_noise = set.config.kind == SynthKind::Noise;
            line(if is_noise { set.name } else { &balls }, &found);
        }
        Ok(())
    }
}
