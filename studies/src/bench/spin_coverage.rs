//! Does the covariance of a spin say how well it is known? From rendered images to the spin.
//!
//! Short sequences of a ball before a camera at an unknown distance (good conditions, 5 to 80 rps, 400 frames per second) are
//! estimated: of one that stays on the optical axis, and of one that crosses a picture of 640 x 480 by some 100 to 400 pixels, up to
//! 20 deg off the axis. The squared Mahalanobis distance of each spin from the truth in the same view frame is compared with
//! chi-square with three degrees of freedom; for balls that cross also without the correction for the view frame's turn.
//!
//!     cargo run --release -p spindoe-studies -- spin-coverage --help

use std::f64::consts::TAU;
use std::path::PathBuf;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::clip::{
    NamedFrame, SequenceConfig, SequenceView, estimate_sequence, estimate_spin, orientations,
};
use spindoe::geometry::{CameraFrame, Rotation};
use spindoe::image::ImageView;
use spindoe::pattern::Pattern;
use spindoe::spin::robust::{RobustEstimator, SpinConfig};
use spindoe::spin::{Fit, SpinRejection};
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, SynthSequence};
use spindoe::vision::{BallCircle, BallView, Camera, Estimator};
use spindoe_studies::frames::{DOTS20, estimator, good_conditions};
use spindoe_studies::score::{mean, median, share};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

/// Quantiles of chi-square with three degrees of freedom (SciPy's `chi2(3).ppf`).
const QUANTILES: [(f64, f64); 4] = [(0.68, 3.506), (0.9, 6.251), (0.95, 7.815), (0.99, 11.345)];

/// What became of a sequence.
#[derive(Clone, Copy)]
struct Judged {
    distance2: f64,
    error_rad_s: f64,
    deviation_rad_s: f64,
}

/// Outcomes with the frames' weights by their covariances and by their residuals, and without the correction for the view frame's turn.
fn outcomes(
    pattern: &Pattern,
    estimator: &Estimator,
    seed: u64,
    frames: usize,
    crosses: bool,
) -> spindoe::Result<[Option<Judged>; 3]> {
    let mut config = SynthConfig {
        max_off_axis_rad: 0.0,
        rps: [5.0, 80.0],
        ..good_conditions().config
    };
    let mut timing = ClipConfig {
        fps: 400.0,
        ..ClipConfig::default()
    };
    if crosses {
        config.image_px = Some([640, 480]);
        config.ball_px = Some([60.0; 2]);
        config.max_off_axis_rad = 0.35;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (along, angle) = (rng.random_range(100.0..400.0), rng.random_range(0.0..TAU));
        timing.drift_px = Some([along * f64::cos(angle), 0.7 * along * f64::sin(angle)]);
    }
    let sequence = SynthSequence::random(pattern, &config, &timing, seed, frames)?;
    let rendered = (0..frames).map(|k| sequence.frame(k));
    let rendered = rendered.collect::<spindoe::Result<Vec<_>>>()?;
    let times: Vec<f64> = rendered.iter().filter_map(|f| f.truth.time_s).collect();
    let images: Vec<ImageView<'_>> = rendered.iter().map(|f| (&f.image).into()).collect();
    let config = SequenceConfig::default();
    let (mut estimates, _) = estimate_sequence(estimator, &config, &times, &images);
    let Some(view) = SequenceView::of_frames(estimates.iter()) else {
        return Ok([None, None, None]);
    };
    // The camera's frame, seen from where the ball is in the middle of its path.
    let truth = &rendered[0].truth;
    let seen = match truth.intrinsics {
        Some(intrinsics) => {
            let circle = BallCircle::new(view.reference, truth.radius_px);
            BallView::new(&Camera::Perspective(intrinsics), circle)?.to_camera()
        }
        None => Rotation::identity(),
    };
    let spin = seen.inverse() * sequence.spin();
    let judge = |fit: Result<Fit, SpinRejection>| {
        let fit = fit.ok()?;
        let off = fit.motion.spin - spin;
        let covariance = fit.spin_covariance?;
        Some(Judged {
            distance2: off.dot(&(covariance.try_inverse()? * off)),
            error_rad_s: off.norm(),
            deviation_rad_s: covariance.trace().sqrt(),
        })
    };
    let turned = judge(estimate_spin(&config, &times, &estimates));
    // What a reader makes of the file that lacks the covariances.
    let named = NamedFrame::of_times(&times, &estimates);
    let mut file = orientations(&named, CameraFrame::View, true);
    file.rows.iter_mut().for_each(|row| row.covariance = None);
    let settings = SpinConfig {
        shared: file.shared_error(),
        ..config.spin
    };
    let by_residuals = judge(RobustEstimator::new(settings).fit(&file.measurements()));
    for estimate in &mut estimates {
        if let Ok(pose) = &mut estimate.outcome {
            pose.distance = None;
        }
    }
    let plain = judge(estimate_spin(&config, &times, &estimates));
    Ok([turned, by_residuals, plain])
}

#[derive(clap::Args)]
pub struct Args {
    /// Sequences.
    #[arg(long, default_value_t = 200)]
    sequences: u64,
    /// Frames of a sequence.
    #[arg(long, default_value_t = 8)]
    frames: usize,
    /// Seed of the sequences.
    #[arg(long, default_value_t = 7000)]
    seed: u64,
    /// Pattern of the ball.
    #[arg(long, default_value = DOTS20)]
    pattern: PathBuf,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (count, frames, seed, path) = (self.sequences, self.frames, self.seed, &self.pattern);
        let pattern = Pattern::read_csv(path)?;
        let estimator = estimator(&pattern)?;
        println!(
            "{count} sequences of {frames} frames, seeds from {seed}, {}",
            path.display()
        );
        let headings = [
            "ball",
            "answered",
            "median",
            "mean",
            "error, rad/s",
            "deviation, rad/s",
        ];
        let within = QUANTILES.map(|(share, _)| format!("within {} %", 100.0 * share));
        let table = Table::new(headings.map(String::from).into_iter().chain(within));
        for crosses in [false, true] {
            let found: Vec<[Option<Judged>; 3]> = (0..count)
                .into_par_iter()
                .map(|k| outcomes(&pattern, &estimator, seed + k, frames, crosses))
                .collect::<spindoe::Result<_>>()?;
            let ways = match crosses {
                false => &["on the axis", "the same, weights by residuals"][..],
                true => &[
                    "crosses the picture",
                    "the same, weights by residuals",
                    "the same, not corrected",
                ],
            };
            for (k, words) in ways.iter().enumerate() {
                let answered = share(&found, |ways| ways[k].is_some());
                let judged: Vec<Judged> = found.iter().filter_map(|ways| ways[k]).collect();
                let figures = [
                    median(&judged, |o| o.distance2),
                    mean(&judged, |o| o.distance2),
                    median(&judged, |o| o.error_rad_s),
                    median(&judged, |o| o.deviation_rad_s),
                ];
                let inside = QUANTILES.map(|(_, bound)| share(&judged, |o| o.distance2 < bound));
                row!(table; *words, answered; figures.map(|x| figure(x, 2, "")); inside);
            }
        }
        Ok(())
    }
}
