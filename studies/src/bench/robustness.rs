//! What do worse images cost? Frames are degraded in known ways and estimated, each alone.
//!
//! Given a folder of frames and a pattern, the reference of a frame is its pose before it is
//! degraded; without, synthetic frames in good conditions are used, with their truth. A pose is
//! correct within 20 degrees.
//!
//!     cargo run --release -p spindoe-studies -- robustness --help
//!         [--count N] [--seed N] [--outline edges|net]

use std::error::Error;
use std::path::PathBuf;

use image::ImageEncoder;
use image::codecs::jpeg::JpegEncoder;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use spindoe::geometry::Rotation;
use spindoe::image::RgbImage;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::independent_frame;
use spindoe::validate::Proportion;
use spindoe::vision::estimator::OutlineMethod;
use spindoe::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};

const FAILURE_DEG: f64 = 20.0;

/// A way to spoil an image.
#[derive(Clone, Copy, Debug)]
enum Degradation {
    None,
    Scale(f64),
    Jpeg(u8),
    /// Standard deviation, of 255.
    Noise(f32),
    Gamma(f32),
    /// Share of the image's width that a gray bar hides.
    Occluded(f64),
    /// Share of the ball's diameter beyond the image's left edge.
    Cut(f64),
    /// Bright and dark discs in the corners.
    Clutter,
    /// Width of a horizontal smear, pixels.
    Blur(usize),
    Quarter,
    Half,
    /// Bright surroundings: the background is lifted to this value.
    Bright(f32),
}

const ALL: [Degradation; 18] = [
    Degradation::None,
    Degradation::Scale(0.5),
    Degradation::Scale(2.0),
    Degradation::Jpeg(30),
    Degradation::Noise(8.0),
    Degradation::Noise(16.0),
    Degradation::Gamma(0.5),
    Degradation::Gamma(2.0),
    Degradation::Occluded(0.2),
    Degradation::Cut(0.25),
    Degradation::Clutter,
    Degradation::Blur(5),
    Degradation::Blur(9),
    Degradation::Quarter,
    Degradation::Half,
    Degradation::Bright(0.1),
    Degradation::Bright(0.25),
    Degradation::Bright(0.5),
];

type Color = [f32; 3];

fn from_fn(
    width: usize,
    height: usize,
    value: impl Fn(usize, usize) -> Color,
) -> spindoe::Result<RgbImage> {
    let values = (0..width * height).map(|i| value(i % width, i / width));
    RgbImage::new(width, height, values.collect())
}

fn jpeg(image: &RgbImage, quality: u8) -> Result<RgbImage, Box<dyn Error + Send + Sync>> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality).write_image(
        &image.to_bytes(),
        image.width() as u32,
        image.height() as u32,
        image::ExtendedColorType::Rgb8,
    )?;
    Ok(RgbImage::decode("memory.jpg".as_ref(), &bytes)?)
}

/// The degraded image, and the turn of the camera frame (counterclockwise as seen, radians).
fn degrade(
    image: &RgbImage,
    how: Degradation,
    rng: &mut ChaCha8Rng,
) -> Result<(RgbImage, f64), Box<dyn Error + Send + Sync>> {
    let (width, height) = (image.width(), image.height());
    let at = |u: usize, v: usize| image.values()[v * width + u];
    let each = |f: &mut dyn FnMut(f32) -> f32| {
        let values = image.values().iter().map(|c| c.map(&mut *f)).collect();
        RgbImage::new(width, height, values)
    };
    let turned = |u: usize, v: usize| at(width - 1 - v, u);
    Ok(match how {
        Degradation::None => (image.clone(), 0.0),
        Degradation::Scale(s) => {
            let side = |n: usize| ((n as f64 * s).round() as usize).max(1);
            (image.resized(side(width), side(height))?, 0.0)
        }
        Degradation::Jpeg(quality) => (jpeg(image, quality)?, 0.0),
        Degradation::Noise(sd) => {
            let mut noisy = |x: f32| {
                let e: f32 = rng.sample(StandardNormal);
                (x + sd / 255.0 * e).clamp(0.0, 1.0)
            };
            (each(&mut noisy)?, 0.0)
        }
        Degradation::Gamma(gamma) => (each(&mut |x| x.max(0.0).powf(gamma))?, 0.0),
        Degradation::Occluded(share) => {
            let edge = (share * width as f64) as usize;
            let made = from_fn(width, height, |u, v| {
                if u < edge {
                    [0.45, 0.35, 0.3]
                } else {
                    at(u, v)
                }
            });
            (made?, 0.0)
        }
        Degradation::Cut(share) => {
            let edge = ((share + 0.05) * width as f64) as usize;
            (from_fn(width - edge, height, |u, v| at(u + edge, v))?, 0.0)
        }
        Degradation::Clutter => {
            let radius = 0.18 * width as f64;
            let made = from_fn(width, height, |u, v| {
                let corner = |x: usize, n: usize| (x as f64).min((n - 1 - x) as f64);
                let far = corner(u, width).hypot(corner(v, height)) > radius;
                let shade = if (u < width / 2) == (v < height / 2) {
                    0.9
                } else {
                    0.4
                };
                if far {
                    at(u, v)
                } else {
                    [shade, shade, 0.8 * shade]
                }
            });
            (made?, 0.0)
        }
        Degradation::Blur(n) => {
            let made = from_fn(width, height, |u, v| {
                let mut sum = [0.0; 3];
                for k in 0..n {
                    let column = (u + k).saturating_sub(n / 2).min(width - 1);
                    let color = at(column, v);
                    (0..3).for_each(|c| sum[c] += color[c] / n as f32);
                }
                sum
            });
            (made?, 0.0)
        }
        // Counterclockwise by a quarter: the old last column is the first row.
        Degradation::Quarter => (from_fn(height, width, turned)?, std::f64::consts::FRAC_PI_2),
        Degradation::Half => {
            let made = from_fn(width, height, |u, v| at(width - 1 - u, height - 1 - v));
            (made?, std::f64::consts::PI)
        }
        Degradation::Bright(level) => (each(&mut |x| level + (1.0 - level) * x)?, 0.0),
    })
}

