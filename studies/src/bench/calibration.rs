//! What a calibration is worth on synthetic clips: the drawn dots' error, dots that are missing, and the
//! orientation of fresh frames. The tables of docs/measurements/calibrate.md come from here.
//!
//!     cargo run --release -p spindoe-studies -- calibration --help
//!
//! DOTS_CSV gets a line for each dot of the pattern: what became of it.
//!
//! A ball has the dots of designs/dots20, each moved by a normal error per tangent axis; two in three
//! balls lack a dot, one in three lacks two. It turns three times before the camera while its axis
//! turns by half a turn, 30 frames a second, in good conditions (`SynthConfig::good`: logos, stains, seams,
//! cameras from 6 ball radii). Dots on a logo or a seam are counted apart: what is seen there need not be
//! the dot.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::fmt::Write;
use std::path::PathBuf;

use rand::seq::index::sample;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use spindoe::Pattern;
use spindoe::calibrate::{CalibratedDot, Calibration, CalibrationConfig, DotState, calibrate};
use spindoe::geometry::{
    Rotation, Vec3, angle_between, kabsch, random_direction, random_rotation, tangent_frame,
};
use spindoe::synth::surface::{LogoPrint, Surface};
use spindoe::synth::{Rendering, Scene, SynthConfig};
use spindoe::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};
use spindoe_studies::frames::{DOTS20, estimator};
use spindoe_studies::score::{mean, median, ratio, share};
use spindoe_studies::table::{Table, figure, interval};
use spindoe_studies::{Outcome, row};

/// Fresh frames of each ball.
const FRESH: usize = 20;
/// Frames per second of the clip, and its exposure.
const FPS: f64 = 30.0;
const EXPOSURE_S: f64 = 1e-3;
/// Revolutions of the ball in a clip.
const TURNS: f64 = 3.0;
/// A dot seen in fewer of the views that face it is hidden, by a logo or the limb.
const HIDDEN: f64 = 0.3;
/// A missing dot whose place faces the camera in fewer frames cannot be known to be missing.
const IN_VIEW: usize = 10;
/// Cosine from which a dot faces the camera.
const FACING: f64 = 0.5;
/// A dot with more of a logo's ink within one and a half of its radii lies on print.
const PRINT: f64 = 0.02;
/// Placement error given to estimators that know the dots, radians.
const KNOWN_SIGMA_RAD: f64 = 0.005;

/// A ball, as drawn.
struct Ball {
    drawn: Pattern,
    /// For each drawn dot its number in the nominal pattern.
    numbers: Vec<usize>,
    missing: Vec<usize>,
    scene: Scene,
}

/// A measured dot.
struct Dot {
    /// rad^2.
    squared_error: f64,
    predicted: f64,
    /// Whether it is drawn on a logo or a seam, or beside them.
    on_print: bool,
}

/// What is said of a dot that is missing.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Missing {
    Named,
    Doubtful,
    Taken,
    /// Its place hardly faced the camera.
    OutOfView,
}

struct Measured {
    /// Lines of [`dots_csv`] without the ball's number.
    lines: Vec<String>,
    dots: Vec<Dot>,
    missing: Vec<Missing>,
    false_alarms: usize,
    /// Drawn dots that are doubtful.
    doubtful: usize,
    noise_scale: f64,
    marks: usize,
    /// Orientation errors of fresh frames: nominal, calibrated, true pattern.
    errors: [Vec<f64>; 3],
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Balls.
    #[arg(long, default_value_t = 100)]
    balls: u64,
    /// Seed of the balls.
    #[arg(long, default_value_t = 20_261_121)]
    seed: u64,
    /// Radius of the balls, pixels.
    #[arg(long, default_value_t = 60.0)]
    px: f64,
    /// Frames of a clip.
    #[arg(long, default_value_t = 120)]
    frames: usize,
    /// Standard deviation of a drawn dot's place per tangent axis, degrees.
    #[arg(long, default_value_t = 2.0)]
    placement_deg: f64,
    /// File that gets a line for each dot of each ball: what became of it.
    #[arg(long)]
    dots_csv: Option<PathBuf>,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (balls, seed, px, frames) = (self.balls, self.seed, self.px, self.frames);
        let sigma = self.placement_deg.to_radians();
        let nominal = Pattern::read_csv(DOTS20.as_ref())?;
        let estimator = estimator(&nominal)?;
        println!(
            "{balls} balls of {px} px, {frames} frames, placement error {:.1} deg per axis, seed {seed}",
            sigma.to_degrees()
        );
        let outcomes: Result<Vec<Option<Measured>>, String> = (0..balls)
            .into_par_iter()
            .map(|k| {
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                rng.set_stream(k);
                one(&nominal, &estimator, px, frames, sigma, &mut rng).map_err(|e| e.to_string())
            })
            .collect();
        let outcomes = outcomes?;
        if let Some(path) = &self.dots_csv {
            std::fs::write(path, dots_csv(&outcomes))?;
        }
        report(&outcomes);
        Ok(())
    }
}

