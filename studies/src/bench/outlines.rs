//! How near to the truth is the outline, and how much do failures of the outline cost?
//!
//! Each frame is estimated as a user would, and again with the true outline. The first table gives
//! the share of outlines within 1, 2 and 5 % of the radius (the larger of the center's and the
//! radius' error), over all frames and over those of which at least 60 % of the rim shows; the
//! second gives correct, wrong and rejected frames (20 degrees).
//!
//!     cargo run --release -p spindoe-studies -- outlines --help

use std::error::Error;
use std::path::PathBuf;

use nalgebra::{Quaternion, UnitQuaternion};
use rayon::prelude::*;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{FrameTruth, independent_frame};
use spindoe::validate::Proportion;
use spindoe::vision::camera::BallCircle;
use spindoe::vision::net::Weights;
use spindoe::vision::net::detector::CnnConfig;
use spindoe::vision::{
    Budget, CnnDetector, DetectorName, Estimator, EstimatorConfig, FrameEstimate, NamedDetector,
    OutlinePrior, Prior,
};

/// Outline errors that are counted, parts of the radius.
const WITHIN: [f64; 3] = [0.01, 0.02, 0.05];
/// Share of the rim that must show for the second group.
const MIN_RIM: f64 = 0.6;
const FAILURE_DEG: f64 = 20.0;

/// A frame's result.
struct Outcome {
    rim: f64,
    /// Of the outline that the pose was found on, part of the radius; infinite where there is none.
    outline_error: f64,
    error_deg: Option<f64>,
    given_error_deg: Option<f64>,
    line: String,
}

fn off(circle: Option<BallCircle>, truth: &FrameTruth) -> f64 {
    circle.map_or(f64::INFINITY, |c| {
        let center = (c.center.u - truth.center.u).hypot(c.center.v - truth.center.v);
        center.max((c.radius - truth.radius_px).abs()) / truth.radius_px
    })
}

fn measure(
    estimator: &Estimator<NamedDetector>,
    pattern: &Pattern,
    config: &SynthConfig,
    seed: u64,
    k: usize,
) -> spindoe::Result<Outcome> {
    let frame = independent_frame(pattern, config, seed, k)?;
    let truth = &frame.truth;
    let [w, x, y, z] = truth.quaternion_wxyz;
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
    let error = |out: &FrameEstimate| {
        out.pose()
            .map(|p| p.rotation.angle_to(&rotation).to_degrees())
    };
    estimator.estimate(
        &frame.image,
        &Prior::default(),
        &Budget::default(),
        &mut ws,
        &mut out,
    );
    let error_deg = error(&out);
    let outline_error = off(out.outline.map(|o| o.circle), truth);
    let found = out.fit.map_or_else(String::new, |f| {
        format!(
            "support {:.2} visible {:.2} {:?} contrast {:.3}",
            f.support, f.visible, f.polarity, f.contrast
        )
    });
    let why = out
        .outcome
        .as_ref()
        .err()
        .map_or(String::new(), ToString::to_string);
    let circle = BallCircle::new(truth.center, truth.radius_px);
    estimator.estimate(
        &frame.image,
        &Prior {
            outline: Some(OutlinePrior::given(circle)),
            ..Prior::default()
        },
        &Budget::default(),
        &mut ws,
        &mut out,
    );
    let given_error_deg = error(&out);
    let line = format!(
        "{k}: radius {:.1} of {:?}, rim {:.2}, outline off {:.3} ({found}), error {error_deg:.1?}, with the true outline {given_error_deg:.1?}; {why}; occluder {:?} {:?}",
        truth.radius_px, truth.size, truth.rim_visible, outline_error, truth.occluder, truth.sensor
    );
    Ok(Outcome {
        rim: truth.rim_visible,
        outline_error,
        error_deg,
        given_error_deg,
        line,
    })
}

fn table(name: &str, outcomes: &[&Outcome]) {
    let n = outcomes.len() as u64;
    let share = |is: &dyn Fn(&Outcome) -> bool| {
        Proportion::new(outcomes.iter().filter(|o| is(o)).count() as u64, n)
    };
    print!("| {name}: {n} ");
    for within in WITHIN {
        print!("| {} ", share(&|o| o.outline_error <= within));
    }
    for given in [false, true] {
        let error = |o: &Outcome| {
            if given {
                o.given_error_deg
            } else {
                o.error_deg
            }
        };
        let correct = share(&|o| error(o).is_some_and(|e| e < FAILURE_DEG));
        let wrong = share(&|o| error(o).is_some_and(|e| e >= FAILURE_DEG));
        let mut errors: Vec<f64> = outcomes
            .iter()
            .filter_map(|o| error(o).filter(|e| *e < FAILURE_DEG))
            .collect();
        errors.sort_by(f64::total_cmp);
        let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        let median = errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN);
        print!("| {correct} | {wrong} | {mean:.2} | {median:.2} ");
    }
    println!("|");
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Frames of a line.
    #[arg(long, default_value_t = 500)]
    frames: usize,
    /// Seed of the frames.
    #[arg(long, default_value_t = 61)]
    seed: u64,
    /// Weights of the detector instead of the built-in ones.
    #[arg(long)]
    weights: Option<PathBuf>,
    /// List the outlines that are off.
    #[arg(long)]
    list: bool,
}

impl Args {
    /// Measures and prints.
    ///
    /// # Errors
    /// What hinders the measurement.
    pub fn run(&self) -> Result<(), Box<dyn Error>> {
        let (count, seed, is_listing) = (self.frames, self.seed, self.list);
        let detector = match &self.weights {
            Some(path) => {
                let weights = Weights::read(path)?;
                NamedDetector::Cnn(CnnDetector::new(&weights, CnnConfig::default())?)
            }
            None => DetectorName::Cnn.build()?,
        };
        let pattern = Pattern::read_csv("designs/dots20/pattern.csv".as_ref())?;
        let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector)?;
        println!("{count} frames a line, seed {seed}; errors in degrees\n");
        println!(
            "| frames | outline within 1 % | 2 % | 5 % | correct | wrong | mean | median \
         | true outline: correct | wrong | mean | median |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
        );
        let sixty = SynthConfig {
            ball_px: Some([60.0, 60.0]),
            ..SynthConfig::default()
        };
        for (name, config) in [
            ("all conditions", SynthConfig::default()),
            ("all conditions, 60 px", sixty),
            ("good conditions", SynthConfig::good()),
        ] {
            let outcomes: spindoe::Result<Vec<Outcome>> = (0..count)
                .into_par_iter()
                .map(|k| measure(&estimator, &pattern, &config, seed, k))
                .collect();
            let outcomes = outcomes?;
            table(name, &outcomes.iter().collect::<Vec<_>>());
            let clear: Vec<&Outcome> = outcomes.iter().filter(|o| o.rim >= MIN_RIM).collect();
            table(&format!("{name}, rim 60 % or more"), &clear);
            if is_listing {
                for outcome in outcomes.iter().filter(|o| {
                    o.outline_error > WITHIN[1] || o.error_deg.is_none_or(|e| e > FAILURE_DEG)
                }) {
                    println!("{}", outcome.line);
                }
            }
        }
        Ok(())
    }
}
