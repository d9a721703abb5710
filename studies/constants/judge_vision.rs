//! What frames come to as a constant changes: compiled by `sweep.py` into a copy of the sources whose constants are scaled at run time.

use cpu_time::ProcessTime;
use rayon::prelude::*;
use spindoe::camera::FrameOutcome;
use spindoe::geometry::Rotation;
use spindoe::image::RgbImage;
use spindoe::pattern::{Pattern, random_pattern};
use spindoe::sweep::{NAMES, scale};
use spindoe::synth::dataset::independent_frame;
use spindoe::synth::{SynthConfig, SynthKind};
use spindoe_studies::Outcome;
use spindoe_studies::frames::{DOTS20, alone, estimator};

/// Rendered frames, and what is asked of each.
#[derive(clap::Args)]
pub struct Args {
    /// Frames of each of the three sets with the ball, and pictures without it.
    #[arg(long, default_value_t = 240)]
    frames: usize,
    /// Seed of the frames.
    #[arg(long, default_value_t = 37_000_001)]
    seed: u64,
    /// Factors by which each constant is scaled.
    #[arg(long, num_args = 1.., default_values_t = [0.7, 1.4])]
    factors: Vec<f64>,
    /// Only constants whose name contains this.
    #[arg(long, default_value = "")]
    only: String,
}

struct Picture {
    image: RgbImage,
    truth: Option<Rotation>,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        let pictures = self.pictures(&pattern)?;
        println!("constant,factor,right,wrong,others,sum_of_errors_deg,judged,cpu_s");
        self.show("none", 1.0, &pattern, &pictures)?;
        for (k, name) in NAMES.iter().enumerate() {
            if !name.contains(&self.only) {
                continue;
            }
            for &factor in &self.factors {
                scale(k, factor);
                self.show(name, factor, &pattern, &pictures)?;
            }
            scale(usize::MAX, 1.0);
        }
        self.show("none", 1.0, &pattern, &pictures)
    }

    /// In all conditions, small and large ones, whole pictures, and what is no ball of this pattern.
    fn pictures(&self, pattern: &Pattern) -> Outcome<Vec<Picture>> {
        let any = SynthConfig::default();
        let of = |px: [f64; 2]| SynthConfig {
            ball_px: Some(px),
            ..any.clone()
        };
        let whole = SynthConfig {
            image_px: Some([480, 360]),
            ..of([24.0, 140.0])
        };
        let (n, seed) = (self.frames, self.seed);
        let sets = [
            (any.clone(), n),
            (of([12.0, 24.0]), n / 4),
            (of([120.0, 220.0]), n / 4),
            (whole, n / 2),
        ];
        let mut pictures = Vec::new();
        for (s, (config, count)) in sets.iter().enumerate() {
            let drawn: Result<Vec<Picture>, String> = (0..*count)
                .into_par_iter()
                .map(|k| {
                    let frame = independent_frame(pattern, config, seed + s as u64, k);
                    let frame = frame.map_err(|e| e.to_string())?;
                    Ok(Picture {
                        truth: Some(frame.truth.orientation()),
                        image: frame.image,
                    })
                })
                .collect();
            pictures.extend(drawn?);
        }
        let kinds: Vec<SynthKind> = SynthKind::ALL.into_iter().filter(|k| !k.has_pattern()).collect();
        let others: Result<Vec<Picture>, String> = (0..n / 2)
            .into_par_iter()
            .map(|k| {
                use rand::SeedableRng;
                let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed + 9 + k as u64);
                let image = match k % 3 {
                    0 => {
                        let other = random_pattern(20, 0.25, &mut rng).map_err(|e| e.to_string())?;
                        independent_frame(&other, &any, seed + 10, k)
                    }
                    _ => {
                        let kind = kinds[k % kinds.len()];
                        independent_frame(pattern, &SynthConfig { kind, ..any.clone() }, seed + 11, k)
                    }
                };
                let image = image.map_err(|e| e.to_string())?.image;
                Ok(Picture { image, truth: None })
            })
            .collect();
        pictures.extend(others?);
        Ok(pictures)
    }

    fn show(&self, name: &str, factor: f64, pattern: &Pattern, pictures: &[Picture]) -> Outcome {
        let estimator = estimator(pattern)?;
        let begun = ProcessTime::now();
        let judged: Vec<(usize, usize, usize, f64)> = pictures
            .par_iter()
            .map_init(
                || estimator.workspace(),
                |ws, picture| {
                    let found = alone(&estimator, &picture.image, ws);
                    let pose = found.pose();
                    match (&picture.truth, pose) {
                        (None, pose) => (0, 0, usize::from(pose.is_some()), 0.0),
                        (Some(_), None) => (0, 0, 0, 0.0),
                        (Some(truth), Some(pose)) => {
                            let off = truth.angle_to(&pose.rotation).to_degrees();
                            match FrameOutcome::of(&found, truth).is_right() {
                                true => (1, 0, 0, off),
                                false => (0, 1, 0, 0.0),
                            }
                        }
                    }
                },
            )
            .collect();
        let sum = judged.iter().fold((0, 0, 0, 0.0), |a, b| {
            (a.0 + b.0, a.1 + b.1, a.2 + b.2, a.3 + b.3)
        });
        let cpu = begun.elapsed().as_secs_f64();
        println!(
            "{name},{factor},{},{},{},{:.3},{},{cpu:.2}",
            sum.0, sum.1, sum.2, sum.3, pictures.len()
        );
        Ok(())
    }
}
