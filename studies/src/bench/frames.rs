//! Accuracy of the estimator on synthetic frames: dots found and false, answers right, wrong and missing, errors,
//! confidences; both detectors, by size and by blur.
//!
//!     cargo run --release -p spindoe-studies -- frames --help
//!
//! The frames' seed is used by no training; the pattern occurs in no training.

use std::collections::BTreeMap;
use std::path::PathBuf;

use spindoe::camera::FrameOutcome;
use spindoe::files;
use spindoe::pattern::Pattern;
use spindoe::synth::dataset::{DotTruth, SynthFrame};
use spindoe::vision::{DetectorName, DotDetection, Estimator, EstimatorConfig, FrameEstimate};
use spindoe_studies::frames::{DOTS20, FrameSet, all_conditions, each, good_conditions, outcome};
use spindoe_studies::score::{Claim, RATES, bins, claimed, mean, median, rates};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

/// Maximum distance of a detection from its dot, ball radii.
const NEAR: f64 = 0.12;
/// Frames of a seed; the next ones have the next seeds.
const AT_ONCE: usize = 500;

/// What became of a frame.
#[derive(Clone)]
struct Seen {
    side: usize,
    blur: f64,
    has_logo: bool,
    visible: usize,
    found: usize,
    false_dots: usize,
    outcome: FrameOutcome,
    confidence: f64,
    /// The reason for a rejection, without its values.
    rejection: Option<String>,
    circle_off: f64,
}

#[derive(clap::Args)]
pub struct Args {
    /// Frames of each of the two sets.
    #[arg(long, default_value_t = 5000)]
    frames: usize,
    /// Seed of the frames, none of which training uses.
    #[arg(long, default_value_t = 20_261_121)]
    seed: u64,
    /// Pattern of the ball.
    #[arg(long, default_value = DOTS20)]
    pattern: PathBuf,
    /// Frames drawn from the ranges in this JSON instead of both sets; what it leaves out is as in all conditions.
    #[arg(long)]
    config: Option<PathBuf>,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (count, seed, path) = (self.frames, self.seed, &self.pattern);
        let pattern = Pattern::read_csv(path)?;
        let [one, other] = [DetectorName::Cnn, DetectorName::Blob].map(|detector| {
            Estimator::new(&pattern, EstimatorConfig::default(), detector.build()?)
        });
        let estimators = [one?, other?];
        println!("{count} frames a table, seed {seed}, {}.", path.display());
        let sets = match &self.config {
            Some(path) => vec![FrameSet {
                name: "the ranges of the file",
                config: serde_json::from_slice(&files::read_bytes(path)?)?,
            }],
            None => vec![good_conditions(), all_conditions()],
        };
        for set in sets {
            let mut seen = Vec::new();
            for start in (0..count).step_by(AT_ONCE) {
                let some = AT_ONCE.min(count - start);
                let judge = |frame: &SynthFrame, found: [FrameEstimate; 2]| {
                    found.map(|found| evaluate(frame, &found))
                };
                seen.extend(each(
                    &estimators,
                    &set.config,
                    seed + start as u64,
                    some,
                    judge,
                )?);
            }
            println!("\n### In {}", set.name);
            let [cnn, blob]: [Vec<Seen>; 2] =
                [0, 1].map(|k| seen.iter().map(|both| both[k].clone()).collect());
            tables(&cnn);
            println!("\nWith `--config detector={}`:", DetectorName::Blob);
            line(&table(), "all", &blob, &|_| true);
        }
        Ok(())
    }
}

fn evaluate(frame: &SynthFrame, out: &FrameEstimate) -> Seen {
    let truth = &frame.truth;
    let likely = || out.dots.iter().filter(|d| d.probability >= 0.5);
    let off = |d: &DotDetection, t: &DotTruth| {
        (d.pixel.u - t.pixel.u).hypot(d.pixel.v - t.pixel.v) / truth.radius_px
    };
    let visible = || truth.dots.iter().filter(|t| t.visible);
    let is_found = |t: &&DotTruth| likely().any(|d| off(d, t) < NEAR);
    let is_false = |d: &&DotDetection| truth.dots.iter().all(|t| off(d, t) >= NEAR);
    let words = |reason: String| {
        let words = reason.split([':', '(']).next();
        words.unwrap_or_default().trim_end().to_owned()
    };
    Seen {
        side: truth.size[0],
        blur: truth.blur_px / truth.radius_px,
        has_logo: truth.logo.is_some(),
        visible: visible().count(),
        found: visible().filter(is_found).count(),
        false_dots: likely().filter(is_false).count(),
        outcome: outcome(out, truth),
        confidence: out.pose().map_or(0.0, |p| p.confidence),
        rejection: out.outcome.as_ref().err().map(|r| words(r.to_string())),
        circle_off: out.circle.map_or(f64::NAN, |c| {
            (c.center.u - truth.center.u).hypot(c.center.v - truth.center.v) / truth.radius_px
        }),
    }
}

fn table() -> Table {
    let headings = ["frames", "number", "dots found", "false a frame"];
    Table::new(headings.into_iter().chain(RATES))
}

/// The row of some of the frames, where there are any.
fn line(table: &Table, name: &str, all: &[Seen], is: &dyn Fn(&Seen) -> bool) {
    let some: Vec<Seen> = all.iter().filter(|j| is(j)).cloned().collect();
    if some.is_empty() {
        return;
    }
    let found = mean(&some, |j| j.found as f64) / mean(&some, |j| j.visible as f64);
    let outcomes: Vec<FrameOutcome> = some.iter().map(|j| j.outcome).collect();
    row!(
        table; name, some.len(), figure(100.0 * found, 2, "%"),
        figure(mean(&some, |j| j.false_dots as f64), 3, "");
        rates(&outcomes)
    );
}

fn tables(all: &[Seen]) {
    let rows = table();
    let line = |name: &str, is: &dyn Fn(&Seen) -> bool| line(&rows, name, all, is);
    line("all", &|_| true);
    for bin in bins(&[32.0, 40.0, 60.0, 80.0, 120.0, 200.0]) {
        line(&bin.counts("px"), &|j| bin.holds(j.side as f64));
    }
    for bin in bins(&[0.0, 3.0, 6.0, 12.0]) {
        let name = format!("blur of {} of the radius", bin.named("%"));
        line(&name, &|j| bin.holds(100.0 * j.blur));
    }
    line("with a logo", &|j| j.has_logo);
    line("without", &|j| !j.has_logo);
    let table = Table::new(["confidence", "frames", "right"]);
    let answered = all.iter().filter(|j| j.rejection.is_none());
    let claims = answered.map(|j| Claim {
        confidence: j.confidence,
        is_right: j.outcome.is_right(),
    });
    let claims: Vec<Claim> = claims.collect();
    for bin in bins(&[0.85, 0.9, 0.99]) {
        let (_, right) = claimed(&claims, bin);
        row!(table; bin.named(""), right.trials, right);
    }
    let mut reasons = BTreeMap::<&String, usize>::new();
    for reason in all.iter().filter_map(|j| j.rejection.as_ref()) {
        *reasons.entry(reason).or_default() += 1;
    }
    if !reasons.is_empty() {
        let table = Table::new(["why there is no answer", "frames"]);
        reasons
            .into_iter()
            .for_each(|(why, count)| row!(table; why, count));
    }
    let circle_off = figure(100.0 * median(all, |j| j.circle_off), 2, "%");
    println!("\nThe outline is off by {circle_off} of the radius in the median.");
}
