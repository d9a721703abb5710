//! How long does a frame take, live? Whole frames of 1280 x 1024 with a ball that flies through them, as bytes in
//! memory, and crops of 60 px.
//!
//! Each thread follows a camera of its own: its own clip, its own tracker. *Tracked* are the frames
//! after the first ones; *acquired* are frames before which the tracker was reset, so that the ball
//! may be anywhere, and the same frames are searched thoroughly, without a coarse search. With `--disc`, a white disc stands still in every clip. Times are given by the clock on
//! the wall, which needs an idle machine, and by that of the thread's own work.
//!
//!     cargo run --release -p spindoe-studies -- latency --help

use std::sync::Arc;
use std::time::Instant;

use cpu_time::ThreadTime;
use rayon::prelude::*;
use spindoe::camera::FrameOutcome;
use spindoe::clip::{Tracker, TrackerConfig};
use spindoe::geometry::Rotation;
use spindoe::image::{RawImage, RawPixel, RgbImage};
use spindoe::pattern::Pattern;
use spindoe::stats::quantile;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, FrameTruth, SynthSequence, independent_frame};
use spindoe::vision::FrameEstimate;
use spindoe_studies::frames::{DOTS20, alone, estimator, good_conditions};
use spindoe_studies::score::median;
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

const SIZE: [usize; 2] = [1280, 1024];
const FPS: f64 = 400.0;
/// Displacement over a clip, pixels.
const DRIFT_PX: [f64; 2] = [420.0, -140.0];
/// The disc's radius, pixels.
const DISC: f64 = 38.0;
/// Frames of a clip before the tracker counts as warm.
const WARMUP: usize = 5;
const CROPS: usize = 300;

struct Clip {
    frames: Vec<(Vec<u8>, f64, Rotation)>,
}

/// A frame's time, and what became of it.
#[derive(Clone, Copy)]
struct Sample {
    wall_ms: f64,
    cpu_ms: f64,
    outcome: FrameOutcome,
}

/// Both clocks.
struct Stopwatch(Instant, ThreadTime);

impl Stopwatch {
    fn start() -> Self {
        Self(Instant::now(), ThreadTime::now())
    }

    fn stop(&self, found: &FrameEstimate, truth: &Rotation) -> Sample {
        Sample {
            wall_ms: 1e3 * self.0.elapsed().as_secs_f64(),
            cpu_ms: 1e3 * self.1.elapsed().as_secs_f64(),
            outcome: FrameOutcome::of(found, truth),
        }
    }
}

fn bytes(image: &RgbImage, disc: Option<[f64; 2]>) -> Vec<u8> {
    let mut bytes: Vec<u8> = image
        .to_gray()
        .values()
        .iter()
        .map(|x| (255.0 * x.clamp(0.0, 1.0) + 0.5) as u8)
        .collect();
    let Some([u, v]) = disc else { return bytes };
    for (i, byte) in bytes.iter_mut().enumerate() {
        let (x, y) = ((i % image.width()) as f64, (i / image.width()) as f64);
        let share = (DISC + 0.5 - (x - u).hypot(y - v)).clamp(0.0, 1.0);
        *byte = (f64::from(*byte) * (1.0 - share) + 250.0 * share) as u8;
    }
    bytes
}

/// The first clip from a seed on in which the ball stays whole.
fn clip(
    pattern: &Pattern,
    seed: u64,
    count: usize,
    ball_px: f64,
    disc: bool,
) -> spindoe::Result<Clip> {
    let config = SynthConfig {
        image_px: Some(SIZE),
        ball_px: Some([ball_px; 2]),
        parallel_share: 0.0,
        ..good_conditions().config
    };
    let sequence = ClipConfig {
        fps: FPS,
        drift_px: Some(DRIFT_PX),
        ..ClipConfig::default()
    };
    for seed in seed.. {
        let sequence = SynthSequence::random(pattern, &config, &sequence, seed, count)?;
        let ends = [sequence.frame(0)?.truth, sequence.frame(count - 1)?.truth];
        let middle = [0, 1].map(|k| {
            let at = |t: &FrameTruth| [t.center.u, t.center.v][k];
            0.5 * (at(&ends[0]) + at(&ends[1]))
        });
        // The disc stands beside the path.
        let place = [middle[0], middle[1] + 3.0 * ball_px];
        let is_inside =
            ends.iter().all(|t| t.rim_visible > 0.99) && place[1] + DISC < SIZE[1] as f64;
        if is_inside {
            let frame = |k: usize| {
                let frame = sequence.frame(k)?;
                let time_s = frame.truth.time_s.unwrap_or_default();
                let bytes = bytes(&frame.image, disc.then_some(place));
                Ok((bytes, time_s, frame.truth.orientation()))
            };
            let frames = (0..count).into_par_iter().map(frame);
            return Ok(Clip {
                frames: frames.collect::<spindoe::Result<_>>()?,
            });
        }
    }
    Err(spindoe::Error::Internal("no clip".into()))
}

/// Frames that are searched thoroughly, without a tracker and without a coarse search before.
fn search(pattern: &Pattern, clip: &Clip) -> spindoe::Result<Vec<Sample>> {
    let estimator = estimator(pattern)?;
    let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
    let mut samples = Vec::new();
    for (bytes, _, truth) in &clip.frames {
        let raw = RawImage::new(SIZE[0], SIZE[1], RawPixel::Gray, bytes)?;
        let watch = Stopwatch::start();
        estimator.detect(raw, None, &mut ws, &mut out);
        estimator.identify_detections(&mut ws, &mut out);
        samples.push(watch.stop(&out, truth));
    }
    Ok(samples)
}