/// A line for each dot of each calibrated ball.
fn dots_csv(outcomes: &[Option<Measured>]) -> String {
    let mut text = "ball,dot,drawn,state,error_deg,stated_deg,offset_deg,likeness,views,expected,facing,seen,on_print\n"
        .to_string();
    for (ball, outcome) in outcomes.iter().enumerate() {
        for line in outcome.iter().flat_map(|m| &m.lines) {
            let _ = writeln!(text, "{ball},{line}");
        }
    }
    text
}

fn ball<R: Rng>(nominal: &Pattern, px: f64, sigma: f64, rng: &mut R) -> Outcome<Ball> {
    let count = rng.random_range(0..3);
    let missing = sample(rng, nominal.len(), count).into_vec();
    let numbers: Vec<usize> = (0..nominal.len())
        .filter(|j| !missing.contains(j))
        .collect();
    let drawn = numbers.iter().map(|&j| {
        let dot = nominal.dots()[j];
        let [e1, e2] = tangent_frame(&dot);
        let [a, b]: [f64; 2] = [0, 1].map(|_| StandardNormal.sample(rng));
        (dot + e1 * (a * sigma) + e2 * (b * sigma)).normalize()
    });
    let drawn = Pattern::new(drawn.collect())?;
    let config = SynthConfig {
        ball_px: Some([px; 2]),
        ..SynthConfig::good().as_designed()
    };
    let scene = Scene::random(&drawn, &config, rng)?;
    Ok(Ball {
        drawn,
        numbers,
        missing,
        scene,
    })
}

/// A frame of the ball, turned by hand.
fn frame<R: Rng>(ball: &Ball, rotation: Rotation, spin: Vec3, rng: &mut R) -> Outcome<Rendering> {
    let mut scene = ball.scene.clone();
    scene.rotation = rotation;
    scene.spin = spin;
    scene.exposure_s = EXPOSURE_S;
    scene.shift_px = [0.0; 2];
    scene.noise_seed = rng.random();
    Ok(scene.render()?)
}

fn one(
    nominal: &Pattern,
    estimator: &Estimator,
    px: f64,
    frames: usize,
    sigma: f64,
    rng: &mut ChaCha8Rng,
) -> Outcome<Option<Measured>> {
    let ball = ball(nominal, px, sigma, rng)?;
    let clip = filmed(nominal, estimator, &ball, frames, rng)?;
    let times: Vec<f64> = (0..frames).map(|k| k as f64 / FPS).collect();
    let config = CalibrationConfig::default();
    let calibration = match calibrate(nominal, &clip.estimates, Some(&times), &config)? {
        Ok(calibration) => calibration,
        Err(rejection) => {
            eprintln!("rejected: {rejection}");
            return Ok(None);
        }
    };
    let on_ball = |j: &&usize| calibration.dots[**j].state == DotState::Measured;
    let (mut from, mut to) = (Vec::new(), Vec::new());
    for (drawn, j) in ball.drawn.dots().iter().zip(&ball.numbers) {
        if on_ball(&j) {
            from.push(*drawn);
            to.push(calibration.dots[*j].direction);
        }
    }
    let turn = kabsch(&from, &to, None)?;
    let numbers = ball.numbers.iter().filter(on_ball);
    let dots = numbers.zip(from.iter().zip(&to)).map(|(&j, (a, b))| Dot {
        squared_error: angle_between(&(turn * a), b).powi(2),
        predicted: calibration.dots[j].covariance.trace(),
        on_print: on_print(&ball.scene.surface, a),
    });
    let is_doubtful = |j: &&usize| calibration.dots[**j].state == DotState::Doubtful;
    let errors = fresh(nominal, estimator, &ball, &calibration, turn, rng)?;
    Ok(Some(Measured {
        lines: clip.lines(&ball, &calibration, &turn),
        dots: dots.collect(),
        missing: clip.missing(&ball, &calibration),
        false_alarms: clip.false_alarms(&ball, &calibration),
        noise_scale: calibration.noise_scale,
        doubtful: ball.numbers.iter().filter(is_doubtful).count(),
        marks: calibration.marks.len(),
        errors,
    }))
}