/// An image with its orientation, camera frame (or view frame, for synthetic ones).
struct Item {
    image: RgbImage,
    rotation: Rotation,
}

fn estimate(
    estimator: &Estimator<spindoe::vision::NamedDetector>,
    image: &RgbImage,
) -> Option<Rotation> {
    let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
    estimator.estimate(
        image,
        &Prior::default(),
        &Budget::default(),
        &mut ws,
        &mut out,
    );
    out.pose().map(|p| p.rotation)
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Folder of frames to degrade instead of synthetic ones.
    #[arg(long)]
    folder: Option<PathBuf>,
    /// Pattern of the ball.
    #[arg(long, default_value = "designs/dots20/pattern.csv")]
    pattern: PathBuf,
    /// Synthetic frames.
    #[arg(long, default_value_t = 150)]
    frames: usize,
    /// Seed of the frames.
    #[arg(long, default_value_t = 5)]
    seed: u64,
    /// How outlines are proposed.
    #[arg(long, default_value_t = OutlineMethod::default())]
    outline: OutlineMethod,
}

impl Args {
    /// Measures and prints.
    ///
    /// # Errors
    /// What hinders the measurement.
    pub fn run(&self) -> Result<(), Box<dyn Error + Send + Sync>> {
        let (folder, path) = (&self.folder, &self.pattern);
        let (count, seed, outline) = (self.frames, self.seed, self.outline);
        let pattern = Pattern::read_csv(path)?;
        let config = EstimatorConfig {
            outline,
            ..EstimatorConfig::default()
        };
        let estimator = Estimator::new(&pattern, config, DetectorName::Cnn.build()?)?;
        let items: Vec<Item> = match &folder {
            Some(folder) => {
                let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)?
                    .filter_map(|e| Some(e.ok()?.path()))
                    .filter(|p| p.extension().is_some_and(|e| e == "png"))
                    .collect();
                paths.sort();
                let read = |p: &PathBuf| -> spindoe::Result<Option<Item>> {
                    let image = RgbImage::read(p)?;
                    let rotation = estimate(&estimator, &image);
                    Ok(rotation.map(|rotation| Item { image, rotation }))
                };
                let all: spindoe::Result<Vec<_>> = paths.par_iter().map(read).collect();
                println!("{} frames of {}", paths.len(), folder.display());
                all?.into_iter().flatten().collect()
            }
            None => {
                let made = |k: usize| -> spindoe::Result<Item> {
                    let frame = independent_frame(&pattern, &SynthConfig::good(), seed, k)?;
                    let [w, x, y, z] = frame.truth.quaternion_wxyz;
                    let rotation = Rotation::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
                    Ok(Item {
                        image: frame.image,
                        rotation,
                    })
                };
                let all: spindoe::Result<Vec<Item>> =
                    (0..count).into_par_iter().map(made).collect();
                println!("{count} synthetic frames, good conditions, seed {seed}");
                all?
            }
        };
        println!(
            "\n| degraded by | correct | wrong | rejected | median error |\n|---|---|---|---|---|"
        );
        for how in ALL {
            let errors: Result<Vec<Option<f64>>, _> = items
                .par_iter()
                .enumerate()
                .map(|(k, item)| {
                    let mut rng = ChaCha8Rng::seed_from_u64(seed);
                    rng.set_stream(k as u64);
                    let (image, turn) = degrade(&item.image, how, &mut rng)?;
                    let turn = Rotation::from_scaled_axis(spindoe::geometry::Vec3::z() * turn);
                    let found = estimate(&estimator, &image);
                    Ok::<_, Box<dyn Error + Send + Sync>>(
                        found.map(|r| r.angle_to(&(turn * item.rotation)).to_degrees()),
                    )
                })
                .collect();
            let errors = errors?;
            let n = errors.len() as u64;
            let mut correct: Vec<f64> = errors
                .iter()
                .flatten()
                .copied()
                .filter(|e| *e < FAILURE_DEG)
                .collect();
            correct.sort_by(f64::total_cmp);
            let answered = errors.iter().flatten().count();
            let share = |k: usize| Proportion::new(k as u64, n);
            println!(
                "| {how:?} | {} | {} | {} | {:.2} deg |",
                share(correct.len()),
                share(answered - correct.len()),
                share(errors.len() - answered),
                correct.get(correct.len() / 2).copied().unwrap_or(f64::NAN)
            );
        }
        Ok(())
    }
}
