//! How near orientations come to what the pixels hold. The table of docs/measurements/detector.md comes from here, and with
//! `--picture docs/limit.png` the picture of the README.
//!
//! Balls with the dots of `dots20` drawn exactly, no logo, a blur of 0.85 px in all, no noise but white noise of a thirtieth of
//! the dots' contrast. The limit (root mean square) for `N` visible dots of the radius `a` px, on a ball of the radius `R` px, is
//! `2.74 s / (R sqrt N)` where the projection is known and `5.05 s / (R sqrt N)` where center and radius are not, with a dot's error
//! per axis `s = (noise / contrast) sqrt(2 sqrt(pi) blur / (pi a))`: the Fisher information of the pixels.

use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use spindoe::Pattern;
use spindoe::geometry::Rotation;
use spindoe::image::GrayImage;
use spindoe::plot::{LineSeries, ValuePlot, ValuePoint, ValueSeries, value_curves};
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{FrameTruth, SynthFrame, independent_frame};
use spindoe::vision::frame::CameraModel;
use spindoe::vision::{
    BallCircle, Budget, Camera, DetectorName, DotDetector, Estimator, EstimatorConfig,
    FrameEstimate, OutlinePrior, Prior,
};
use spindoe_studies::frames::DOTS20;
use spindoe_studies::score::{mean, median, share};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

/// The ball's diameter over the crop's side.
const FILL: f64 = 0.75;
/// The lens' blur, and with a pixel's own, pixels.
const BLUR_PX: [f64; 2] = [0.8, 0.85];
/// Angular radius of the dots, radians.
const DOT_RAD: f64 = 0.09;
/// Dots that are seen less face on than this do not count for the limit.
const FACING: f64 = 0.2;
/// 95 % of a chi-square distribution of three degrees of freedom lie below this.
const REGION: f64 = 7.815;

/// What is known beside the image.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Known {
    Projection,
    Camera,
    Nothing,
}

impl Known {
    const ALL: [Self; 3] = [Self::Projection, Self::Camera, Self::Nothing];

    fn named(self) -> &'static str {
        match self {
            Self::Projection => "the projection",
            Self::Camera => "the intrinsics",
            Self::Nothing => "nothing",
        }
    }
}

/// An answer.
#[derive(Debug, Clone, Copy)]
struct Answer {
    error_deg: f64,
    /// The error over the covariance that is stated.
    squared: f64,
}

/// A frame's answers, and its limits with the projection known and without, degrees.
struct Judged {
    answers: [Option<Answer>; 3],
    limits_deg: [f64; 2],
}

fn config(ball_px: f64) -> SynthConfig {
    SynthConfig {
        ball_px: Some([ball_px; 2]),
        fill: [FILL; 2],
        parallel_share: 0.0,
        dot_radius_rad: [DOT_RAD; 2],
        dot_radius_spread: [0.0; 2],
        max_dot_elongation: 0.0,
        ink_density: [1.0; 2],
        max_streaks: 0.0,
        colored_ink_share: 0.0,
        rps: [0.0; 2],
        max_shift_px: 0.0,
        clutter_share: 0.0,
        // The blur is given for a crop of 60 pixels.
        defocus_px: [BLUR_PX[0] * 60.0 * FILL / ball_px; 2],
        max_noise: 0.0,
        mosaic_share: 0.0,
        sharpen_share: 0.0,
        jpeg_share: 0.0,
        ..SynthConfig::good().unprinted().as_designed()
    }
}

/// The median contrast of the visible dots against their surroundings.
fn contrast(gray: &GrayImage, truth: &FrameTruth) -> f64 {
    let seen: Vec<_> = truth.dots.iter().filter(|d| d.facing > 0.5).collect();
    median(&seen, |dot| {
        let at = |du: f64, dv: f64| f64::from(gray.sample(dot.pixel.u + du, dot.pixel.v + dv));
        let out = 1.6 * DOT_RAD * truth.radius_px;
        let around = at(out, 0.0) + at(-out, 0.0) + at(0.0, out) + at(0.0, -out);
        0.25 * around - at(0.0, 0.0)
    })
}

