//! Estimates orientations in a loop, as with a camera: frames in memory, one workspace, latency
//! printed.
//!
//!     cargo run --release --example estimate_camera -- PATTERN.csv IMAGE [ROUNDS]
//!
//! One image replaces the camera's frames; each frame shifts it by a pixel.

use std::time::{Duration, Instant};

use spindoe::image::{GrayImage, RgbImage};
use spindoe::pattern::Pattern;
use spindoe::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};

fn main() -> spindoe::Result<()> {
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    let [pattern, image, ..] = &arguments[..] else {
        eprintln!("usage: estimate_camera PATTERN.csv IMAGE [ROUNDS]");
        return Ok(());
    };
    let rounds = arguments
        .get(2)
        .and_then(|r| r.to_str()?.parse().ok())
        .unwrap_or(1000usize);
    let pattern = Pattern::read_csv(pattern.as_ref())?;
    let gray = RgbImage::read(image.as_ref())?.to_gray();
    let frames: Vec<GrayImage> = (0..4)
        .map(|k| {
            let (du, dv) = (k % 2, k / 2);
            GrayImage::from_fn(gray.width(), gray.height(), |u, v| {
                gray.at(u as isize + du, v as isize + dv)
            })
        })
        .collect();
    let detector = DetectorName::Cnn.build()?;
    let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector)?;
    let mut workspace = estimator.workspace();
    let mut seen = FrameEstimate::default();
    let mut latencies = Vec::with_capacity(rounds);
    let mut stages = [Duration::ZERO; 3];
    let mut estimated = 0;
    for k in 0..rounds.max(1) {
        let begun = Instant::now();
        let frame = &frames[k % frames.len()];
        estimator.estimate(
            frame,
            &Prior::default(),
            &Budget::default(),
            &mut workspace,
            &mut seen,
        );
        latencies.push(begun.elapsed());
        estimated += usize::from(seen.pose().is_some());
        let t = seen.timings;
        for (sum, stage) in stages.iter_mut().zip([t.locate, t.detect, t.identify]) {
            *sum += stage;
        }
    }
    latencies.sort_unstable();
    let at = |p: usize| latencies[(latencies.len() - 1) * p / 100];
    println!("{estimated} of {} frames estimated", latencies.len());
    println!("latency: median {:?}, 99 % {:?}", at(50), at(99));
    let mean = |k: usize| stages[k] / latencies.len() as u32;
    println!(
        "mean: locate {:?}, detect {:?}, identify {:?}",
        mean(0),
        mean(1),
        mean(2)
    );
    Ok(())
}
