//! What do worse images cost? Frames are degraded in known ways and estimated, each alone.
//!
//! Given a folder of frames and a pattern, the reference of a frame is its pose before it is
//! degraded; without, synthetic frames in good conditions are used, with their truth. A pose is
//! correct within 20 degrees.
//!
//!     cargo run --release -p spindoe-studies -- robustness --help

use std::path::PathBuf;

use image::ImageEncoder;
use image::codecs::jpeg::JpegEncoder;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use spindoe::camera::FrameOutcome;
use spindoe::geometry::{Rotation, Vec3};
use spindoe::image::RgbImage;
use spindoe::pattern::Pattern;
use spindoe::synth::dataset::independent_frame;
use spindoe::vision::frame::OutlineMethod;
use spindoe::vision::{DetectorName, Estimator, EstimatorConfig};
use spindoe_studies::frames::{DOTS20, alone, good_conditions};
use spindoe_studies::pictures::pictures;
use spindoe_studies::score::{RATES, rates};
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// A way to spoil an image.
#[derive(Clone, Copy)]
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

impl Degradation {
    fn name(self) -> String {
        match self {
            Self::None => "nothing".into(),
            Self::Scale(share) => format!("{share} times the size"),
            Self::Jpeg(quality) => format!("JPEG, quality {quality}"),
            Self::Noise(deviation) => format!("noise, deviation {deviation} of 255"),
            Self::Gamma(gamma) => format!("gamma {gamma}"),
            Self::Occluded(share) => format!("a bar over {} % of the width", 100.0 * share),
            Self::Cut(share) => format!("cut by {} %", 100.0 * share),
            Self::Clutter => "discs in the corners".into(),
            Self::Blur(width) => format!("smear of {width} px"),
            Self::Quarter => "turned by 90 deg".into(),
            Self::Half => "turned by 180 deg".into(),
            Self::Bright(level) => format!("background lifted to {level}"),
        }
    }
}

type Color = [f32; 3];

fn from_fn(
    width: usize,
    height: usize,
    value: impl Fn(usize, usize) -> Color,
) -> spindoe::Result<RgbImage> {
    let values = (0..width * height).map(|i| value(i % width, i / width));
    RgbImage::new(width, height, values.collect())
}

fn jpeg(image: &RgbImage, quality: u8) -> Outcome<RgbImage> {
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
fn degrade(image: &RgbImage, how: Degradation, rng: &mut ChaCha8Rng) -> Outcome<(RgbImage, f64)> {
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

#[derive(clap::Args)]
pub struct Args {
    /// Folder of frames to degrade instead of synthetic ones.
    #[arg(long)]
    folder: Option<PathBuf>,
    /// Pattern of the ball.
    #[arg(long, default_value = DOTS20)]
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
    pub fn run(&self) -> Outcome {
        let (count, seed) = (self.frames, self.seed);
        let pattern = Pattern::read_csv(&self.pattern)?;
        let config = EstimatorConfig {
            outline: self.outline,
            ..EstimatorConfig::default()
        };
        let estimator = Estimator::new(&pattern, config, DetectorName::Cnn.build()?)?;
        let found = |image: &RgbImage| {
            let found = alone(&estimator, image, &mut estimator.workspace());
            found.pose().map(|p| p.rotation)
        };
        let items: Vec<Item> = match &self.folder {
            Some(folder) => {
                let images = pictures(folder)?;
                println!("{} frames of {}", images.len(), folder.display());
                let images = images.into_par_iter();
                let items = images
                    .filter_map(|image| found(&image).map(|rotation| Item { image, rotation }));
                items.collect()
            }
            None => {
                let set = good_conditions();
                println!("{count} synthetic frames, {}, seed {seed}", set.name);
                let made = |k: usize| {
                    let frame = independent_frame(&pattern, &set.config, seed, k)?;
                    Ok(Item {
                        rotation: frame.truth.orientation(),
                        image: frame.image,
                    })
                };
                let items = (0..count).into_par_iter().map(made);
                items.collect::<spindoe::Result<_>>()?
            }
        };
        let table = Table::new(["degraded by"].into_iter().chain(RATES));
        for how in ALL {
            let one = |(k, item): (usize, &Item)| -> Outcome<FrameOutcome> {
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                rng.set_stream(k as u64);
                let (image, turn) = degrade(&item.image, how, &mut rng)?;
                let truth = Rotation::from_scaled_axis(Vec3::z() * turn) * item.rotation;
                Ok(match found(&image) {
                    Some(rotation) => FrameOutcome::Answered {
                        error_rad: rotation.angle_to(&truth),
                    },
                    None => FrameOutcome::Unanswered,
                })
            };
            let outcomes: Outcome<Vec<_>> = items.par_iter().enumerate().map(one).collect();
            row!(table; how.name(); rates(&outcomes?));
        }
        Ok(())
    }
}
