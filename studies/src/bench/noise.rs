//! How often does the estimator answer images that show no ball, and what do their outlines look like
//! beside those of balls?
//!
//! Noise of five spectra (white; white after a Gaussian of 1, 2 and 4 px; pink) and of sides from 40
//! to 200 px is estimated, and frames of balls in all conditions. The table gives the share answered
//! at a confidence of 0.5 and of 0.9; with `--all`, every answered image is listed.
//!
//!     cargo run --release -p spindoe-studies -- noise --help

use std::error::Error;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::image::{GrayImage, ImageView, RgbImage};
use spindoe::pattern::Pattern;
use spindoe::synth::dataset::independent_frame;
use spindoe::synth::{SynthConfig, SynthKind};
use spindoe::validate::Proportion;
use spindoe::vision::{
    Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, NamedDetector, Prior,
};
use spindoe_studies::noise::NoiseField;

fn noise(seed: u64, k: u64) -> Result<(String, GrayImage), spindoe::Error> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(k);
    let field = NoiseField::random(&mut rng, k);
    let image = GrayImage::new(field.side, field.side, field.values)?;
    Ok((field.name, image))
}

/// An image without a ball, or with one.
enum Picture {
    Gray(String, GrayImage),
    Color(String, RgbImage),
}

fn picture(group: &str, seed: u64, k: u64, pattern: &Pattern) -> spindoe::Result<Picture> {
    let config = match group {
        "noise" => {
            let (name, image) = noise(seed, k)?;
            return Ok(Picture::Gray(name, image));
        }
        "rendered noise" => SynthConfig {
            kind: SynthKind::Noise,
            ..SynthConfig::default()
        },
        "balls, good conditions" => SynthConfig::good(),
        _ => SynthConfig::default(),
    };
    let frame = independent_frame(pattern, &config, seed, k as usize)?;
    Ok(Picture::Color(format!("{k}"), frame.image))
}

fn line(name: &str, out: &FrameEstimate) -> String {
    let pose = out.pose().map_or(0.0, |p| p.confidence);
    let fit = out.fit.map_or_else(String::new, |f| {
        format!(
            "radius {:.0} support {:.2} visible {:.2} {:?} contrast {:.3} edge {:.2} rivals {}",
            f.circle.radius, f.support, f.visible, f.polarity, f.contrast, f.edge_width, f.rivals
        )
    });
    let likely = out.dots.iter().filter(|d| d.confidence >= 0.5).count();
    format!(
        "{name}: {pose:.4} | {fit} | dots {likely} of {}, matched {}",
        out.dots.len(),
        out.matched()
    )
}

fn estimate(estimator: &Estimator<NamedDetector>, picture: &Picture) -> (f64, String, bool) {
    let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
    let (name, image) = match picture {
        Picture::Gray(name, image) => (name, ImageView::from(image)),
        Picture::Color(name, image) => (name, ImageView::from(image)),
    };
    estimator.estimate(
        image,
        &Prior::default(),
        &Budget::default(),
        &mut ws,
        &mut out,
    );
    let confidence = out.pose().map_or(0.0, |p| p.confidence);
    (confidence, line(name, &out), out.circle.is_some())
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Images of a line.
    #[arg(long, default_value_t = 300)]
    images: u64,
    /// Seed of the images.
    #[arg(long, default_value_t = 90)]
    seed: u64,
    /// List every image that is answered.
    #[arg(long)]
    list: bool,
}

impl Args {
    /// Measures and prints.
    ///
    /// # Errors
    /// What hinders the measurement.
    pub fn run(&self) -> Result<(), Box<dyn Error>> {
        let Args {
            images: count,
            seed,
            list: is_all,
        } = *self;
        let pattern = Pattern::read_csv("designs/dots20/pattern.csv".as_ref())?;
        let config = EstimatorConfig::default();
        let estimator = Estimator::new(&pattern, config, DetectorName::Cnn.build()?)?;
        println!("{count} images a line, seed {seed}\n");
        println!("| images | outline found | answered at 0.5 | at 0.9 |\n|---|---|---|---|");
        for group in [
            "noise",
            "rendered noise",
            "balls, all conditions",
            "balls, good conditions",
        ] {
            let answers: spindoe::Result<Vec<_>> = (0..count)
                .into_par_iter()
                .map(|k| {
                    let picture = picture(group, seed, k, &pattern)?;
                    Ok(estimate(&estimator, &picture))
                })
                .collect();
            let answers = answers?;
            let share = |test: &dyn Fn(&(f64, String, bool)) -> bool| {
                Proportion::new(answers.iter().filter(|a| test(a)).count() as u64, count)
            };
            println!(
                "| {group} | {} | {} | {} |",
                share(&|a| a.2),
                share(&|a| a.0 >= 0.5),
                share(&|a| a.0 >= 0.9),
            );
            if is_all {
                for (_, line, _) in answers.iter().filter(|a| a.0 > 0.0) {
                    println!("    {line}");
                }
            }
        }
        Ok(())
    }
}