/// The outline as the image shows it to who knows the intrinsics.
fn outline(truth: &FrameTruth) -> Option<BallCircle> {
    let (k, distance) = (truth.intrinsics?, truth.distance?);
    let center = truth.ball_center;
    let ray = [(center.u - k.cx) / k.fx, (center.v - k.cy) / k.fy];
    let length = (1.0 + ray[0] * ray[0] + ray[1] * ray[1]).sqrt();
    let focal = (k.fx * k.fy).sqrt() * length;
    let ball = BallCircle::new(center, focal / (distance * distance - 1.0).sqrt());
    Some(k.shown_of_ball(&ball))
}

fn answer(
    known: Known,
    pattern: &Pattern,
    detector: &DotDetector,
    gray: &GrayImage,
    truth: &FrameTruth,
) -> Outcome<Option<Answer>> {
    let camera = match (known, truth.intrinsics) {
        (Known::Nothing, _) | (_, None) => CameraModel::default(),
        (_, Some(k)) => Camera::Perspective(k).into(),
    };
    let config = EstimatorConfig {
        camera,
        ..EstimatorConfig::default()
    };
    let estimator = Estimator::new(pattern, config, detector.clone())?;
    let exact = |circle| OutlinePrior {
        sigma_px: 1e-3,
        ..OutlinePrior::given(circle)
    };
    let prior = Prior {
        outline: match known {
            Known::Projection => outline(truth).map(exact),
            _ => None,
        },
        ..Prior::default()
    };
    let mut found = FrameEstimate::default();
    let ws = &mut estimator.workspace();
    estimator.estimate(gray, &prior, &Budget::default(), ws, &mut found);
    let Some(pose) = found.pose() else {
        return Ok(None);
    };
    let expected: Rotation = match known {
        Known::Nothing => truth.orientation(),
        _ => truth.camera_orientation(),
    };
    let off = (expected * pose.rotation.inverse()).scaled_axis();
    let inverse = pose.covariance.try_inverse();
    Ok(Some(Answer {
        error_deg: off.norm().to_degrees(),
        squared: inverse.map_or(f64::NAN, |inverse| off.dot(&(inverse * off))),
    }))
}

/// The frame in gray with its noise, and the limits.
fn noisy(
    frame: &SynthFrame,
    contrast_over_noise: f64,
    rng: &mut ChaCha8Rng,
) -> (GrayImage, [f64; 2]) {
    let mut gray = frame.image.to_gray();
    let noise = contrast(&gray, &frame.truth) / contrast_over_noise;
    let values: Vec<f32> = gray
        .values()
        .iter()
        .map(|v| {
            let normal: f64 = StandardNormal.sample(rng);
            (v + (noise * normal) as f32).clamp(0.0, 1.0)
        })
        .collect();
    let width = gray.width();
    gray.fill_with(width, gray.height(), |u, v| values[v * width + u]);
    let radius = frame.truth.radius_px;
    let dots = frame.truth.dots.iter().filter(|d| d.facing > FACING);
    let spot = PI * DOT_RAD * radius;
    let sigma = (2.0 * PI.sqrt() * BLUR_PX[1] / spot).sqrt() / contrast_over_noise;
    let limit = |factor: f64| factor * sigma / (radius * (dots.clone().count() as f64).sqrt());
    (gray, [2.74, 5.05].map(|f| limit(f).to_degrees()))
}

#[derive(clap::Args)]
pub struct Args {
    /// Frames of a line.
    #[arg(long, default_value_t = 150)]
    frames: usize,
    /// Seed of the frames.
    #[arg(long, default_value_t = 32_300_001)]
    seed: u64,
    /// The dots' contrast over the noise.
    #[arg(long, default_value_t = 30.0)]
    contrast_over_noise: f64,
    /// Diameters of the balls, pixels.
    #[arg(long, value_delimiter = ',', default_values_t = [20.0, 40.0, 60.0, 120.0, 200.0])]
    ball_px: Vec<f64>,
    /// Draw the errors over the limit to this file.
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,
}

