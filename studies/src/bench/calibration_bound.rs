//! The calibration against the Cramér-Rao bound, its stated covariances against both, and patterns built
//! from clips alone, on exact detections with Gaussian errors. The tables of docs/measurements/calibrate.md
//! come from here.
//!
//!     cargo run --release -p spindoe-studies -- calibration-bound --help
//!
//! A ball of 30 px radius 12 radii away; detections off by 0.3 px per axis, outlines by 0.2 px; 8 % of the
//! dots are missed. The bound is that of the dots with orientations and outlines unknown (the outlines with
//! their stated error as a prior), made of numeric derivatives of the renderer's projection; it shares no
//! code with the calibration. A bias of the model and a covariance that is too small are distinguished by
//! REPEATS of the noise on one ball and one motion: the scatter of the repeats, and their mean's error.

use nalgebra::{DMatrix, Matrix2, Matrix3, SMatrix};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use spindoe::calibrate::{CalibrationConfig, calibrate, identify_frames};
use spindoe::geometry::{Rotation, Vec3, kabsch, random_direction, random_rotation, tangent_frame};
use spindoe::synth::view::View;
use spindoe::vision::frame::{CameraModel, Outline};
use spindoe::vision::{
    BallCircle, Camera, DotDetection, EstimatorConfig, FrameEstimate, Intrinsics, Pixel,
};
use spindoe::{Ball, Pattern};
use spindoe_studies::frames::DOTS20;
use spindoe_studies::score::{mean, ratio};
use spindoe_studies::table::{Table, figure, interval};
use spindoe_studies::{Outcome, row};

const RADIUS: f64 = 30.0;
const DISTANCE: f64 = 12.0;
const SIGMA_PX: f64 = 0.3;
const OUTLINE_PX: f64 = 0.2;
const MISSED: f64 = 0.08;
const TURNS: f64 = 3.0;

/// Pixels from the ball's center, for a radius of 1, of a direction.
fn unit_view() -> Outcome<View> {
    let focal = 1.0 / (1.0 / DISTANCE).asin().tan();
    let camera = Camera::Perspective(Intrinsics::pinhole(focal, focal, 0.0, 0.0));
    let circle = BallCircle::new(Pixel { u: 0.0, v: 0.0 }, 1.0);
    Ok(View::new(&camera, circle)?)
}

struct Clip {
    frames: Vec<FrameEstimate>,
    rotations: Vec<Rotation>,
    /// The dots detected in each frame, in the order of the detections.
    names: Vec<Vec<usize>>,
}

fn clip<R: Rng>(dots: &[Vec3], frames: usize, view: &View, motion: &mut R, rng: &mut R) -> Clip {
    let mut rotation = random_rotation(motion);
    let mut axis = random_direction(motion);
    let about = tangent_frame(&axis)[0] * (std::f64::consts::PI / frames as f64);
    let precession = Rotation::from_scaled_axis(about);
    let step = TURNS * std::f64::consts::TAU / frames as f64;
    let mut clip = Clip {
        frames: Vec::new(),
        rotations: Vec::new(),
        names: Vec::new(),
    };
    let center = Pixel { u: 39.5, v: 40.5 };
    let scale = RADIUS / view.outline().circle().radius;
    for _ in 0..frames {
        let mut names = Vec::new();
        let mut found = Vec::new();
        let mut normal = |sigma: f64| -> f64 {
            let x: f64 = StandardNormal.sample(rng);
            x * sigma
        };
        let outline = BallCircle::new(
            Pixel {
                u: center.u + normal(OUTLINE_PX),
                v: center.v + normal(OUTLINE_PX),
            },
            RADIUS + normal(OUTLINE_PX),
        );
        for (j, dot) in dots.iter().enumerate() {
            let at = rotation * dot;
            if view.facing(&at) > 0.15 && rng.random::<f64>() >= MISSED {
                let p = view.project(&at);
                let [a, b]: [f64; 2] = [0, 1].map(|_| StandardNormal.sample(rng));
                names.push(j);
                found.push(DotDetection {
                    pixel: Pixel {
                        u: center.u + scale * p.u + a * SIGMA_PX,
                        v: center.v + scale * p.v + b * SIGMA_PX,
                    },
                    covariance: Matrix2::identity() * SIGMA_PX.powi(2),
                    probability: 0.95,
                });
            }
        }
        let outline = Outline::given(outline, Matrix3::identity() * OUTLINE_PX.powi(2));
        clip.frames
            .push(FrameEstimate::from_detections(outline, found));
        clip.rotations.push(rotation);
        clip.names.push(names);
        rotation = Rotation::from_scaled_axis(axis * step) * rotation;
        axis = precession * axis;
    }
    clip
}

