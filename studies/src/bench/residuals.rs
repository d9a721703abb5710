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

use std::path::PathBuf;

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;
use spindoe::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::vision::{DetectorName, Estimator, EstimatorConfig, FrameEstimate};
use spindoe_studies::frames::{DOTS20, alone, each, good_conditions};
use spindoe_studies::pictures::pictures;
use spindoe_studies::score::{median, ratio, share};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

/// Standard deviations of the placement, degrees, with which the frames are estimated and judged.
const STATED_DEG: [f64; 3] = [0.05, 1.2, 2.0];

/// A frame's sum of squares, and its degrees of freedom.
type Squares = Option<[f64; 2]>;

fn squares(estimator: &Estimator, found: &FrameEstimate, stated_deg: f64) -> Squares {
    let sigma_rad = stated_deg.to_radians();
    found.pose()?;
    let circle = found.circle?;
    let expected = estimator.expected_dots(found);
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

/// An estimator for each of [`STATED_DEG`].
fn estimators(pattern: &Pattern) -> spindoe::Result<[Estimator; 3]> {
    let detector = DetectorName::Cnn.build()?;
    let estimator = |stated_deg: f64| {
        let config = EstimatorConfig {
            placement_sigma_rad: stated_deg.to_radians(),
            ..EstimatorConfig::default()
        };
        Estimator::new(pattern, config, detector.clone())
    };
    let [a, b, c] = STATED_DEG.map(estimator);
    Ok([a?, b?, c?])
}

/// Prints the lines of some frames, one for each of [`STATED_DEG`].
fn lines(table: &Table, name: &str, frames: &[[Squares; 3]]) {
    for (k, stated_deg) in STATED_DEG.into_iter().enumerate() {
        let found: Vec<[f64; 2]> = frames.iter().filter_map(|f| f[k]).collect();
        row!(
            table; name, stated_deg, share(frames, |f| f[k].is_some()),
            figure(ratio(&found).0, 2, ""),
            figure(median(&found, |f| f[0] / f[1].max(1.0)), 2, "")
        );
    }
}

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
    pub fn run(&self) -> Outcome {
        let (frames, seed, set) = (self.frames, self.seed, good_conditions());
        let own = estimators(&Pattern::read_csv(DOTS20.as_ref())?)?;
        println!("{frames} frames a line, {}, seed {seed}", set.name);
        let table = Table::new([
            "frames",
            "placement stated, deg",
            "with a pose",
            "reduced chi-square",
            "of the median frame",
        ]);
        let all = |estimators: &[Estimator; 3], found: [FrameEstimate; 3]| {
            std::array::from_fn(|k| squares(&estimators[k], &found[k], STATED_DEG[k]))
        };
        for drawn_deg in [0.0, 1.0, 2.0f64] {
            let config = SynthConfig {
                placement_sigma_rad: [drawn_deg.to_radians(); 2],
                ..set.config.clone()
            };
            let found = each(&own, &config, seed, frames, |_, found| all(&own, found))?;
            lines(&table, &format!("drawn to {drawn_deg} deg"), &found);
        }
        if let (Some(folder), Some(pattern)) = (&self.folder, &self.real_pattern) {
            let real = estimators(&Pattern::read_csv(pattern)?)?;
            let images = pictures(folder)?;
            let found = images.par_iter().map(|image| {
                let found = real.each_ref().map(|e| alone(e, image, &mut e.workspace()));
                all(&real, found)
            });
            lines(
                &table,
                &folder.display().to_string(),
                &found.collect::<Vec<_>>(),
            );
        }
        Ok(())
    }
}
