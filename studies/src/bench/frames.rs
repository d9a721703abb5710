//! Accuracy of the estimator on synthetic frames: dots found and false, orientations correct, wrong
//! and rejected, errors, confidences; both detectors, by size and by blur. The tables of
//! docs/measurements/detector.md come from here.
//!
//!     cargo run --release -p spindoe-studies -- frames --help
//!
//! The frames' seed is used by no training; the pattern occurs in no training.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::PathBuf;

use nalgebra::{Quaternion, UnitQuaternion};
use rayon::prelude::*;
use spindoe::files;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{Frame, frames};
use spindoe::validate::Proportion;
use spindoe::vision::{
    Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, FrameRejection, Prior,
};

/// Maximum distance of a detection from its dot, ball radii.
const NEAR: f64 = 0.12;
/// The paper's failure threshold.
const FAILURE_DEG: f64 = 20.0;
/// Frames drawn at once.
const AT_ONCE: usize = 500;
const HEADING: &str = "\
| frames | dots found | false a frame | correct | wrong | rejected | mean error | median |
|---|---|---|---|---|---|---|---|";

/// The outcome of a frame.
#[derive(Clone, Copy)]
struct Outcome {
    side: usize,
    blur: f64,
    has_logo: bool,
    visible: usize,
    found: usize,
    false_dots: usize,
    error_deg: Option<f64>,
    confidence: f64,
    /// The reason for a rejection.
    rejection: Option<FrameRejection>,
    circle_off: f64,
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Frames of each of the two sets.
    #[arg(long, default_value_t = 5000)]
    frames: usize,
    /// Seed of the frames, none of which training uses.
    #[arg(long, default_value_t = 20_261_121)]
    seed: u64,
    /// Pattern of the ball.
    #[arg(long, default_value = "designs/dots20/pattern.csv")]
    pattern: PathBuf,
    /// Frames drawn from the ranges in this JSON instead of both sets; what it leaves out is as in all conditions.
    #[arg(long)]
    config: Option<PathBuf>,
}

impl Args {
    /// Measures and prints.
    ///
    /// # Errors
    /// What hinders the measurement.
    pub fn run(&self) -> Result<(), Box<dyn Error>> {
        let (count, seed, path) = (self.frames, self.seed, &self.pattern);
        let pattern = Pattern::read_csv(path)?;
        println!("{count} frames a table, seed {seed}, {}.", path.display());
        let sets = match &self.config {
            Some(path) => {
                let config = serde_json::from_slice(&files::read_bytes(path)?)?;
                vec![("The ranges of the file", config)]
            }
            None => vec![
                ("Good conditions, 60 px", SynthConfig::good()),
                ("All conditions", SynthConfig::default()),
            ],
        };
        for (name, config) in sets {
            let mut outcomes: Vec<Vec<Outcome>> = vec![Vec::new(); DetectorName::ALL.len()];
            for start in (0..count).step_by(AT_ONCE) {
                let some = AT_ONCE.min(count - start);
                let frames = frames(&pattern, &config, seed + start as u64, some)?;
                for (outcomes, detector) in outcomes.iter_mut().zip(DetectorName::ALL) {
                    outcomes.extend(run(&pattern, detector, &frames)?);
                }
            }
            println!("\n### {name}\n");
            for (outcomes, detector) in outcomes.iter().zip(DetectorName::ALL) {
                match detector {
                    DetectorName::Cnn => tables(outcomes),
                    DetectorName::Blob => {
                        println!("\nWith `--detector {detector}`:\n\n{HEADING}");
                        line("all", outcomes, |_| true);
                    }
                }
            }
        }
        Ok(())
    }
}

fn run(
    pattern: &Pattern,
    detector: DetectorName,
    frames: &[Frame],
) -> Result<Vec<Outcome>, Box<dyn Error>> {
    let estimator = Estimator::new(pattern, EstimatorConfig::default(), detector.build()?)?;
    Ok(frames
        .par_iter()
        .map_init(
            || (estimator.workspace(), FrameEstimate::default()),
            |(ws, out), frame| {
                estimator.estimate(&frame.image, &Prior::default(), &Budget::default(), ws, out);
                evaluate(frame, out)
            },
        )
        .collect())
}

