//! How long does a picture of a folder take, alone and tracked? For pictures that `spindoe synth` or the path tracer drew,
//! whose `truth.json` says what is right, and for any others.
//!
//! Each picture is in memory, as a camera hands it out. *Alone*: nothing is known of it, and it is searched as those of a file
//! are. *Tracked*: what the tracker makes of it after the first five of the folder; times are the truth's, or 1/60 s.
//!
//!     cargo run --release -p spindoe-studies -- pictures --help

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use cpu_time::ThreadTime;
use serde::Deserialize as _;
use spindoe::camera::FrameOutcome;
use spindoe::clip::{Tracker, TrackerConfig};
use spindoe::geometry::Rotation;
use spindoe::image::Picture;
use spindoe::pattern::Pattern;
use spindoe::source::FrameSource as _;
use spindoe::source::files::{open, sources};
use spindoe::stats::quantile;
use spindoe::synth::dataset::FrameTruth;
use spindoe::vision::FrameEstimate;
use spindoe_studies::frames::{DOTS20, alone, estimator};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

/// Pictures before the tracker counts as warm.
const WARMUP: usize = 5;
/// Seconds between pictures whose times are unknown.
const INTERVAL_S: f64 = 1.0 / 60.0;

struct Shown {
    picture: Picture,
    time_s: f64,
    orientation: Option<Rotation>,
}

/// A picture's time, that of outline, dots and identification of it, and what became of it.
struct Sample {
    all: Duration,
    stages: [Duration; 3],
    is_answered: bool,
    outcome: Option<FrameOutcome>,
}

impl Sample {
    fn new(begun: ThreadTime, found: &FrameEstimate, shown: &Shown) -> Self {
        let of = found.timings;
        Self {
            all: begun.elapsed(),
            stages: [of.locate, of.detect, of.identify],
            is_answered: found.pose().is_some(),
            outcome: shown
                .orientation
                .map(|truth| FrameOutcome::of(found, &truth)),
        }
    }
}

/// The pictures of a folder, or of its folder `images`.
fn read(folder: &Path) -> Outcome<Vec<Shown>> {
    let truth = match std::fs::read(folder.join("truth.json")) {
        Ok(bytes) => {
            let all: serde_json::Value = serde_json::from_slice(&bytes)?;
            let frames = all["frames"].as_array().into_iter().flatten();
            // Of what is no ball there is nothing to be right about.
            frames
                .filter_map(|f| FrameTruth::deserialize(f).ok())
                .collect()
        }
        Err(_) => Vec::new(),
    };
    let within = folder.join("images");
    let pictures = if within.is_dir() {
        within
    } else {
        folder.to_path_buf()
    };
    let mut shown = Vec::new();
    for source in sources(&[pictures])? {
        let mut source = open(&source, u64::MAX)?;
        for frame in source.frames() {
            let frame = frame?;
            let is_its =
                |t: &&FrameTruth| Path::new(&t.image).file_name() == frame.path.file_name();
            let of = truth.iter().find(is_its);
            shown.push(Shown {
                picture: frame.picture?,
                time_s: of
                    .and_then(|t| t.time_s)
                    .unwrap_or(shown.len() as f64 * INTERVAL_S),
                orientation: of
                    .filter(|t| !t.dots.is_empty())
                    .map(FrameTruth::orientation),
            });
        }
    }
    Ok(shown)
}

/// How a picture is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum How {
    Alone,
    Tracked,
}

impl How {
    fn measure(self, pattern: &Pattern, pictures: &[Shown]) -> spindoe::Result<Vec<Sample>> {
        match self {
            Self::Alone => each_alone(pattern, pictures),
            Self::Tracked => tracked(pattern, pictures),
        }
    }
}

fn each_alone(pattern: &Pattern, pictures: &[Shown]) -> spindoe::Result<Vec<Sample>> {
    let estimator = estimator(pattern)?;
    let mut ws = estimator.workspace();
    let mut samples = Vec::new();
    for (k, shown) in pictures.iter().take(1).chain(pictures).enumerate() {
        let begun = ThreadTime::now();
        let found = alone(&estimator, shown.picture.view()?, &mut ws);
        let sample = Sample::new(begun, &found, shown);
        // The first time memory is made.
        if k > 0 {
            samples.push(sample);
        }
    }
    Ok(samples)
}

fn tracked(pattern: &Pattern, pictures: &[Shown]) -> spindoe::Result<Vec<Sample>> {
    let mut tracker = Tracker::new(Arc::new(estimator(pattern)?), TrackerConfig::default())?;
    let mut samples = Vec::new();
    for (k, shown) in pictures.iter().enumerate() {
        let begun = ThreadTime::now();
        let state = tracker.update(shown.picture.view()?, shown.time_s, None)?;
        let sample = Sample::new(begun, state.frame, shown);
        if k >= WARMUP {
            samples.push(sample);
        }
    }
    Ok(samples)
}

fn line(table: &Table, folder: &Path, how: How, samples: &[Sample]) {
    let ms = |of: &dyn Fn(&Sample) -> Duration, share: f64| {
        let mut all: Vec<f64> = samples.iter().map(|s| 1e3 * of(s).as_secs_f64()).collect();
        all.sort_by(f64::total_cmp);
        figure(quantile(&all, share), 2, "")
    };
    let quantiles = [0.5, 0.9, 0.99].map(|share| ms(&|s| s.all, share));
    let stages = [0, 1, 2].map(|k: usize| ms(&move |s| s.stages[k], 0.5));
    let count = |is: &dyn Fn(&Sample) -> bool| samples.iter().filter(|s| is(s)).count();
    let judged = |is: fn(FrameOutcome) -> bool| move |s: &Sample| s.outcome.is_some_and(is);
    row!(table;
        format!("{}, {how:?}", folder.display()),
        samples.len();
        quantiles;
        stages;
        [
            count(&|s| s.is_answered),
            count(&judged(FrameOutcome::is_right)),
            count(&judged(FrameOutcome::is_wrong)),
        ]
    );
}

#[derive(clap::Args)]
pub struct Args {
    /// Folders of pictures of the ball.
    #[arg(required = true)]
    folders: Vec<PathBuf>,
    /// The ball's pattern.
    #[arg(long, value_name = "PATTERN.csv", default_value = DOTS20)]
    pattern: PathBuf,
    /// In this way only.
    #[arg(long)]
    how: Option<How>,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let pattern = Pattern::read_csv(&self.pattern)?;
        let table = Table::new([
            "pictures",
            "number",
            "p50, ms of CPU",
            "p90",
            "p99",
            "outline, p50",
            "dots",
            "identification",
            "answered",
            "right",
            "wrong",
        ]);
        for folder in &self.folders {
            let pictures = read(folder)?;
            for how in [How::Alone, How::Tracked] {
                if self.how.is_none_or(|only| only == how) {
                    let samples = how.measure(&pattern, &pictures)?;
                    line(&table, folder, how, &samples);
                }
            }
        }
        Ok(())
    }
}