/// The bound on the sum of all dots' variances, in the gauge that aligns them best with the truth.
fn bound(dots: &[Vec3], clip: &Clip, view: &View) -> Option<f64> {
    let n = 2 * dots.len();
    let mut information = DMatrix::<f64>::zeros(n, n);
    let scale = RADIUS / view.outline().circle().radius;
    let project = |v: &Vec3| {
        let p = view.project(v);
        [scale * p.u, scale * p.v]
    };
    let h = 1e-5;
    for (rotation, names) in clip.rotations.iter().zip(&clip.names) {
        let mut own = SMatrix::<f64, 6, 6>::zeros();
        for i in 3..6 {
            own[(i, i)] = OUTLINE_PX.powi(-2);
        }
        let mut mixed = DMatrix::<f64>::zeros(6, n);
        for &j in names {
            let at = rotation * dots[j];
            let [u, v] = project(&at);
            let mut by_frame = SMatrix::<f64, 2, 6>::zeros();
            for axis in 0..3 {
                let mut turn = Vec3::zeros();
                turn[axis] = h;
                let plus = project(&(Rotation::from_scaled_axis(turn) * at));
                let minus = project(&(Rotation::from_scaled_axis(-turn) * at));
                for i in 0..2 {
                    by_frame[(i, axis)] = (plus[i] - minus[i]) / (2.0 * h);
                }
            }
            by_frame[(0, 3)] = 1.0;
            by_frame[(1, 4)] = 1.0;
            by_frame[(0, 5)] = u / RADIUS;
            by_frame[(1, 5)] = v / RADIUS;
            let mut by_dot = SMatrix::<f64, 2, 2>::zeros();
            for (k, e) in tangent_frame(&dots[j]).iter().enumerate() {
                let plus = project(&(rotation * (dots[j] + e * h).normalize()));
                let minus = project(&(rotation * (dots[j] - e * h).normalize()));
                for i in 0..2 {
                    by_dot[(i, k)] = (plus[i] - minus[i]) / (2.0 * h);
                }
            }
            let weight = SIGMA_PX.powi(-2);
            own += by_frame.transpose() * by_frame * weight;
            let cross = by_frame.transpose() * by_dot * weight;
            mixed.view_mut((0, 2 * j), (6, 2)).copy_from(&cross);
            let mut corner = information.view_mut((2 * j, 2 * j), (2, 2));
            corner += by_dot.transpose() * by_dot * weight;
        }
        let solved = own.cholesky()?.solve(&mixed);
        information -= mixed.transpose() * solved;
    }
    // The pseudo-inverse leaves out the three turns of the whole pattern: the least variance of any gauge.
    let eigen = information.symmetric_eigen();
    let mut values: Vec<f64> = eigen.eigenvalues.iter().copied().collect();
    values.sort_by(f64::total_cmp);
    Some(values[3..].iter().map(|v| 1.0 / v).sum())
}

/// What the calibration knows besides the detections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Knowledge {
    /// The camera, but no prior of motion: as the bound.
    Camera,
    /// The times, from which a smooth rotation is learned; the camera is fitted.
    Motion,
}

/// A ball's sums, and the errors of its dots.
type Judged = (Sums, Vec<Vec3>);

/// Sums over a ball's dots, rad^2.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    squared_error: f64,
    stated: f64,
    bound: f64,
    /// Mean over the dots of the squared error over the stated variance.
    normalized: f64,
    dots: usize,
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Balls.
    #[arg(long, default_value_t = 100)]
    balls: u64,
    /// Seed of the balls.
    #[arg(long, default_value_t = 20_261_122)]
    seed: u64,
    /// Frames of a clip.
    #[arg(long, default_value_t = 120)]
    frames: usize,
    /// Repeats of the noise on one ball and one motion.
    #[arg(long, default_value_t = 100)]
    repeats: u64,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let Args {
            balls,
            seed,
            frames,
            repeats,
        } = *self;
        let nominal = Pattern::read_csv(DOTS20.as_ref())?;
        println!("{balls} balls, {frames} frames, seed {seed}");
        for knowledge in [Knowledge::Camera, Knowledge::Motion] {
            let each: Result<Vec<Option<Sums>>, String> = (0..balls)
                .into_par_iter()
                .map(|k| {
                    let found = judge(&nominal, seed, k, k, frames, knowledge);
                    found.map(|f| f.map(|f| f.0)).map_err(|e| e.to_string())
                })
                .collect();
            let each: Vec<Sums> = each?.into_iter().flatten().collect();
            report(knowledge, &each);
            println!(
                "Left out, a dot at the limb only: {} balls",
                balls as usize - each.len()
            );
            scatter(&nominal, seed, repeats, frames, knowledge)?;
        }
        Ok(())
    }
}