fn evaluate(frame: &Frame, out: &FrameEstimate) -> Outcome {
    let truth = &frame.truth;
    let [w, x, y, z] = truth.quaternion_wxyz;
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let likely = || out.dots.iter().filter(|d| d.confidence >= 0.5);
    let off = |d: &spindoe::vision::DotDetection, t: &spindoe::synth::dataset::DotTruth| {
        (d.pixel.u - t.pixel.u).hypot(d.pixel.v - t.pixel.v) / truth.radius_px
    };
    let visible = || truth.dots.iter().filter(|t| t.visible);
    let pose = out.pose();
    Outcome {
        side: truth.size[0],
        blur: truth.blur_px / truth.radius_px,
        has_logo: truth.logo.is_some(),
        visible: visible().count(),
        found: visible()
            .filter(|t| likely().any(|d| off(d, t) < NEAR))
            .count(),
        false_dots: likely()
            .filter(|d| truth.dots.iter().all(|t| off(d, t) >= NEAR))
            .count(),
        error_deg: pose.map(|p| p.rotation.angle_to(&rotation).to_degrees()),
        confidence: pose.map_or(0.0, |p| p.confidence),
        rejection: out.outcome.as_ref().err().copied(),
        circle_off: out.circle.map_or(f64::NAN, |c| {
            (c.center.u - truth.center.u).hypot(c.center.v - truth.center.v) / truth.radius_px
        }),
    }
}

fn tables(outcomes: &[Outcome]) {
    println!("{HEADING}");
    line("all", outcomes, |_| true);
    for [low, high] in [
        [0, 40],
        [40, 60],
        [60, 80],
        [80, 120],
        [120, 201],
        [201, 241],
    ] {
        line(&format!("{low} to {} px", high - 1), outcomes, |j| {
            (low..high).contains(&j.side)
        });
    }
    for [low, high] in [[0.0, 0.03], [0.03, 0.06], [0.06, 0.12], [0.12, 1.0]] {
        let name = format!(
            "blur {:.0} to {:.0} % of the radius",
            100.0 * low,
            100.0 * high
        );
        line(&name, outcomes, |j| j.blur >= low && j.blur < high);
    }
    line("with a logo", outcomes, |j| j.has_logo);
    line("without", outcomes, |j| !j.has_logo);
    let mut reasons = BTreeMap::<String, usize>::new();
    for rejection in outcomes.iter().filter_map(|j| j.rejection) {
        let words = rejection.to_string();
        // Without the values, so that equal reasons count together.
        let words = words.split([':', '(']).next().unwrap_or_default();
        *reasons.entry(words.trim().to_owned()).or_default() += 1;
    }
    println!("\n| confidence | frames | correct |\n|---|---|---|");
    for [low, high] in [[0.85, 0.9], [0.9, 0.99], [0.99, 1.0]] {
        let estimated: Vec<_> = outcomes
            .iter()
            .filter_map(|j| Some((j.error_deg?, j.confidence)))
            .filter(|(_, c)| *c >= low && (*c < high || high == 1.0))
            .collect();
        let correct = estimated.iter().filter(|(e, _)| *e < FAILURE_DEG).count() as u64;
        let rate = Proportion::new(correct, estimated.len() as u64);
        if !estimated.is_empty() {
            println!("| {low} to {high} | {} | {rate} |", estimated.len());
        }
    }
    let median = |value: &dyn Fn(&Outcome) -> f64| {
        let mut values: Vec<f64> = outcomes
            .iter()
            .map(value)
            .filter(|x| x.is_finite())
            .collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    println!(
        "\nThe outline is off by {:.2} % of the radius in the median.",
        100.0 * median(&|j| j.circle_off),
    );
    let reasons = reasons.iter().map(|(why, n)| format!("{n} {why}"));
    println!("Rejected: {}.", reasons.collect::<Vec<_>>().join(", "));
}

fn line(name: &str, outcomes: &[Outcome], choose: impl Fn(&Outcome) -> bool) {
    let some: Vec<&Outcome> = outcomes.iter().filter(|j| choose(j)).collect();
    if some.is_empty() {
        return;
    }
    let n = some.len() as u64;
    let sum = |value: fn(&Outcome) -> usize| some.iter().map(|j| value(j)).sum::<usize>();
    let mut errors: Vec<f64> = some
        .iter()
        .filter_map(|j| j.error_deg)
        .filter(|e| *e < FAILURE_DEG)
        .collect();
    errors.sort_by(f64::total_cmp);
    let estimated = some.iter().filter(|j| j.error_deg.is_some()).count() as u64;
    let correct = errors.len() as u64;
    println!(
        "| {name}: {n} | {:.2} % | {:.3} | {} | {} | {} | {:.2} deg | {:.2} deg |",
        100.0 * sum(|j| j.found) as f64 / sum(|j| j.visible).max(1) as f64,
        sum(|j| j.false_dots) as f64 / n as f64,
        Proportion::new(correct, n),
        Proportion::new(estimated - correct, n),
        Proportion::new(n - estimated, n),
        errors.iter().sum::<f64>() / correct.max(1) as f64,
        errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN),
    );
}
