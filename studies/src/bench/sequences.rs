//! Do the frames of a sequence help each other, and at what price?
//!
//! Clips of one ball, in good and in all conditions, as crops and as frames of 640 x 480. Every frame is
//! estimated alone, and in a second pass with what its neighbors expect. An answer is correct within 20 degrees;
//! brackets are Wilson 95 % intervals, though frames of one clip are not independent.
//!
//!     cargo run --release -p spindoe-studies -- sequences --help

use rayon::prelude::*;
use spindoe::camera::FrameOutcome;
use spindoe::clip::{ImageWork, SequenceConfig, held_images, second_pass};
use spindoe::geometry::Rotation;
use spindoe::image::ImageView;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, SynthSequence};
use spindoe::vision::{Estimator, FrameEstimate};
use spindoe_studies::frames::{DOTS20, all_conditions, alone, estimator, good_conditions};
use spindoe_studies::score::{RATES, rates};
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

const FPS: f64 = 350.0;
const WAYS: [&str; 2] = ["each alone", "two passes"];

/// What became of a clip's frames after each pass, and how many were estimated again.
pub type Passes = ([Vec<FrameOutcome>; 2], usize);

pub fn clip(
    estimator: &Estimator,
    config: &SynthConfig,
    drift_px: Option<[f64; 2]>,
    seed: u64,
    count: usize,
) -> spindoe::Result<Passes> {
    let sequence = ClipConfig {
        fps: FPS,
        drift_px,
        ..ClipConfig::default()
    };
    let sequence = SynthSequence::random(estimator.pattern(), config, &sequence, seed, count)?;
    let mut ws = estimator.workspace();
    let (mut images, mut truths) = (Vec::new(), Vec::new());
    let (mut times_s, mut frames) = (Vec::new(), Vec::new());
    for k in 0..count {
        let frame = sequence.frame(k)?;
        frames.push(alone(estimator, &frame.image, &mut ws));
        truths.push(frame.truth.orientation());
        times_s.push(frame.truth.time_s.unwrap_or_default());
        images.push(frame.image);
    }
    let outcomes = |frames: &[FrameEstimate], truths: &[Rotation]| {
        let each = frames.iter().zip(truths);
        each.map(|(frame, truth)| FrameOutcome::of(frame, truth))
            .collect()
    };
    let first = outcomes(&frames, &truths);
    let views: Vec<ImageView<'_>> = images.iter().map(ImageView::from).collect();
    let (config, mut again) = (SequenceConfig::default(), 0);
    let mut held = held_images(estimator, &views);
    let counted = |numbers: &[usize], work: &ImageWork<'_>| {
        again += numbers.len();
        held(numbers, work)
    };
    let Ok(_) = second_pass(estimator, &config, &times_s, &mut frames, counted);
    Ok(([first, outcomes(&frames, &truths)], again))
}

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
    pub fn run(&self) -> Outcome {
        let (clips, count, seed) = (self.clips, self.frames, self.seed);
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        let estimator = estimator(&pattern)?;
        let whole = SynthConfig {
            image_px: Some([640, 480]),
            ball_px: Some([60.0; 2]),
            ..all_conditions().config
        };
        let sets = [
            ("good conditions, crops", good_conditions().config, None),
            ("all conditions, crops", all_conditions().config, None),
            ("all conditions, 640 x 480", whole, Some([160.0, -60.0])),
        ];
        println!("{clips} clips of {count} frames of a kind, from seed {seed}");
        let headings = ["clips", "way", "estimated again"];
        let table = Table::new(headings.into_iter().chain(RATES));
        for (name, config, drift_px) in sets {
            let passes = (0..clips)
                .into_par_iter()
                .map(|k| clip(&estimator, &config, drift_px, seed + k, count))
                .collect::<spindoe::Result<Vec<Passes>>>()?;
            for (way, words) in WAYS.into_iter().enumerate() {
                let outcomes: Vec<_> = passes.iter().flat_map(|p| p.0[way].clone()).collect();
                let again = (way == 1).then(|| passes.iter().map(|p| p.1).sum::<usize>());
                row!(table; name, words, again; rates(&outcomes));
            }
        }
        Ok(())
    }
}
