//! What a second camera gains: errors of orientation and position, frames that are answered, and whether the cameras' chi2 is what
//! it should be. Balls of 40 mm fly where the axes of two cameras meet, 1 m from both, under one angle between them.
//!
//!     cargo run --release -p spindoe-studies -- rig --help

use rayon::prelude::*;
use spindoe::Vec3;
use spindoe::clip::{
    CameraClip, Fusion, RigConfig, RigFrame, SequenceConfig, combine, estimate_passes, held_images,
};
use spindoe::geometry::{CameraFrame, Rotation};
use spindoe::image::{ImageView, RgbImage};
use spindoe::pattern::Pattern;
use spindoe::stats::{Proportion, quantile};
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::ClipConfig;
use spindoe::synth::rig::RigSequence;
use spindoe::vision::{
    Camera, DetectorName, Estimator, EstimatorConfig, Extrinsics, FrameEstimate, Intrinsics, Prior,
    Rig, RigCamera,
};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

/// Focal length and sides of the images, pixels; distance of the place where both axes meet, and the ball's radius, m.
const FOCAL_PX: f64 = 1600.0;
const SIZE: [usize; 2] = [480, 400];
const DISTANCE_M: f64 = 1.0;
const RADIUS_M: f64 = 0.02;
/// An orientation that is farther off is wrong.
const WRONG_DEG: f64 = 20.0;

#[derive(clap::Args)]
pub struct Args {
    /// Clips.
    #[arg(long, default_value_t = 200)]
    clips: u64,
    /// Frames of a clip and camera.
    #[arg(long, default_value_t = 6)]
    frames: usize,
    /// Seed of the first clip.
    #[arg(long, default_value_t = 65_200_001)]
    seed: u64,
    /// Angle between the cameras, degrees.
    #[arg(long, default_value_t = 90.0)]
    angle_deg: f64,
    /// All conditions instead of good ones.
    #[arg(long)]
    all: bool,
    /// Dots where the pattern has them.
    #[arg(long)]
    exact: bool,
    /// The pattern.
    #[arg(long, default_value = "designs/dots40/pattern.csv")]
    pattern: std::path::PathBuf,
}

/// A time of a clip.
struct Seen {
    /// Errors of each camera alone, degrees and mm, where it has an orientation.
    alone: [Option<[f64; 2]>; 2],
    fused: Option<[f64; 2]>,
    cameras: usize,
    fusion: Fusion,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let pattern = Pattern::read_csv(&self.pattern)?;
        let rig = self.rig()?;
        let clips: Vec<(Vec<Seen>, usize)> = (0..self.clips)
            .into_par_iter()
            .map(|k| self.clip(&pattern, &rig, self.seed + k))
            .collect::<spindoe::Result<_>>()?;
        let doubted = clips.iter().filter(|(_, doubts)| *doubts > 0).count();
        let seen: Vec<&Seen> = clips.iter().flat_map(|(seen, _)| seen).collect();
        println!(
            "{} clips of {} frames, seed {}, {} deg between the cameras, {} conditions; {doubted} clips whose cameras are doubted",
            self.clips,
            self.frames,
            self.seed,
            self.angle_deg,
            if self.all { "all" } else { "good" },
        );
        say_answers(&seen);
        say_errors(&seen);
        Ok(())
    }

    fn rig(&self) -> spindoe::Result<Rig> {
        let k = Intrinsics::pinhole(
            FOCAL_PX,
            FOCAL_PX,
            0.5 * (SIZE[0] as f64 - 1.0),
            0.5 * (SIZE[1] as f64 - 1.0),
        );
        // The second camera is the first one turned about the y axis through the place where the axes meet.
        let rotation = Rotation::from_scaled_axis(Vec3::y() * self.angle_deg.to_radians());
        let middle = Vec3::new(0.0, 0.0, DISTANCE_M);
        let second = Extrinsics {
            rotation,
            translation_m: middle - rotation * middle,
        };
        Rig::new(vec![
            RigCamera::new("left", k, Some(SIZE), Extrinsics::default()),
            RigCamera::new("right", k, Some(SIZE), second),
        ])
    }

    /// The scene of a clip.
    fn scene(&self) -> SynthConfig {
        let config = match self.all {
            true => SynthConfig::default(),
            false => SynthConfig::good(),
        };
        match self.exact {
            true => SynthConfig {
                placement_sigma_rad: [0.0; 2],
                ..config
            },
            false => config,
        }
    }

    fn clip(&self, pattern: &Pattern, rig: &Rig, seed: u64) -> spindoe::Result<(Vec<Seen>, usize)> {
        let config = self.scene();
        let clip = ClipConfig {
            fps: 350.0,
            ..ClipConfig::default()
        };
        let sequence =
            RigSequence::random(pattern, &config, &clip, rig, RADIUS_M, seed, self.frames)?;
        let mut images: [Vec<RgbImage>; 2] = Default::default();
        let mut truths = Vec::new();
        for k in 0..self.frames {
            for (camera, own) in images.iter_mut().enumerate() {
                let frame = sequence.frame(camera, k)?;
                own.push(frame.image);
                if camera == 0 {
                    truths.push(frame.truth.camera_orientation());
                }
            }
        }
        let views = images
            .each_ref()
            .map(|own| own.iter().map(ImageView::from).collect::<Vec<_>>());
        let times: Vec<f64> = (0..self.frames).map(|k| k as f64 / clip.fps).collect();
        let estimators = estimators(pattern, rig)?;
        let mut clips = clips(&estimators, &views, &times);
        let alone: Vec<Vec<FrameEstimate>> = clips.iter().map(|c| c.frames.clone()).collect();
        let config = RigConfig {
            sequence: SequenceConfig::default(),
            independent: false,
            min_confidence: EstimatorConfig::default().min_confidence,
        };
        let Ok(outcome) = combine(rig, &config, &mut clips, |camera, numbers, work| {
            held_images(&estimators[camera], &views[camera])(numbers, work)
        })?;
        let to_rig = [0, 1].map(|k| rig.cameras()[k].to_rig());
        let seen = |(k, frame): (usize, &RigFrame)| {
            let center = sequence.center_m(k);
            let off = |estimate: &FrameEstimate, to_rig: &Extrinsics| {
                let pose = estimate.pose()?;
                let turn = (to_rig.rotation * pose.rotation).angle_to(&truths[k]);
                let place = to_rig.apply(&pose.position?.center_m);
                Some([turn.to_degrees(), 1e3 * (place - center).norm()])
            };
            Seen {
                alone: [0, 1].map(|c| off(&alone[c][k], &to_rig[c])),
                fused: off(&frame.estimate, &Extrinsics::default()),
                cameras: frame.cameras,
                fusion: frame.fusion,
            }
        };
        debug_assert_eq!(
            outcome.orientations(CameraFrame::Camera).rows.len(),
            self.frames
        );
        let doubts = outcome.doubts.len();
        let seen = outcome.frames.iter().enumerate().map(seen);
        Ok((seen.collect(), doubts))
    }
}

