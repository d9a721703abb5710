//! Are the named dots off by as much as their covariances state? Reduced chi-square of the dots about the
//! estimated pose. The table of docs/measurements/detector.md comes from here.
//!
//!     cargo run --release -p spindoe-studies -- residuals --help
//!
//! Synthetic frames in good conditions at 60 pixels with dots drawn exactly, and off by 1 and 2 degrees; FOLDER holds
//! frames of a real ball. Each frame alone. With the offset `e` of a named dot in the image, the detector's
//! covariance `C` and the placement's `s^2 r^2 (I - d d^T)` (`d` its place in radii from the center of a ball of `r`
//! pixels, parallel rays), a frame's value is the sum of `e^T (C + ...)^-1 e` over twice the number of dots less
//! three. The outline's and the camera's corrections, which have priors of their own, are not counted.

use std::error::Error;
use std::path::PathBuf;

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;
use spindoe::Pattern;
use spindoe::image::RgbImage;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::independent_frame;
use spindoe::vision::{
    Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, NamedDetector, Prior,
};
use spindoe_studies::pictures::pictures;

/// Standard deviations of the placement, degrees, with which the frames are estimated and judged.
const STATED_DEG: [f64; 3] = [0.05, 1.2, 2.0];

/// A frame's sum of squares, and its degrees of freedom.
fn squares(
    estimator: &Estimator<NamedDetector>,
    image: &RgbImage,
    sigma_rad: f64,
) -> Option<[f64; 2]> {
    let (mut ws, mut found) = (estimator.workspace(), FrameEstimate::default());
    estimator.estimate(
        image,
        &Prior::default(),
        &Budget::default(),
        &mut ws,
        &mut found,
    );
    found.pose()?;
    let circle = found.circle?;
    let expected = estimator.expected_dots(&found);
    let (mut sum, mut count) = (0.0, 0.0);
    for (dot, name) in found.dots.iter().zip(&found.assignment) {
        let Some(name) = name else { continue };
        let Some((_, at, _)) = expected.iter().find(|(j, _, _)| j == name) else {
            continue;
        };
        let d = Vector2::new(at.u - circle.center.u, at.v - circle.center.v) / circle.radius;
        let placed =
            (Matrix2::identity() - d * d.transpose()) * (sigma_rad * circle.radius).powi(2);
        let off = Vector2::new(dot.pixel.u - at.u, dot.pixel.v - at.v);
        sum += off.dot(&((dot.covariance + placed).try_inverse()? * off));
        count += 2.0;
    }
    Some([sum, count - 3.0])
}

/// Prints the line of some frames.
fn line(name: &str, sigma_deg: f64, found: &[[f64; 2]], frames: usize) {
    let total = found
        .iter()
        .fold([0.0; 2], |t, f| [t[0] + f[0], t[1] + f[1]]);
    let mut each: Vec<f64> = found.iter().map(|f| f[0] / f[1].max(1.0)).collect();
    each.sort_by(f64::total_cmp);
    let median = each.get(each.len() / 2).copied().unwrap_or(f64::NAN);
    println!(
        "| {name} | {sigma_deg} | {} of {frames} | {:.2} | {median:.2} |",
        found.len(),
        total[0] / total[1]
    );
}

fn estimator(
    pattern: &Pattern,
    sigma_deg: f64,
) -> Result<Estimator<NamedDetector>, Box<dyn Error>> {
    let config = EstimatorConfig {
        placement_sigma_rad: sigma_deg.to_radians(),
        ..EstimatorConfig::default()
    };
    Ok(Estimator::new(pattern, config, DetectorName::Cnn.build()?)?)
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Frames of a line.
    #[arg(long, default_value_t = 1000)]
    frames: usize,
    /// Seed of the frames.
    #[arg(long, default_value_t = 13_600_001)]
    seed: u64,
    /// Folder of frames of a real ball.
    #[arg(long, requires = "real_pattern")]
    folder: Option<PathBuf>,
    /// Pattern of the ball in the folder.
    #[arg(long, requires = "folder")]
    real_pattern: Option<PathBuf>,
}

impl Args {
    /// Measures and prints.
    ///
    /// # Errors
    /// What hinders the measurement.
    pub fn run(&self) -> Result<(), Box<dyn Error>> {
        let Args { frames, seed, .. } = *self;
        let pattern = Pattern::read_csv("designs/dots20/pattern.csv".as_ref())?;
        println!("{frames} frames a line, seed {seed}\n");
        println!(
            "| frames | placement stated, deg | with a pose | reduced chi-square | of the median frame |"
        );
        println!("|---|---|---|---|---|");
        for drawn_deg in [0.0, 1.0, 2.0f64] {
            let config = SynthConfig {
                placement_sigma_rad: [drawn_deg.to_radians(); 2],
                ..SynthConfig::good()
            };
            for sigma_deg in STATED_DEG {
                let estimator = estimator(&pattern, sigma_deg)?;
                let found: Result<Vec<Option<[f64; 2]>>, spindoe::Error> = (0..frames)
                    .into_par_iter()
                    .map(|k| {
                        let frame = independent_frame(&pattern, &config, seed, k)?;
                        Ok(squares(&estimator, &frame.image, sigma_deg.to_radians()))
                    })
                    .collect();
                let found: Vec<[f64; 2]> = found?.into_iter().flatten().collect();
                line(
                    &format!("drawn to {drawn_deg} deg"),
                    sigma_deg,
                    &found,
                    frames,
                );
            }
        }
        let [Some(folder), Some(pattern)] = [&self.folder, &self.real_pattern] else {
            return Ok(());
        };
        let pattern = Pattern::read_csv(pattern)?;
        let images = pictures(folder)?;
        for sigma_deg in STATED_DEG {
            let estimator = estimator(&pattern, sigma_deg)?;
            let found = images.iter();
            let found: Vec<[f64; 2]> = found
                .filter_map(|image| squares(&estimator, image, sigma_deg.to_radians()))
                .collect();
            line(
                &folder.display().to_string(),
                sigma_deg,
                &found,
                images.len(),
            );
        }
        Ok(())
    }
}
