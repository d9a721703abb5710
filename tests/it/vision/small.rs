//! Balls of 12 to 20 pixels, matched as a whole, against the renderer's truth.

use spindoe::clip::{SequenceConfig, estimate_sequence};
use spindoe::image::ImageView;
use spindoe::pattern::Pattern;
use spindoe::synth::dataset::{ClipConfig, SynthSequence, independent_frame};
use spindoe::synth::{SynthConfig, SynthKind};
use spindoe::vision::pose::PoseSource;
use spindoe::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};

/// The angle from which on an answer is wrong, radians.
const WRONG: f64 = 0.35;

fn estimator() -> Estimator {
    let pattern = Pattern::read_csv("designs/dots20/pattern.csv".as_ref()).expect("a pattern");
    let detector = DetectorName::Cnn.build().expect("weights");
    Estimator::new(&pattern, EstimatorConfig::default(), detector).expect("valid settings")
}

fn config(ball_px: f64, kind: SynthKind) -> SynthConfig {
    SynthConfig {
        kind,
        ball_px: Some([ball_px; 2]),
        image_px: Some([48; 2]),
        ..SynthConfig::good()
    }
}

/// Right, wrong, and those of the answers that the pixels gave.
fn counts(ball_px: f64, kind: SynthKind, frames: usize, seed: u64) -> [usize; 3] {
    let estimator = estimator();
    let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
    let mut counts = [0; 3];
    for k in 0..frames {
        let config = config(ball_px, kind);
        let frame = independent_frame(estimator.pattern(), &config, seed, k).expect("a frame");
        let (prior, budget) = (Prior::default(), Budget::default());
        estimator.estimate(&frame.image, &prior, &budget, &mut ws, &mut out);
        let Some(pose) = out.pose() else {
            continue;
        };
        let off = pose.rotation.angle_to(&frame.truth.orientation());
        counts[usize::from(off > WRONG || !kind.has_pattern())] += 1;
        let last = out.hypotheses().last();
        counts[2] +=
            usize::from(last.is_some_and(|h| matches!(h.evidence.source, PoseSource::Pixels(_))));
    }
    counts
}

#[test]
fn balls_of_16_pixels_are_answered_alone() {
    let [right, wrong, of_pixels] = counts(16.0, SynthKind::Dotted, 120, 32_400_501);
    // 76 % of 200 others are right (docs/measurements/detector.md), which would make fewer than 78 of 120 rare.
    assert!(right >= 78 && wrong <= 1, "{right} right, {wrong} wrong");
    assert!(of_pixels >= 1, "no frame needed its pixels");
}

#[test]
fn small_things_without_the_pattern_are_not_answered() {
    for kind in [SynthKind::OtherPattern, SynthKind::Fruit] {
        let [_, wrong, _] = counts(16.0, kind, 40, 32_400_502);
        assert!(wrong <= 1, "{wrong} of 40: {}", kind.as_str());
    }
}

#[test]
fn a_ball_of_12_pixels_is_found_and_answered() {
    let [right, wrong, of_pixels] = counts(12.0, SynthKind::Dotted, 120, 32_400_503);
    // 47 % of 200 others are right: fewer than 42 of 120 would be rare.
    assert!(right >= 42 && wrong <= 2, "{right} right, {wrong} wrong");
    assert!(of_pixels >= 1, "{of_pixels}");
}

#[test]
fn frames_of_16_pixels_help_each_other() {
    let estimator = estimator();
    let clip = ClipConfig {
        fps: 350.0,
        ..ClipConfig::default()
    };
    let (mut before, mut right, mut wrong, count) = (0, 0, 0, 10);
    for seed in 0..6 {
        let config = config(16.0, SynthKind::Dotted);
        let pattern = estimator.pattern();
        let sequence = SynthSequence::random(pattern, &config, &clip, 32_400_601 + seed, count)
            .expect("a clip");
        let frames: Vec<_> = (0..count)
            .map(|k| sequence.frame(k).expect("a frame"))
            .collect();
        let images: Vec<ImageView<'_>> = frames.iter().map(|f| ImageView::from(&f.image)).collect();
        let times: Vec<f64> = frames
            .iter()
            .map(|f| f.truth.time_s.unwrap_or_default())
            .collect();
        let config = SequenceConfig::default();
        let (found, summary) = estimate_sequence(&estimator, &config, &times, &images);
        before += summary.alone;
        for (found, frame) in found.iter().zip(&frames) {
            let off = |r| frame.truth.orientation().angle_to(r);
            match found.pose() {
                Some(pose) if off(&pose.rotation) < WRONG => right += 1,
                Some(_) => wrong += 1,
                None => {}
            }
        }
    }
    // 69 % and 85 % of the frames of 60 others are right (`bench small`, seed 63400001): of seven clips six are found nearly whole, and one hardly
    // at all. Three such of six would be rare.
    assert!(
        right >= before + 5 && right >= 36,
        "{before}, then {right} of 60"
    );
    assert!(wrong <= 1, "{wrong} wrong");
}
