//! Do the frames of a sequence help each other, and at what price?
//!
//! Clips of one ball, in good and in all conditions, as crops and as frames of 640 x 480. Every frame is
//! estimated alone, and in a second pass with what its neighbors expect. An answer is correct within 20 degrees;
//! brackets are Wilson 95 % intervals, though frames of one clip are not independent.
//!
//!     cargo run --release -p spindoe-studies -- sequences --help

use std::error::Error;

use nalgebra::{Quaternion, UnitQuaternion};
use rayon::prelude::*;
use spindoe::geometry::Rotation;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{Sequence, SequenceConfig as SynthSequence};
use spindoe::validate::Proportion;
use spindoe::vision::estimator::{SequenceConfig, second_pass};
use spindoe::vision::{
    Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, NamedDetector, Prior,
};

const FPS: f64 = 350.0;
const FAILURE_DEG: f64 = 20.0;
const WAYS: [&str; 2] = ["each alone", "two passes"];

/// Frames that are correct and wrong after each pass.
#[derive(Default, Clone, Copy)]
struct Counts {
    frames: usize,
    /// Estimates of the second pass.
    again: usize,
    correct: [usize; 2],
    wrong: [usize; 2],
}

fn clip(
    estimator: &Estimator<NamedDetector>,
    config: &SynthConfig,
    drift_px: Option<[f64; 2]>,
    seed: u64,
    count: usize,
) -> spindoe::Result<Counts> {
    let sequence = SynthSequence {
        fps: FPS,
        drift_px,
        ..SynthSequence::default()
    };
    let sequence = Sequence::random(estimator.pattern(), config, &sequence, seed, count)?;
    let settings = SequenceConfig::default();
    let mut ws = estimator.workspace();
    let (mut images, mut truths) = (Vec::new(), Vec::new());
    let (mut times_s, mut frames) = (Vec::new(), Vec::new());
    for k in 0..count {
        let frame = sequence.frame(k)?;
        let mut out = FrameEstimate::default();
        estimator.estimate(
            &frame.image,
            &Prior::default(),
            &Budget::default(),
            &mut ws,
            &mut out,
        );
        let [w, x, y, z] = frame.truth.quaternion_wxyz;
        truths.push(UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)));
        times_s.push(frame.truth.time_s.unwrap_or_default());
        images.push(frame.image);
        frames.push(out);
    }
    let mut counts = Counts {
        frames: count,
        ..Counts::default()
    };
    count_answers(&frames, &truths, 0, &mut counts);
    second_pass(&settings, &times_s, &mut frames, |doubts, frames| {
        counts.again += doubts.len();
        let settled = doubts.iter().filter_map(|d| {
            let (image, before) = (&images[d.frame], &frames[d.frame]);
            let again = estimator.estimate_again(image, d, before, &mut ws)?;
            Some((d.frame, again))
        });
        Ok::<_, spindoe::Error>(settled.collect())
    })?;
    count_answers(&frames, &truths, 1, &mut counts);
    Ok(counts)
}

fn count_answers(frames: &[FrameEstimate], truths: &[Rotation], way: usize, counts: &mut Counts) {
    for (frame, truth) in frames.iter().zip(truths) {
        let Some(pose) = frame.pose() else { continue };
        let is_correct = pose.rotation.angle_to(truth).to_degrees() < FAILURE_DEG;
        let all = if is_correct {
            &mut counts.correct
        } else {
            &mut counts.wrong
        };
        all[way] += 1;
    }
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Clips of a kind.
    #[arg(long, default_value_t = 40)]
    clips: u64,
    /// Frames of a clip.
    #[arg(long, default_value_t = 16)]
    frames: usize,
    /// Seed of the clips.
    #[arg(long, default_value_t = 70_001)]
    seed: u64,
}

impl Args {
    /// Measures and prints.
    ///
    /// # Errors
    /// What hinders the measurement.
    pub fn run(&self) -> Result<(), Box<dyn Error>> {
        let Args {
            clips,
            frames: count,
            seed,
        } = *self;
        let pattern = Pattern::read_csv(std::path::Path::new("designs/dots20/pattern.csv"))?;
        let detector = DetectorName::Cnn.build()?;
        let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector)?;
        let whole = |config: SynthConfig| SynthConfig {
            image_px: Some([640, 480]),
            ball_px: Some([60.0; 2]),
            ..config
        };
        let sets = [
            ("good conditions, crops", SynthConfig::good(), None),
            ("all conditions, crops", SynthConfig::default(), None),
            (
                "all conditions, 640 x 480",
                whole(SynthConfig::default()),
                Some([160.0, -60.0]),
            ),
        ];
        println!("{clips} clips of {count} frames of each kind, seeds from {seed}.\n");
        println!("| clips | frames | way | correct | wrong | unanswered |");
        println!("|---|---|---|---|---|---|");
        for (name, config, drift_px) in sets {
            let counts = (0..clips)
                .into_par_iter()
                .map(|k| clip(&estimator, &config, drift_px, seed + k, count))
                .collect::<spindoe::Result<Vec<_>>>()?;
            let sum = |f: &dyn Fn(&Counts) -> usize| counts.iter().map(f).sum::<usize>() as u64;
            let frames = sum(&|c| c.frames);
            for (way, words) in WAYS.iter().enumerate() {
                let (correct, wrong) = (sum(&|c| c.correct[way]), sum(&|c| c.wrong[way]));
                let share = |n: u64| Proportion::new(n, frames);
                let looked_at = if way == 0 { frames } else { sum(&|c| c.again) };
                println!(
                    "| {name} | {looked_at} | {words} | {} | {} | {} |",
                    share(correct),
                    share(wrong),
                    share(frames - correct - wrong)
                );
            }
        }
        Ok(())
    }
}
