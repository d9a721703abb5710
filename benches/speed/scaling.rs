//! Cost as a function of the input's size: every reader, `identify` and `spin` on 10^4 to 10^6
//! rows, `estimate` on 10 to 1 000 frames.
//!
//! Time is CPU time (user, all threads), since other
//! processes may use the machine too; wall time is printed beside it. The exponent is the slope of
//! the straight line through the logarithms: 1 is linear.

use std::fmt::Write as _;
use std::io::Cursor;
use std::num::NonZero;
use std::path::Path;
use std::time::Instant;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::Error;
use spindoe::clip::frame_table::read_times;
use spindoe::geometry::{Vec3, random_direction};
use spindoe::image::RgbImage;
use spindoe::pattern::Pattern;
use spindoe::pipeline::Sink;
use spindoe::recognize::observed::{self, ObservedReader, observed_frames};
use spindoe::recognize::robust::{RobustConfig, RobustRecognizer};
use spindoe::recognize::stream::{FrameAnswer, identify_frames};
use spindoe::spin::orientations::Orientations;
use spindoe::spin::robust::{RobustEstimator, SpinConfig};
use spindoe::spin::simulate::{Scenario, stream};
use spindoe::spin::trajectories::TrajectorySet;
use spindoe::view::ProtocolName;
use spindoe::vision::{
    Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, OutlinePrior, Prior,
};

use crate::Outcome;

const ROWS: [usize; 3] = [10_000, 100_000, 1_000_000];
const FRAMES: [usize; 3] = [10, 100, 1_000];
/// Rows of the largest input for commands that do more than read it.
const MAX_SPIN_ROWS: usize = 100_000;

pub fn run() -> Outcome {
    println!("\n| what | rows | user s | wall s | user us a row |\n|---|---|---|---|---|");
    let dir = tempfile::tempdir()?;
    measure_all(dir.path(), &ROWS)
}

fn measure_all(dir: &Path, rows: &[usize]) -> Outcome {
    let pattern = pattern()?;
    scaling("read observed dots", rows, |n| {
        let text = dots(&pattern, n);
        Ok(move || {
            let path = Path::new("dots.csv");
            ObservedReader::new(path, Cursor::new(text), 0.05)?
                .try_for_each(|frame| frame.map(drop))?;
            Ok(())
        })
    })?;
    scaling("read orientations", rows, |n| {
        let text = orientations(n)?;
        Ok(move || {
            Orientations::read(Path::new("o.csv"), Cursor::new(text))?;
            Ok(())
        })
    })?;
    scaling("read trajectories", rows, |n| {
        let mut text = String::new();
        for i in 0..n {
            writeln!(text, "{:.3};0.125;-0.375;0.250", 0.007 * i as f64)?;
        }
        std::fs::write(dir.join("index.csv"), "traj_file,x_spin,y_spin,z_spin\n")?;
        std::fs::write(dir.join("000.csv"), text)?;
        Ok(|| {
            TrajectorySet::read_dir(dir)?;
            Ok(())
        })
    })?;
    scaling("read times", rows, |n| {
        let mut text = String::from("frame,time_s\n");
        for i in 0..n {
            writeln!(text, "{i}.png,{}", 0.002 * i as f64)?;
        }
        let path = dir.join("times.csv");
        std::fs::write(&path, text)?;
        Ok(move || {
            read_times(&path)?;
            Ok(())
        })
    })?;
    scaling("identify (rows are dots)", rows, |n| {
        let text = dots(&pattern, n);
        let recognizer = RobustRecognizer::new(&pattern, RobustConfig::default())?;
        Ok(move || {
            let frames = ObservedReader::new(Path::new("dots.csv"), Cursor::new(text), 0.03)?;
            let threads = std::thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN);
            identify_frames(&recognizer, frames, threads, &mut Count(0))?;
            Ok(())
        })
    })?;
    let feasible: Vec<usize> = rows
        .iter()
        .map(|r| r / 10)
        .filter(|r| *r <= MAX_SPIN_ROWS)
        .collect();
    scaling("spin (rows are frames)", &feasible, |n| {
        let text = orientations(n)?;
        Ok(move || {
            let file = Orientations::read(Path::new("o.csv"), Cursor::new(text))?;
            let fit = RobustEstimator::new(SpinConfig::default()).fit(&file.measurements());
            fit.map(drop).map_err(|e| format!("{e:?}").into())
        })
    })?;
    scaling("estimate (rows are frames of 64 x 64)", &FRAMES, |n| {
        let estimator = Estimator::new(
            &pattern,
            EstimatorConfig::default(),
            DetectorName::Cnn.build()?,
        )?;
        let image = RgbImage::new(64, 64, vec![[0.5; 3]; 64 * 64])?;
        let circle =
            spindoe::vision::BallCircle::new(spindoe::vision::Pixel { u: 31.5, v: 31.5 }, 30.0);
        Ok(move || {
            let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
            for _ in 0..n {
                estimator.estimate(
                    &image,
                    &Prior {
                        outline: Some(OutlinePrior::given(circle)),
                        ..Prior::default()
                    },
                    &Budget::default(),
                    &mut ws,
                    &mut out,
                );
            }
            Ok(())
        })
    })
}