/// The median error over the limit, with the interval of a median by its order statistics.
fn over_limit(ball_px: f64, answers: &[Answer], limit_deg: f64) -> Option<ValuePoint> {
    let mut errors: Vec<f64> = answers.iter().map(|a| a.error_deg / limit_deg).collect();
    errors.sort_unstable_by(f64::total_cmp);
    let (count, half) = (errors.len() as f64, 0.98 * (errors.len() as f64).sqrt());
    let at = |rank: f64| errors.get(rank.max(0.0) as usize).or(errors.last());
    Some(ValuePoint {
        x: ball_px,
        y: median(answers, |a| a.error_deg / limit_deg),
        low: *at((0.5 * count - half).floor())?,
        high: *at((0.5 * count + half).ceil())?,
    })
}

/// Draws what [`Args::run`] prints.
fn draw(path: &Path, over: [Vec<ValuePoint>; 3], ends: [f64; 2]) -> spindoe::Result<()> {
    let series = Known::ALL.into_iter().zip(over);
    let values = series.map(|(known, points)| ValueSeries {
        name: format!("{} known", known.named()),
        points,
    });
    let plot = ValuePlot {
        title: "Orientations against the limit of the pixels".into(),
        x_label: "diameter of the ball (px)".into(),
        y_label: "median error over the limit".into(),
        values: values.collect(),
        lines: vec![LineSeries {
            name: "limit".into(),
            points: ends.map(|px| (px, 1.0)).into(),
        }],
    };
    value_curves(path, &plot)
}

impl Args {
    pub fn run(&self) -> Outcome {
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        let detector = DetectorName::Cnn.build()?;
        println!(
            "{} frames a line, contrast/noise {}, seed {}",
            self.frames, self.contrast_over_noise, self.seed
        );
        let table = Table::new([
            "ball, px",
            "known",
            "answered",
            "median error, deg",
            "limit (rms), deg",
            "over the limit",
            "median squared distance (2.37)",
            "95 % regions hold",
        ]);
        let mut over = Known::ALL.map(|_| Vec::new());
        for &ball_px in &self.ball_px {
            let config = config(ball_px);
            let one = |k: usize| -> std::result::Result<Judged, String> {
                let frame = independent_frame(&pattern, &config, self.seed, k)
                    .map_err(|e| e.to_string())?;
                let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
                rng.set_stream(k as u64);
                let (gray, limits_deg) = noisy(&frame, self.contrast_over_noise, &mut rng);
                let mut answers = [None; 3];
                for (answer_, known) in answers.iter_mut().zip(Known::ALL) {
                    *answer_ = answer(known, &pattern, &detector, &gray, &frame.truth)
                        .map_err(|e| e.to_string())?;
                }
                Ok(Judged {
                    answers,
                    limits_deg,
                })
            };
            let frames = (0..self.frames).into_par_iter().map(one);
            let frames: Vec<Judged> = frames.collect::<Result<_, _>>()?;
            for (k, known) in Known::ALL.into_iter().enumerate() {
                let answers: Vec<Answer> = frames.iter().filter_map(|f| f.answers[k]).collect();
                let limit = |f: &Judged| f.limits_deg[usize::from(known != Known::Projection)];
                let limit = mean(&frames, |f| limit(f).powi(2)).sqrt();
                let error = median(&answers, |a| a.error_deg);
                over[k].extend(over_limit(ball_px, &answers, limit));
                row!(
                    table; ball_px, known.named(), share(&frames, |f| f.answers[k].is_some()),
                    figure(error, 3, ""), figure(limit, 3, ""), figure(error / limit, 1, ""),
                    figure(median(&answers, |a| a.squared), 2, ""),
                    share(&answers, |a| a.squared < REGION)
                );
            }
        }
        if let Some(path) = &self.picture {
            let least = self.ball_px.iter().copied().fold(f64::INFINITY, f64::min);
            let largest = self.ball_px.iter().copied().fold(0.0, f64::max);
            draw(path, over, [least, largest])?;
        }
        Ok(())
    }
}
