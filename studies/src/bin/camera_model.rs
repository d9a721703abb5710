//! Learns the detection model of `spindoe::predict` from rendered frames that the estimator reads,
//! and writes models/camera.json.
//!
//!     cargo run --release -p spindoe-studies --bin camera_model -- [FRAMES] [SEED] [OUT.json]
//!
//! Half of the frames are drawn from all conditions, half from good ones, balls of 20 to 200 pixels,
//! each with another random pattern of 12 to 40 dots. No shipped pattern occurs. All are read at first look; those that
//! it leaves in doubt are looked at again. Of every fourth pair a later frame of the same sequence is read too: what
//! both share lasts.

use std::error::Error;

use rand::RngExt;
use rayon::prelude::*;
use spindoe::pattern::random_pattern;
use spindoe::predict::{DetectionModel, FrameOutcome, Observation, Provenance};
use spindoe::synth::dataset::{Sequence, frame_rng};
use spindoe::synth::{Scene, SynthConfig};
use spindoe::vision::net::detector::CnnConfig;
use spindoe::vision::net::graph::Head;
use spindoe::vision::net::weights::{Weights, built_in_sha256};
use spindoe::vision::{Budget, CnnDetector, Estimator, EstimatorConfig, FrameEstimate, Prior};

/// Minimum separation of the dots of a random pattern, radians.
const SEPARATION: f64 = 0.25;
/// The stream of a frame's pattern, apart from the one that draws its scene.
const PATTERNS: u64 = 1 << 61;

/// The later frame of a pair, and the frames a second. By then the ball has turned on: only what does not turn
/// with it is the same.
const LATER: usize = 5;
const FPS: f64 = 300.0;

/// What was observed of a ball.
struct Observed {
    observation: Observation,
    later: Option<Observation>,
    /// What the second look found on the outline of the first, where that left doubt.
    again: Option<Observation>,
    outcome: FrameOutcome,
}

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1);
    let frames: usize = arguments.next().map_or(Ok(20_000), |a| a.parse())?;
    let seed: u64 = arguments.next().map_or(Ok(15_000_001), |a| a.parse())?;
    let out = arguments.next().unwrap_or("models/camera.json".into());
    let ball_px = Some([20.0, 200.0]);
    let configs = [
        SynthConfig {
            ball_px,
            ..SynthConfig::default()
        },
        SynthConfig {
            ball_px,
            ..SynthConfig::good()
        },
    ];
    let any = random_pattern(20, SEPARATION, &mut frame_rng(seed, PATTERNS))?;
    let small = CnnDetector::new(&Weights::built_in(Head::Dots)?, CnnConfig::default())?;
    let [first_look, both_looks] = [small, CnnDetector::built_in()?]
        .map(|detector| Estimator::new(&any, EstimatorConfig::default(), detector));
    let (first_look, both_looks) = (first_look?, both_looks?);
    let observed: Vec<Outcome<Observed>> = (0..frames)
        .into_par_iter()
        .map(|k| {
            let mut rng = frame_rng(seed, PATTERNS + 1 + k as u64);
            let dots = rng.random_range(12..=40);
            let pattern = random_pattern(dots, SEPARATION, &mut rng)?;
            let scene = Scene::random(&pattern, &configs[k % 2], &mut frame_rng(seed, k as u64))?;
            let (first_look, both_looks) = (
                first_look.for_pattern(&pattern)?,
                both_looks.for_pattern(&pattern)?,
            );
            let mut ws = first_look.workspace();
            let mut read =
                |scene: &Scene| -> Outcome<(Observation, Option<Observation>, FrameOutcome)> {
                    let ball = scene.seen()?;
                    let image = scene.render()?.image;
                    let (mut first, mut last) =
                        (FrameEstimate::default(), FrameEstimate::default());
                    first_look.estimate(
                        &image,
                        &Prior::default(),
                        &Budget::default(),
                        &mut ws,
                        &mut first,
                    );
                    let is_settled = first.is_settled();
                    let found = if is_settled {
                        &first
                    } else {
                        both_looks.estimate(
                            &image,
                            &Prior::default(),
                            &Budget::default(),
                            &mut ws,
                            &mut last,
                        );
                        &last
                    };
                    let outcome = FrameOutcome::of(found, &ball.rotation);
                    let observed = |frame| Observation::new(&ball, frame, outcome.is_wrong());
                    let is_same = first.outline.map(|o| o.circle) == last.outline.map(|o| o.circle);
                    let again = (!is_settled && is_same).then(|| observed(&last));
                    Ok((observed(&first), again, outcome))
                };
            let (observation, again, outcome) = read(&scene)?;
            let later = (k / 2 % 4 == 0).then(|| {
                let sequence = Sequence::of_scene(scene, FPS, seed ^ k as u64, LATER + 1);
                read(&sequence.scene(LATER).0)
            });
            Ok(Observed {
                observation,
                later: later.transpose()?.map(|(observation, ..)| observation),
                again,
                outcome,
            })
        })
        .collect();
    let (mut observations, mut pairs, mut looks) = (Vec::new(), Vec::new(), Vec::new());
    let (mut right, mut wrong) = (0, 0);
    for one in observed {
        let Observed {
            observation,
            later,
            again,
            outcome,
        } = one?;
        right += usize::from(outcome.is_right());
        wrong += usize::from(outcome.is_wrong());
        looks.extend(again.map(|again| [observation.clone(), again]));
        pairs.extend(later.map(|later| [observation.clone(), later]));
        observations.push(observation);
    }
    println!("{frames} frames of seed {seed}: {right} right, {wrong} wrong");
    let provenance = Provenance {
        frames,
        seed,
        weights_sha256: built_in_sha256(Head::Dots),
        large_sha256: built_in_sha256(Head::DotsLarge),
        outline_sha256: built_in_sha256(Head::Outline),
    };
    let model = DetectionModel::learn(&observations, &pairs, &looks, provenance)?;
    println!(
        "frame effects {:.3?}, doubtful {:?}, wrong without outline {:.4}, false dots: shapes {:.2?} {:.2?}, on print {:.2} {:.2}\noutline: {:.2?}\nlasting, of {} pairs: {:.2?}\nsecond look at {}: {:.3?}",
        model.frame_effect,
        model.of_doubtful,
        model.wrong_without_outline,
        model.false_dots[0].shape,
        model.false_dots[1].shape,
        model.false_dots[0].on_print,
        model.false_dots[1].on_print,
        model.outline_correction,
        pairs.len(),
        model.shares,
        looks.len(),
        model.second_look,
    );
    std::fs::write(&out, model.to_json()?)?;
    println!("{out}");
    Ok(())
}