/// Measures `prepare(n)` for every n, and fits the exponent.
fn scaling<F: FnOnce() -> Outcome>(
    name: &str,
    sizes: &[usize],
    prepare: impl Fn(usize) -> Result<F, Box<dyn std::error::Error>>,
) -> Outcome {
    let mut points = Vec::new();
    for &n in sizes {
        let work = prepare(n)?;
        let (start, user) = (Instant::now(), user_seconds()?);
        work()?;
        let (wall, user) = (start.elapsed().as_secs_f64(), user_seconds()? - user);
        println!(
            "| {name} | {n} | {user:.2} | {wall:.3} | {:.3} |",
            1e6 * user / n as f64
        );
        // The CPU clock ticks every 10 ms: shorter times are not measurable.
        if user >= 0.05 {
            points.push(((n as f64).ln(), user.ln()));
        }
    }
    match slope(&points) {
        Some(exponent) => println!("| {name} | exponent | {exponent:.2} | | |"),
        None => println!("| {name} | exponent | too short | | |"),
    }
    Ok(())
}

/// Slope of the least-squares line.
fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let products = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>();
    let squares = points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>();
    (points.len() > 1).then(|| products / squares)
}

/// CPU time of all threads of this process, seconds (Linux).
fn user_seconds() -> Result<f64, Box<dyn std::error::Error>> {
    let stat = std::fs::read_to_string("/proc/self/stat")?;
    // The name in brackets may hold anything; the 12th field after it counts ticks of 10 ms.
    let fields = stat.rsplit(')').next().unwrap_or_default();
    let ticks: f64 = fields
        .split_whitespace()
        .nth(11)
        .ok_or("no time")?
        .parse()?;
    Ok(ticks / 100.0)
}

struct Count(usize);

impl Sink<FrameAnswer> for Count {
    type Error = Error;

    fn take(&mut self, _: FrameAnswer) -> Result<(), Error> {
        self.0 += 1;
        Ok(())
    }
}

fn pattern() -> spindoe::Result<Pattern> {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut dots: Vec<Vec3> = Vec::new();
    while dots.len() < 20 {
        let dot = random_direction(&mut rng);
        if dots.iter().all(|d| d.dot(&dot) < 0.3f64.cos()) {
            dots.push(dot);
        }
    }
    Pattern::new(dots)
}

/// About `rows` dots of the protocol `paper`, about ten per frame.
fn dots(pattern: &Pattern, rows: usize) -> String {
    let view = ProtocolName::Paper.view();
    observed::to_csv(&observed_frames(pattern, &view, 1, rows as u64 / 10))
}

fn orientations(rows: usize) -> Result<String, Box<dyn std::error::Error>> {
    let scenario = Scenario {
        frames: rows,
        ..Scenario::default()
    };
    let sequence = scenario.simulate(Vec3::new(100.0, -200.0, 150.0), &mut stream(1, 0));
    Ok(Orientations::from_measurements(&sequence.measurements).to_csv())
}