/// A clip of a ball, estimated.
struct Filmed {
    estimates: Vec<FrameEstimate>,
    /// In how many frames each drawn dot faces the camera, and in how many of these it is seen.
    views: Vec<[usize; 2]>,
    /// In how many frames each nominal dot is in view.
    shown: Vec<usize>,
}

fn filmed(
    nominal: &Pattern,
    estimator: &Estimator,
    ball: &Ball,
    frames: usize,
    rng: &mut ChaCha8Rng,
) -> Outcome<Filmed> {
    let mut workspace = estimator.workspace();
    let mut rotation = random_rotation(rng);
    let mut axis = random_direction(rng);
    let about = tangent_frame(&axis)[0];
    let step = TURNS * std::f64::consts::TAU / frames as f64;
    let precession = Rotation::from_scaled_axis(about * (std::f64::consts::PI / frames as f64));
    let mut clip = Filmed {
        estimates: Vec::with_capacity(frames),
        views: vec![[0usize; 2]; ball.drawn.len()],
        shown: vec![0usize; nominal.len()],
    };
    for _ in 0..frames {
        let seen = frame(ball, rotation, axis * (step * FPS), rng)?;
        for dot in seen.dots.iter().filter(|dot| dot.facing > 0.3) {
            clip.views[dot.index][0] += 1;
            clip.views[dot.index][1] += usize::from(dot.is_visible());
        }
        for (shown, dot) in clip.shown.iter_mut().zip(nominal.dots()) {
            *shown += usize::from((seen.rotation * dot).z > FACING);
        }
        let (mut estimate, prior) = (FrameEstimate::default(), Prior::default());
        let budget = Budget::default();
        estimator.estimate(&seen.image, &prior, &budget, &mut workspace, &mut estimate);
        clip.estimates.push(estimate);
        rotation = Rotation::from_scaled_axis(axis * step) * rotation;
        axis = precession * axis;
    }
    Ok(clip)
}

impl Filmed {
    /// What is said of the dots that are not on the ball.
    fn missing(&self, ball: &Ball, calibration: &Calibration) -> Vec<Missing> {
        let said = |&j: &usize| match calibration.dots[j].state {
            DotState::Missing => Missing::Named,
            _ if self.shown[j] < IN_VIEW => Missing::OutOfView,
            DotState::Measured => Missing::Taken,
            _ => Missing::Doubtful,
        };
        ball.missing.iter().map(said).collect()
    }

    /// Dots on the ball, not hidden, that are called missing.
    fn false_alarms(&self, ball: &Ball, calibration: &Calibration) -> usize {
        let seen = |j: usize| {
            let k = ball.numbers.iter().position(|n| *n == j);
            let [facing, seen] = k.map_or([0; 2], |k| self.views[k]);
            seen as f64 / facing.max(1) as f64
        };
        let hidden = |j: usize| ball.numbers.contains(&j) && seen(j) < HIDDEN;
        let wrong = |(j, d): &(usize, &CalibratedDot)| {
            d.state == DotState::Missing && !ball.missing.contains(j) && !hidden(*j)
        };
        calibration.dots.iter().enumerate().filter(wrong).count()
    }

