//! Rolling shutters: times, poses and spins against what was rendered.

use std::f64::consts::TAU;

use spindoe::Pattern;
use spindoe::clip::{
    NamedFrame, SequenceConfig, SequenceRows, estimate_sequence, orientations, seen_times,
};
use spindoe::geometry::{CameraFrame, Vec3};
use spindoe::image::ImageView;
use spindoe::spin::estimate::{MotionModel, SpinEstimate};
use spindoe::spin::robust::SpinConfig;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, SynthFrame, SynthSequence};
use spindoe::vision::frame::CameraModel;
use spindoe::vision::{DetectorName, Estimator, EstimatorConfig, FrameEstimate};

const ROWS: usize = 480;
const FRAMES: usize = 10;

/// A clip of a ball that falls through 300 rows, taken by a rolling shutter.
struct Clip {
    spin: Vec3,
    estimator: Estimator,
    frames: Vec<SynthFrame>,
    /// Of the first rows.
    times_s: Vec<f64>,
}

/// What came of a clip.
struct Found {
    frames: Vec<FrameEstimate>,
    seen_s: Vec<f64>,
    spin: Option<Vec3>,
}

impl Clip {
    fn new(fps: f64, readout_s: f64, rps: f64, seed: u64) -> Self {
        let pattern = Pattern::read_csv("designs/dots20/pattern.csv".as_ref()).unwrap();
        let spin = Vec3::new(0.6, 0.0, 0.8) * (rps * TAU);
        let config = SynthConfig {
            image_px: Some([120, ROWS]),
            parallel_share: 0.0,
            ..SynthConfig::good()
        };
        let still = ClipConfig {
            fps,
            spin: Some(spin.into()),
            exposure_s: Some(1e-4),
            drift_px: Some([0.0; 2]),
            readout_s,
        };
        let middle = SynthSequence::random(&pattern, &config, &still, seed, FRAMES).unwrap();
        let v = middle.scene(0).0.circle.center.v;
        // Over the whole picture as far as the ball has come.
        let reach = 2.0 * (v - 40.0).min(ROWS as f64 - 40.0 - v);
        let clip = ClipConfig {
            drift_px: Some([0.0, 0.9 * reach]),
            ..still
        };
        let sequence = SynthSequence::random(&pattern, &config, &clip, seed, FRAMES).unwrap();
        let config = EstimatorConfig {
            camera: CameraModel::Known(sequence.scene(0).0.camera),
            ..EstimatorConfig::default()
        };
        let detector = DetectorName::Cnn.build().unwrap();
        let time_s = |k| 1e-9 * sequence.scene(k).1 as f64;
        Self {
            spin,
            estimator: Estimator::new(&pattern, config, detector).unwrap(),
            frames: (0..FRAMES).map(|k| sequence.frame(k).unwrap()).collect(),
            times_s: (0..FRAMES).map(time_s).collect(),
        }
    }

    fn found(&self, readout_s: f64) -> Found {
        let row_s = readout_s / (ROWS as f64 - 1.0);
        let config = SequenceConfig {
            row_s,
            ..SequenceConfig::default()
        };
        let images: Vec<_> = self
            .frames
            .iter()
            .map(|f| ImageView::from(&f.image))
            .collect();
        let (frames, _) = estimate_sequence(&self.estimator, &config, &self.times_s, &images);
        let seen_s = seen_times(row_s, &self.times_s, &frames);
        let named = NamedFrame::of_times(&seen_s, &frames);
        let rows = orientations(&named, CameraFrame::Camera, true);
        let (measurements, config) = (rows.measurements(), rows.spin_config(SpinConfig::default()));
        let model = MotionModel::Constant;
        let evidence = SequenceRows::new(&self.estimator, row_s, &named, CameraFrame::Camera);
        let fit = match &evidence {
            Some(rows) => SpinEstimate::fit_with(&measurements, model, &config, rows),
            None => SpinEstimate::fit(&measurements, model, &config),
        };
        let spin = fit.map(|fit| fit.at(fit.middle_s()).motion.spin).ok();
        Found {
            frames,
            seen_s,
            spin,
        }
    }

    /// Mean error of the poses, degrees, of at least so many.
    fn error_deg(&self, found: &Found, least: usize) -> f64 {
        let each = self.frames.iter().zip(&found.frames);
        let errors = each.filter_map(|(frame, found)| {
            let truth = frame.truth.camera_orientation();
            Some(truth.angle_to(&found.pose()?.rotation).to_degrees())
        });
        let errors: Vec<f64> = errors.collect();
        assert!(errors.len() >= least, "{}", errors.len());
        errors.iter().sum::<f64>() / errors.len() as f64
    }
}

/// At 240 frames per second the ball's way down the picture alone changes the rate.
#[test]
fn a_ball_is_seen_when_its_row_is_exposed() {
    for seed in [4, 5, 6, 9] {
        let clip = Clip::new(240.0, 0.004, 60.0, seed);
        let (ignored, corrected) = (clip.found(0.0), clip.found(0.004));
        let off = |found: &Found| found.spin.unwrap().norm() / clip.spin.norm() - 1.0;
        // The ball runs after the shutter: the frames seem closer than they are.
        assert!(off(&ignored) > 0.01, "{}", off(&ignored));
        assert!(off(&corrected).abs() < 0.003, "{}", off(&corrected));
        const ROW_S: f64 = 0.004 / (ROWS as f64 - 1.0);
        for (frame, seen_s) in clip.frames.iter().zip(&corrected.seen_s) {
            assert!((frame.truth.time_s.unwrap() - seen_s).abs() < 3.0 * ROW_S);
        }
    }
}

/// At 60 frames per second 40 revolutions per second look like 20 about the other end of the axis. While the shutter passes the ball it
/// turns by 26 degrees.
#[test]
fn rows_settle_what_the_frame_rate_leaves_open() {
    for (seed, rps) in [(6, 20.0), (8, 40.0), (12, 40.0)] {
        let clip = Clip::new(60.0, 0.015, rps, seed);
        let (ignored, corrected) = (clip.found(0.0), clip.found(0.015));
        // Where the rows are ignored the times are wrong: the slower spin, or none that these times explain.
        let slower = |spin: Vec3| (spin.norm() / TAU - 20.0).abs() < 2.0;
        assert!(ignored.spin.is_none_or(slower), "{:?}", ignored.spin);
        let spin = corrected.spin.unwrap();
        assert!((spin.norm() / TAU - rps).abs() < 0.3, "{rps}");
        let off_deg = spin.angle(&clip.spin).to_degrees();
        assert!(off_deg < 1.0, "{off_deg}");
        // Without a spin the frames do not help each other.
        let before = clip.error_deg(&ignored, FRAMES / 2);
        let after = clip.error_deg(&corrected, FRAMES - 2);
        assert!(after < 0.6 * before, "{after} of {before} deg");
    }
}

#[test]
fn a_global_shutter_has_the_times_of_its_frames() {
    let frames = vec![FrameEstimate::default(); 3];
    assert_eq!(seen_times(0.0, &[0.0, 0.5, 0.7], &frames), [0.0, 0.5, 0.7]);
}