/// Tracked frames, acquired ones, and those that are searched thoroughly.
fn follow(pattern: &Pattern, clip: &Clip) -> spindoe::Result<[Vec<Sample>; 3]> {
    let estimator = Arc::new(estimator(pattern)?);
    let mut samples = [Vec::new(), Vec::new(), search(pattern, clip)?];
    for (kind, samples) in samples.iter_mut().take(2).enumerate() {
        let mut tracker = Tracker::new(Arc::clone(&estimator), TrackerConfig::default())?;
        for (k, (bytes, time_s, truth)) in clip.frames.iter().enumerate() {
            let raw = RawImage::new(SIZE[0], SIZE[1], RawPixel::Gray, bytes)?;
            if kind == 1 {
                tracker.reset();
            }
            let watch = Stopwatch::start();
            let state = tracker.update(raw, *time_s, None)?;
            let sample = watch.stop(state.frame, truth);
            if kind == 1 || k >= WARMUP {
                samples.push(sample);
            }
        }
    }
    Ok(samples)
}

fn crops(pattern: &Pattern, seed: u64) -> spindoe::Result<(Vec<Sample>, Vec<[f64; 3]>)> {
    let estimator = estimator(pattern)?;
    let mut ws = estimator.workspace();
    let set = good_conditions();
    let (mut samples, mut stages) = (Vec::new(), Vec::new());
    for k in 0..CROPS {
        let frame = independent_frame(pattern, &set.config, seed, k)?;
        let (width, height) = (frame.image.width(), frame.image.height());
        let bytes = bytes(&frame.image, None);
        let raw = RawImage::new(width, height, RawPixel::Gray, &bytes)?;
        let watch = Stopwatch::start();
        let out = alone(&estimator, raw, &mut ws);
        let sample = watch.stop(&out, &frame.truth.orientation());
        if k >= WARMUP {
            samples.push(sample);
            let t = out.timings;
            stages.push([t.locate, t.detect, t.identify].map(|time| 1e3 * time.as_secs_f64()));
        }
    }
    Ok((samples, stages))
}

fn line(table: &Table, name: &str, samples: &[Sample]) {
    let count = |is: fn(FrameOutcome) -> bool| samples.iter().filter(|s| is(s.outcome)).count();
    let times = [|s: &Sample| s.wall_ms, |s: &Sample| s.cpu_ms].map(|ms| {
        let mut ms: Vec<f64> = samples.iter().map(ms).collect();
        ms.sort_by(f64::total_cmp);
        [0.5, 0.99].map(|share| figure(quantile(&ms, share), 2, ""))
    });
    let counts = [count(FrameOutcome::is_right), count(FrameOutcome::is_wrong)];
    row!(table; name, samples.len(); times.concat(); counts);
}

#[derive(clap::Args)]
pub struct Args {
    /// Frames of a clip.
    #[arg(long, default_value_t = 100)]
    frames: usize,
    /// Seed of the first clip.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Diameter of the ball in the clips, pixels.
    #[arg(long, default_value_t = 60.0)]
    ball_px: f64,
    /// Threads, each with a camera of its own.
    #[arg(long, default_value_t = 1)]
    threads: u64,
    /// A white disc stands still in every clip.
    #[arg(long)]
    disc: bool,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (count, seed, threads) = (self.frames, self.seed, self.threads);
        let (ball_px, disc) = (self.ball_px, self.disc);
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        let clips: Vec<Clip> = (0..threads)
            .map(|k| clip(&pattern, seed + 1000 * k, count, ball_px, disc))
            .collect::<spindoe::Result<_>>()?;
        let results = std::thread::scope(|scope| {
            let followed = clips
                .iter()
                .map(|clip| scope.spawn(|| follow(&pattern, clip)));
            let followed: Vec<_> = followed.collect();
            let joined = followed.into_iter().map(|f| f.join());
            joined
                .map(|f| f.map_err(|_| spindoe::Error::Internal("a thread failed".into()))?)
                .collect::<spindoe::Result<Vec<_>>>()
        })?;
        println!(
            "Clips of {count} frames, ball of {ball_px} px, seeds from {seed}, threads: {threads}"
        );
        let table = Table::new([
            "frames",
            "number",
            "p50, ms",
            "p99, ms",
            "p50, ms of CPU",
            "p99, ms of CPU",
            "right",
            "wrong",
        ]);
        let kinds = ["tracked", "acquired", "searched thoroughly"];
        for (kind, name) in kinds.into_iter().enumerate() {
            let all: Vec<Sample> = results.iter().flat_map(|r| r[kind].clone()).collect();
            line(&table, &format!("{name}, 1280 x 1024"), &all);
        }
        if threads == 1 && !disc {
            let (samples, stages) = crops(&pattern, seed)?;
            line(&table, "crop of 60 px", &samples);
            let [locate, detect, identify] =
                [0, 1, 2].map(|k: usize| figure(median(&stages, |s| s[k]), 2, "ms"));
            println!(
                "\nCrops, medians: outline {locate}, dots {detect}, identification {identify}."
            );
        }
        Ok(())
    }
}