    /// A line of numbers for each dot.
    fn lines(&self, ball: &Ball, calibration: &Calibration, turn: &Rotation) -> Vec<String> {
        let line = |(j, dot): (usize, &CalibratedDot)| {
            let k = ball.numbers.iter().position(|n| *n == j);
            let at = k.map(|k| ball.drawn.dots()[k]);
            let [facing, seen] = k.map_or([0; 2], |k| self.views[k]);
            format!(
                "{j},{},{},{:.4},{:.4},{:.4},{:.3},{},{:.1},{facing},{seen},{}",
                u8::from(k.is_some()),
                dot.state.as_str(),
                at.map_or(f64::NAN, |at| angle_between(&(turn * at), &dot.direction))
                    .to_degrees(),
                dot.covariance.trace().sqrt().to_degrees(),
                dot.offset_rad().to_degrees(),
                dot.likeness,
                dot.views,
                dot.expected_views,
                u8::from(at.is_some_and(|at| on_print(&ball.scene.surface, &at)))
            )
        };
        calibration.dots.iter().enumerate().map(line).collect()
    }
}

/// Whether a dot at this place is drawn on a logo or a seam, or within half its radius of them.
fn on_print(surface: &Surface, at: &Vec3) -> bool {
    let [e1, e2] = tangent_frame(at);
    let spots = surface.dots.iter().flatten();
    let radius = spots.map(|s| s.radius).fold(0.0, f64::max);
    let seam = surface.seams.iter().any(|seam| {
        let off = (angle_between(&seam.axis, at) - FRAC_PI_2).abs();
        off < seam.half_width + 1.5 * radius
    });
    let on_ring = |k: usize, share: f64| {
        let (s, c) = (TAU * k as f64 / 24.0).sin_cos();
        (at + (e1 * c + e2 * s) * (share * radius)).normalize()
    };
    let ink = |mark: &LogoPrint| {
        let rings = [0.25, 0.5, 0.75, 1.0, 1.25, 1.5];
        let of_ring = |share: f64| {
            let points = (0..24).map(|k| f64::from(mark.ink(&on_ring(k, share))));
            share * points.sum::<f64>() / 24.0
        };
        rings.iter().map(|share| of_ring(*share)).sum::<f64>() / rings.iter().sum::<f64>()
    };
    seam || surface.marks.iter().any(|mark| ink(mark) > PRINT)
}

/// Orientation errors of fresh frames that all three patterns identify.
fn fresh(
    nominal: &Pattern,
    estimator: &Estimator,
    ball: &Ball,
    calibration: &Calibration,
    to_calibrated: Rotation,
    rng: &mut ChaCha8Rng,
) -> Outcome<[Vec<f64>; 3]> {
    let known = EstimatorConfig {
        placement_sigma_rad: KNOWN_SIGMA_RAD,
        ..EstimatorConfig::default()
    };
    let detector = || DetectorName::Cnn.build();
    let estimators = [
        estimator.clone(),
        Estimator::for_ball(&calibration.ball(None)?, known, detector()?)?,
        Estimator::new(&ball.drawn, known, detector()?)?,
    ];
    // The least turn between drawn and nominal dots is no error of the orientation.
    let at = |j: &usize| nominal.dots()[*j];
    let of_nominal: Vec<Vec3> = ball.numbers.iter().map(at).collect();
    let turns = [
        kabsch(ball.drawn.dots(), &of_nominal, None)?,
        to_calibrated,
        Rotation::identity(),
    ];
    let mut workspaces = estimators.each_ref().map(Estimator::workspace);
    let mut errors: [Vec<f64>; 3] = Default::default();
    for _ in 0..FRESH {
        let seen = frame(ball, random_rotation(rng), Vec3::zeros(), rng)?;
        // Without intrinsics orientations are those in the view frame.
        let truth = seen.rotation;
        let mut found = [f64::NAN; 3];
        for (k, error) in found.iter_mut().enumerate() {
            let mut out = FrameEstimate::default();
            let ws = &mut workspaces[k];
            estimators[k].estimate(
                &seen.image,
                &Prior::default(),
                &Budget::default(),
                ws,
                &mut out,
            );
            if let Some(pose) = out.pose() {
                *error = (pose.rotation * turns[k]).angle_to(&truth).to_degrees();
            }
        }
        if found.iter().all(|e| *e < 20.0) {
            for (errors, error) in errors.iter_mut().zip(found) {
                errors.push(error);
            }
        }
    }
    Ok(errors)
}

