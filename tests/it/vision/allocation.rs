//! The estimator's promise: after the first frames of a size it allocates nothing.

use spindoe::image::{GrayImage, RgbImage};
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::independent_frame;
use spindoe::vision::{
    Budget, CnnDetector, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Patch, Prior,
};

/// Frames of one size: bright and dark, with logos, some without a whole outline.
fn frames(count: usize) -> Vec<RgbImage> {
    let pattern = crate::common::random_pattern(20, 5);
    let config = SynthConfig {
        size_px: [70; 2],
        ..SynthConfig::default()
    };
    (0..count)
        .map(|k| independent_frame(&pattern, &config, 77, k).unwrap().image)
        .collect()
}

#[test]
fn a_warm_detector_does_not_allocate() {
    let detector = CnnDetector::built_in().unwrap();
    let (mut ws, mut dots) = (detector.workspace(), Vec::new());
    let frames = frames(40);
    let patches: Vec<Patch> = frames
        .iter()
        .map(|frame| {
            let (width, height) = (frame.width() as f64, frame.height() as f64);
            let circle = spindoe::vision::BallCircle::new(
                spindoe::vision::Pixel {
                    u: 0.5 * width,
                    v: 0.5 * height,
                },
                0.45 * width.min(height),
            );
            Patch::cut(&frame.to_gray(), &circle)
        })
        .collect();
    dots.reserve(256);
    let cold = allocation_counter::measure(|| drop(detector.workspace()));
    assert!(cold.count_total > 0, "the counter does not count");
    let warm = allocation_counter::measure(|| {
        for patch in &patches {
            detector.detect_into(patch, &mut ws, &mut dots);
        }
    });
    assert_eq!(warm.count_total, 0);
}

#[test]
fn a_warm_estimator_does_not_allocate() {
    let pattern = crate::common::random_pattern(20, 5);
    let color = frames(crate::common::few_or_all(40, 120));
    let gray: Vec<GrayImage> = color.iter().map(RgbImage::to_gray).collect();
    for name in DetectorName::ALL {
        let detector = name.build().unwrap();
        let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector).unwrap();
        let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
        let (mut answered, mut all) = (0, 0);
        let mut run = |from: usize, to: usize| {
            for k in from..to {
                estimator.estimate(
                    &color[k],
                    &Prior::default(),
                    &Budget::default(),
                    &mut ws,
                    &mut out,
                );
                answered += usize::from(out.pose().is_some());
                estimator.estimate(
                    &gray[k],
                    &Prior::default(),
                    &Budget::default(),
                    &mut ws,
                    &mut out,
                );
                answered += usize::from(out.pose().is_some());
                all += 2;
            }
        };
        run(0, 5);
        let warm = allocation_counter::measure(|| run(5, color.len()));
        assert_eq!(warm.count_total, 0, "{name}");
        // Both ways through the estimator were taken.
        assert!(answered > all / 4 && answered < all, "{answered} of {all}");
    }
}
