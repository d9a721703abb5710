//! Turns during the exposure by the smear of dots, against what was rendered.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use spindoe::Pattern;
use spindoe::clip::{NamedFrame, SequenceConfig, SequenceSmears, estimate_sequence, orientations};
use spindoe::geometry::{CameraFrame, Vec3};
use spindoe::image::ImageView;
use spindoe::spin::alias::AliasConfig;
use spindoe::spin::estimate::{MotionModel, SpinEstimate};
use spindoe::spin::robust::SpinConfig;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, SynthSequence, independent_frame};
use spindoe::vision::dots::smear::Turn;
use spindoe::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};

fn estimator(measures_blur: bool) -> Estimator {
    let pattern = Pattern::read_csv("designs/dots20/pattern.csv".as_ref()).unwrap();
    let config = EstimatorConfig {
        measures_blur,
        ..EstimatorConfig::default()
    };
    Estimator::new(&pattern, config, DetectorName::Cnn.build().unwrap()).unwrap()
}

/// True and found turns of so many frames whose ball turns by `max_rad` at most.
fn turns(max_rad: f64, frames: usize, measures_blur: bool) -> Vec<(Vec3, Option<Turn>)> {
    let estimator = estimator(measures_blur);
    let pattern = estimator.pattern();
    let world = SynthConfig {
        max_arc_rad: max_rad,
        max_shift_px: 0.0,
        ..SynthConfig::good()
    };
    let mut ws = estimator.workspace();
    let turn = |k| {
        let frame = independent_frame(pattern, &world, 32_599_001, k).unwrap();
        let mut found = FrameEstimate::default();
        let (prior, budget) = (Prior::default(), Budget::default());
        estimator.estimate(&frame.image, &prior, &budget, &mut ws, &mut found);
        assert!(measures_blur || found.blurs.is_empty());
        let smear = estimator.smear(&found, Vector2::zeros());
        (frame.truth.turn(), smear.and_then(|s| s.turn()))
    };
    (0..frames).map(turn).collect()
}

#[test]
fn the_turn_of_a_rendered_ball_is_measured() {
    let all = turns(0.21, 160, true);
    let clear = all
        .iter()
        .filter_map(|(truth, turn)| Some((truth, turn.filter(|t| t.evidence > 5.0)?)));
    let mut errors: Vec<f64> = clear
        .map(|(truth, turn)| (turn.angle() - truth.norm()).abs().to_degrees())
        .collect();
    assert!(errors.len() >= 15, "{}", errors.len());
    errors.sort_by(f64::total_cmp);
    // Measured: 0.5 deg in the median, 1.7 in seven of ten; print beside dots makes the rest.
    assert!(errors[errors.len() / 2] < 1.0, "{errors:?}");
    assert!(errors[errors.len() * 7 / 10] < 2.0, "{errors:?}");
}

#[test]
fn a_ball_at_rest_shows_no_turn() {
    let all = turns(0.0, 40, true);
    let found: Vec<Turn> = all.iter().filter_map(|t| t.1).collect();
    assert!(found.len() >= 30, "{}", found.len());
    let clear = found.iter().filter(|t| t.evidence > 8.0).count();
    // Print beside a dot and ovals smear it, too.
    assert!(
        clear * 5 <= found.len(),
        "{clear} of {}: {found:?}",
        found.len()
    );
}

#[test]
fn blur_is_measured_where_it_is_asked_for() {
    assert!(turns(0.1, 3, false).iter().all(|t| t.1.is_none()));
}

/// At 120 frames per second 90 revolutions per second look like 30 about the other end of the axis; in 0.3 milliseconds they smear
/// by 10 degrees, not by 3.
#[test]
fn smears_settle_what_the_frame_rate_leaves_open() {
    const FPS: f64 = 120.0;
    const EXPOSURE_S: f64 = 0.0003;
    let estimator = estimator(true);
    let pattern = estimator.pattern();
    for (seed, rps) in [(1, 90.0), (2, 30.0), (3, 90.0)] {
        let clip = ClipConfig {
            fps: FPS,
            spin: Some([0.6 * rps * TAU, 0.0, 0.8 * rps * TAU]),
            exposure_s: Some(EXPOSURE_S),
            ..ClipConfig::default()
        };
        let sequence =
            SynthSequence::random(pattern, &SynthConfig::good(), &clip, seed, 10).unwrap();
        let frames: Vec<_> = (0..10).map(|k| sequence.frame(k).unwrap()).collect();
        let times_s: Vec<f64> = frames.iter().map(|f| f.truth.time_s.unwrap()).collect();
        let images: Vec<_> = frames.iter().map(|f| ImageView::from(&f.image)).collect();
        let (found, _) =
            estimate_sequence(&estimator, &SequenceConfig::default(), &times_s, &images);
        let named = NamedFrame::of_times(&times_s, &found);
        let rows = orientations(&named, CameraFrame::View, true);
        let (measurements, config) = (rows.measurements(), rows.spin_config(SpinConfig::default()));
        let smears =
            SequenceSmears::new(&estimator, &named, EXPOSURE_S, CameraFrame::View).unwrap();
        assert!(smears.frames() >= 8, "{}", smears.frames());
        let model = MotionModel::Constant;
        let slowest = SpinEstimate::fit(&measurements, model, &config).unwrap();
        assert!((slowest.at(0.0).motion.rps() - 30.0).abs() < 1.0);
        let settled = SpinEstimate::fit_with(&measurements, model, &config, &smears).unwrap();
        assert!((settled.at(0.0).motion.rps() - rps).abs() < 1.0, "{rps}");
        // A turn of 3 degrees is too small to say how long it is.
        let factor = smears.exposure_factor(&settled.at(0.0).motion.spin);
        assert_eq!(factor.is_some(), rps > 80.0);
        let is_right = factor.is_none_or(|factor| (factor - 1.0).abs() < 0.1);
        assert!(is_right, "{factor:?}");
        // Other spins are not even listed.
        let listed = AliasConfig::default();
        let summary = settled
            .summary(&measurements, 0.0, &listed, 10)
            .weighed(&smears, &listed);
        assert!(
            summary.alternatives.is_empty(),
            "{:?}",
            summary.alternatives
        );
    }
}