fn report(knowledge: Knowledge, each: &[Sums]) {
    let dots = each.iter().map(|e| e.dots as f64).sum::<f64>();
    let deg = |value: fn(&Sums) -> f64| {
        let sum = each.iter().map(value).sum::<f64>();
        figure((sum / dots).sqrt().to_degrees(), 4, "deg")
    };
    // The root of the ratio of the squared errors to a limit; the balls are the sample.
    let over = |limit: fn(&Sums) -> f64| {
        let pairs: Vec<_> = each.iter().map(|e| [e.squared_error, limit(e)]).collect();
        let (square, ends) = ratio(&pairs);
        interval(square.sqrt(), ends.map(f64::sqrt), 3, "")
    };
    let table = Table::new([&format!("{knowledge:?} known"), "rms", "error over it"]);
    row!(table; "error", deg(|e| e.squared_error));
    row!(table; "stated", deg(|e| e.stated), over(|e| e.stated));
    row!(table; "bound, without motion", deg(|e| e.bound), over(|e| e.bound));
    let normalized = || each.iter().map(|e| e.normalized);
    println!(
        "\nSquared errors over stated variances: mean {:.3}, clips {:.2} to {:.2}.",
        mean(each, |e| e.normalized),
        normalized().fold(f64::INFINITY, f64::min),
        normalized().fold(0.0, f64::max)
    );
}

/// One ball and one motion under repeated noise: how far the dots scatter, and how far their means lie off.
fn scatter(
    nominal: &Pattern,
    seed: u64,
    repeats: u64,
    frames: usize,
    knowledge: Knowledge,
) -> Outcome {
    let each: Result<Vec<Option<Judged>>, String> = (0..repeats)
        .into_par_iter()
        .map(|r| judge(nominal, seed, 0, r, frames, knowledge).map_err(|e| e.to_string()))
        .collect();
    let each: Vec<Judged> = each?.into_iter().flatten().collect();
    let (n, dots) = (each.len() as f64, nominal.len());
    if each.len() < 2 {
        return Ok(());
    }
    let (mut scatter, mut bias) = (0.0, 0.0);
    for j in 0..dots {
        let mean = each.iter().map(|e| e.1[j]).sum::<Vec3>() / n;
        let off = |e: &Judged| (e.1[j] - mean).norm_squared();
        let variance = each.iter().map(off).sum::<f64>() / (n - 1.0);
        scatter += variance;
        // The mean's own scatter is no bias.
        bias += mean.norm_squared() - variance / n;
    }
    let stated = each.iter().map(|e| e.0.stated).sum::<f64>() / n;
    let rms = |sum: f64| (sum.max(0.0) / dots as f64).sqrt().to_degrees();
    println!(
        "{n} repeats of the noise on one clip: scatter {:.4} deg, stated {:.4} deg, bias {:.4} deg",
        rms(scatter),
        rms(stated),
        rms(bias)
    );
    Ok(())
}

/// The sums of ball `k` under noise `r`, and the errors of its dots; `None` where some dot is seen at the
/// limb only, whose covariance covers more than the detections' errors.
fn judge(
    nominal: &Pattern,
    seed: u64,
    k: u64,
    r: u64,
    frames: usize,
    knowledge: Knowledge,
) -> Outcome<Option<Judged>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(k);
    let mut noise = ChaCha8Rng::seed_from_u64(seed ^ 0xa5);
    noise.set_stream(r);
    let view = unit_view()?;
    let drawn: Vec<Vec3> = nominal
        .dots()
        .iter()
        .map(|dot| {
            let [e1, e2] = tangent_frame(dot);
            let [a, b]: [f64; 2] = [0, 1].map(|_| StandardNormal.sample(&mut rng));
            (dot + (e1 * a + e2 * b) * 0.035).normalize()
        })
        .collect();
    let clip = clip(&drawn, frames, &view, &mut rng, &mut noise);
    let smooth = knowledge == Knowledge::Motion;
    let mut estimator = EstimatorConfig::default();
    if knowledge == Knowledge::Camera {
        estimator.camera = CameraModel::Known(Camera::Near {
            inverse_distance: 1.0 / DISTANCE,
        });
    }
    let config = CalibrationConfig {
        estimator,
        smooth,
        // The errors of these detections are independent.
        shared_sigma_rad: 0.0,
        ..CalibrationConfig::default()
    };
    let ball = Ball::new(nominal.clone());
    let identified = identify_frames(&ball, &config.estimator, &clip.frames)?;
    let times: Vec<f64> = (0..frames).map(|k| k as f64 / 30.0).collect();
    let times = smooth.then_some(times.as_slice());
    let found = calibrate(nominal, &identified, times, &config)?.map_err(|r| r.to_string())?;
    if found.measured() != drawn.len() {
        return Ok(None);
    }
    let to: Vec<Vec3> = found.dots.iter().map(|d| d.direction).collect();
    let turn = kabsch(&drawn, &to, None)?;
    let errors: Vec<Vec3> = drawn.iter().zip(&to).map(|(a, b)| b - turn * a).collect();
    let squares = errors.iter().map(Vec3::norm_squared);
    let ratios = squares.clone().zip(&found.dots);
    let ratios = ratios.map(|(square, d)| square / d.covariance.trace());
    let sums = Sums {
        squared_error: squares.clone().sum(),
        stated: found.dots.iter().map(|d| d.covariance.trace()).sum(),
        bound: bound(&drawn, &clip, &view).ok_or("a singular bound")?,
        normalized: ratios.sum::<f64>() / drawn.len() as f64,
        dots: drawn.len(),
    };
    Ok(Some((sums, errors)))
}