fn report(outcomes: &[Option<Measured>]) {
    let measured: Vec<&Measured> = outcomes.iter().flatten().collect();
    let table = Table::new(["balls", "share or value"]);
    row!(table; "calibrated", share(outcomes, Option::is_some));
    let missing: Vec<Missing> = measured.iter().flat_map(|m| m.missing.clone()).collect();
    for (what, words) in [
        (Missing::Named, "missing dots named"),
        (Missing::Doubtful, "missing dots called doubtful"),
        (Missing::Taken, "missing dots taken for seen ones"),
        (
            Missing::OutOfView,
            "missing dots that never faced the camera",
        ),
    ] {
        row!(table; words, share(&missing, |m| *m == what));
    }
    let named = |m: &Missing| matches!(m, Missing::Named | Missing::OutOfView);
    row!(table; "balls of which all missing dots in view are named", share(&measured, |m| m.missing.iter().all(named)));
    row!(table; "balls without a missing dot taken for a sure one", share(&measured, |m| !m.missing.contains(&Missing::Taken)));
    row!(table; "balls without a seen dot called missing", share(&measured, |m| m.false_alarms == 0));
    let per_ball = |value: fn(&Measured) -> f64, words: &str| {
        row!(table; words, figure(mean(&measured, |m| value(m)), 2, ""));
    };
    per_ball(|m| m.noise_scale, "noise over the detector's own");
    per_ball(|m| m.marks as f64, "marks beside the pattern, a ball");
    per_ball(|m| m.doubtful as f64, "drawn dots called doubtful, a ball");
    report_dots(&measured);
    report_errors(&measured);
}

/// Orientation errors of fresh frames.
fn report_errors(measured: &[&Measured]) {
    let table = Table::new(["pattern", "fresh frames", "mean error", "rms", "median"]);
    for (k, name) in ["nominal", "calibrated", "true"].into_iter().enumerate() {
        let errors: Vec<f64> = measured.iter().flat_map(|m| m.errors[k].clone()).collect();
        let deg = |error: f64| figure(error, 3, "deg");
        let rms = mean(&errors, |e| e * e).sqrt();
        row!(table; name, errors.len(), deg(mean(&errors, |e| *e)), deg(rms), deg(median(&errors, |e| *e)));
    }
    let sums = |m: &&Measured| [1, 2].map(|k: usize| m.errors[k].iter().sum::<f64>());
    let (over, ends) = ratio(&measured.iter().map(sums).collect::<Vec<_>>());
    row!(table; "calibrated over true, mean", None::<&str>, interval(over, ends, 3, ""));
}

/// Whether a dot is of a kind.
type DotTest = fn(&Dot) -> bool;

fn report_dots(measured: &[&Measured]) {
    let deg = |square: f64| square.sqrt().to_degrees();
    let table = Table::new(["dots", "number", "rms error", "predicted"]);
    let kinds: [(&str, DotTest); 3] = [
        ("all", |_| true),
        ("clear of print and seams", |d| !d.on_print),
        ("on print or seams", |d| d.on_print),
    ];
    for (name, is_of_kind) in kinds {
        // The balls are the sample: dots of a ball share its orientation and camera.
        let of_ball = |m: &&Measured| {
            let dots = m.dots.iter().filter(|d| is_of_kind(d));
            dots.fold([0.0; 3], |[error, stated, n], d| {
                [error + d.squared_error, stated + d.predicted, n + 1.0]
            })
        };
        let sums: Vec<[f64; 3]> = measured.iter().map(of_ball).collect();
        let [number, stated] = [2, 1].map(|k: usize| sums.iter().map(|s| s[k]).sum::<f64>());
        let (square, ends) = ratio(&sums.iter().map(|s| [s[0], s[2]]).collect::<Vec<_>>());
        row!(
            table; name, number, interval(deg(square), ends.map(deg), 3, "deg"),
            figure(deg(stated / number), 3, "deg")
        );
    }
    let mut per_ball: Vec<f64> = measured
        .iter()
        .map(|m| deg(mean(&m.dots, |d| d.squared_error)))
        .collect();
    per_ball.sort_by(f64::total_cmp);
    let tenth = per_ball.get(per_ball.len() * 9 / 10).copied();
    row!(table; "the median ball's", None::<&str>, figure(median(&per_ball, |e| *e), 3, "deg"));
    row!(table; "the worst tenth of the balls' from", None::<&str>, tenth.map(|e| figure(e, 3, "deg")));
}
