//! Patterns built from rendered clips alone. The table of docs/measurements/calibrate.md comes from here.
//!
//!     cargo run --release -p spindoe-studies -- calibration-unknown --help
//!
//! A ball has 12 to 24 dots at random, at least 0.35 rad apart, and turns as in `bench calibration`.
//! With PLAIN = 1 there is nothing else on it; otherwise logos, seams and stains as in `SynthConfig::good`,
//! which nothing tells from dots but their looks.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::calibrate::{CalibrationConfig, build_pattern};
use spindoe::geometry::{
    Rotation, angle_between, random_direction, random_rotation, tangent_frame,
};
use spindoe::synth::{Scene, SynthConfig};
use spindoe::validate::Proportion;
use spindoe::{DotUncertainty, ObservedDot, Pattern, Recognizer, RobustRecognizer, ViewModel};
use spindoe_studies::Outcome;
use spindoe_studies::frames::{alone, estimator};

/// Revolutions of the ball in a clip, and frames per second.
const TURNS: f64 = 4.0;
const FPS: f64 = 30.0;
/// A dot that faces the camera so far and is seen in fewer of these views is hidden by print.
const FACING: f64 = 0.3;
const HIDDEN: f64 = 0.3;
/// Minimum separation of the dots, radians.
const APART_RAD: f64 = 0.35;

/// What became of a clip.
enum Built {
    Rejected(String),
    Pattern {
        /// Dots of the ball.
        dots: usize,
        /// Those of them that print hides.
        hidden: usize,
        /// Dots of the ball that can be seen and are not in the pattern.
        missed: usize,
        /// Dots of the pattern that are none of the ball's.
        invented: usize,
        /// The largest error of the others, degrees.
        worst_deg: f64,
    },
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Balls.
    #[arg(long, default_value_t = 20)]
    balls: u64,
    /// Seed of the balls.
    #[arg(long, default_value_t = 17)]
    seed: u64,
    /// Radius of the balls, pixels.
    #[arg(long, default_value_t = 60.0)]
    px: f64,
    /// Frames of a clip.
    #[arg(long, default_value_t = 160)]
    frames: usize,
    /// Nothing but dots on the balls.
    #[arg(long)]
    plain: bool,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (balls, seed, px, frames) = (self.balls, self.seed, self.px, self.frames);
        let looks = match self.plain {
            false => SynthConfig::good(),
            true => SynthConfig::good().unprinted(),
        };
        let built: Result<Vec<Built>, String> = (0..balls)
            .into_par_iter()
            .map(|k| one(&looks, seed, k, px, frames).map_err(|e| e.to_string()))
            .collect();
        let mut good = 0;
        for (k, built) in built?.iter().enumerate() {
            match built {
                Built::Rejected(why) => println!("ball {k}: rejected: {why}"),
                Built::Pattern {
                    dots,
                    hidden,
                    missed,
                    invented,
                    worst_deg,
                } => {
                    let whole = *missed == 0 && *invented == 0 && *worst_deg < 1.0;
                    good += u64::from(whole);
                    println!(
                        "ball {k}: {dots} dots, {hidden} of them hidden by print, {missed} others missed, {invented} \
                     invented, worst {worst_deg:.2} deg"
                    );
                }
            }
        }
        println!(
            "all dots that can be seen and no others, each within 1 deg: {}",
            Proportion::new(good, balls)
        );
        Ok(())
    }
}

fn one(looks: &SynthConfig, seed: u64, k: u64, px: f64, frames: usize) -> Outcome<Built> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(k);
    let count = rng.random_range(12..=24);
    let mut dots: Vec<spindoe::geometry::Vec3> = Vec::new();
    while dots.len() < count {
        let dot = random_direction(&mut rng);
        if dots.iter().all(|d| angle_between(d, &dot) > APART_RAD) {
            dots.push(dot);
        }
    }
    let truth = Pattern::new(dots)?;
    let config = SynthConfig {
        ball_px: Some([px; 2]),
        ..looks.clone().as_designed()
    };
    let scene = Scene::random(&truth, &config, &mut rng)?;
    let estimator = estimator(&truth)?;
    let mut workspace = estimator.workspace();
    let (mut rotation, mut axis) = (random_rotation(&mut rng), random_direction(&mut rng));
    let about = tangent_frame(&axis)[0];
    let step = TURNS * std::f64::consts::TAU / frames as f64;
    let wander = Rotation::from_scaled_axis(about * (std::f64::consts::PI / frames as f64));
    let mut estimates = Vec::with_capacity(frames);
    let mut views = vec![[0usize; 2]; truth.len()];
    for _ in 0..frames {
        let mut view = scene.clone();
        view.rotation = rotation;
        view.spin = axis * (step * FPS);
        view.exposure_s = 1e-3;
        view.shift_px = [0.0; 2];
        view.noise_seed = rng.random();
        let seen = view.render()?;
        for dot in seen.dots.iter().filter(|d| d.facing > FACING) {
            views[dot.index][0] += 1;
            views[dot.index][1] += usize::from(dot.is_visible());
        }
        estimates.push(alone(&estimator, &seen.image, &mut workspace));
        rotation = Rotation::from_scaled_axis(axis * step) * rotation;
        axis = wander * axis;
    }
    match build_pattern(&estimates, None, &CalibrationConfig::default())? {
        Ok(built) => {
            let is_hidden = |[facing, seen]: &[usize; 2]| (*seen as f64) < HIDDEN * *facing as f64;
            let hidden: Vec<bool> = views.iter().map(is_hidden).collect();
            judged(&built.pattern, &truth, &hidden)
        }
        Err(rejection) => Ok(Built::Rejected(format!("{count} dots: {rejection}"))),
    }
}

/// The built dots, named by the true ones.
fn judged(built: &Pattern, truth: &Pattern, hidden: &[bool]) -> Outcome<Built> {
    let view = ViewModel {
        visibility_limit: -0.99,
        ..ViewModel::default()
    };
    let recognizer = RobustRecognizer::new(truth, view.into())?;
    let observed: Vec<ObservedDot> = built
        .dots()
        .iter()
        .map(|d| ObservedDot {
            direction: *d,
            uncertainty: DotUncertainty::Isotropic { sigma_rad: 0.01 },
        })
        .collect();
    let Ok(found) = recognizer.identify(&observed, &mut recognizer.workspace()) else {
        return Ok(Built::Rejected("not the ball's dots".to_owned()));
    };
    let mut worst: f64 = 0.0;
    let mut invented = 0;
    for (dot, name) in built.dots().iter().zip(&found.assignment) {
        match name {
            Some(name) => {
                let expected = found.rotation * truth.dots()[usize::from(*name)];
                worst = worst.max(angle_between(dot, &expected).to_degrees());
            }
            None => invented += 1,
        }
    }
    let named: Vec<usize> = found
        .assignment
        .iter()
        .flatten()
        .map(|n| usize::from(*n))
        .collect();
    let missed = (0..truth.len()).filter(|j| !hidden[*j] && !named.contains(j));
    Ok(Built::Pattern {
        dots: truth.len(),
        hidden: hidden.iter().filter(|h| **h).count(),
        missed: missed.count(),
        invented,
        worst_deg: worst,
    })
}