/// Each camera's.
fn estimators(pattern: &Pattern, rig: &Rig) -> spindoe::Result<Vec<Estimator>> {
    let of_camera = |camera: &RigCamera| {
        let config = EstimatorConfig {
            camera: Camera::Perspective(camera.calibration.intrinsics).into(),
            ball_radius_m: Some(RADIUS_M),
            ..EstimatorConfig::default()
        };
        Estimator::new(pattern, config, DetectorName::Cnn.build()?)
    };
    rig.cameras().iter().map(of_camera).collect()
}

/// Each camera's clip by itself.
fn clips<'a>(
    estimators: &'a [Estimator],
    views: &[Vec<ImageView<'_>>],
    times: &[f64],
) -> Vec<CameraClip<'a>> {
    let clips = estimators.iter().zip(views).map(|(estimator, views)| {
        let Ok((frames, _)) = estimate_passes(
            estimator,
            &SequenceConfig::default(),
            &Prior::default(),
            views.len(),
            Some(times),
            held_images(estimator, views),
        );
        CameraClip {
            estimator,
            names: Vec::new(),
            times_s: Some(times.to_vec()),
            frames,
        }
    });
    clips.collect()
}

fn say_answers(seen: &[&Seen]) {
    let table = Table::new(["", "answered", "wrong by more than 20 deg"]);
    let add = |name: &str, found: Vec<Option<[f64; 2]>>| {
        let answered = found.iter().flatten().count() as u64;
        let wrong = found.iter().flatten().filter(|e| e[0] > WRONG_DEG).count() as u64;
        row!(
            table;
            name,
            Proportion::new(answered, found.len() as u64),
            Proportion::new(wrong, answered.max(1))
        );
    };
    let alone = seen.iter().flat_map(|s| s.alone).collect();
    add("one camera", alone);
    add("both", seen.iter().map(|s| s.fused).collect());
    let of = |is: &dyn Fn(&Fusion) -> bool| seen.iter().filter(|s| is(&s.fusion)).count() as u64;
    let both = of(&|f| matches!(f, Fusion::Fused { .. }));
    let apart = of(&|f| matches!(f, Fusion::Chosen { .. } | Fusion::Disagreed { .. }));
    println!(
        "times at which both have an orientation and disagree: {}",
        Proportion::new(apart, (both + apart).max(1))
    );
}

fn say_errors(seen: &[&Seen]) {
    // Of the times that both have answered right, so that all errors are of the same frames.
    let both = seen.iter().filter_map(|s| {
        let [a, b] = s.alone;
        let (a, b, fused) = (a?, b?, s.fused?);
        let right = [a, b].iter().all(|e| e[0] < WRONG_DEG) && s.cameras == 2;
        right.then_some((a, b, fused))
    });
    let both: Vec<_> = both.collect();
    let table = Table::new([
        "of the times that both answer",
        "one camera",
        "fused",
        "ratio",
    ]);
    for (name, at, digits) in [("orientation, deg", 0, 3), ("position, mm", 1, 3)] {
        let mut one: Vec<f64> = both.iter().flat_map(|(a, b, _)| [a[at], b[at]]).collect();
        let mut fused: Vec<f64> = both.iter().map(|(_, _, f)| f[at]).collect();
        let rms = |e: &[f64]| (e.iter().map(|x| x * x).sum::<f64>() / e.len() as f64).sqrt();
        for values in [&mut one, &mut fused] {
            values.sort_by(f64::total_cmp);
        }
        let middle = |e: &[f64]| quantile(e, 0.5);
        for (what, f) in [
            ("root mean square", &rms as &dyn Fn(&[f64]) -> f64),
            ("median", &middle),
        ] {
            let (a, b) = (f(&one), f(&fused));
            row!(
                table;
                format!("{name}, {what}"),
                figure(a, digits, ""),
                figure(b, digits, ""),
                figure(b / a, 2, "")
            );
        }
    }
    let mut chi2: Vec<f64> = seen
        .iter()
        .filter_map(|s| match s.fusion {
            Fusion::Fused { chi2, .. } => Some(chi2),
            _ => None,
        })
        .collect();
    chi2.sort_by(f64::total_cmp);
    println!(
        "{} times of both; median chi2 of 6 degrees of freedom {:.2} (5.35 is right)",
        both.len(),
        quantile(&chi2, 0.5)
    );
}
