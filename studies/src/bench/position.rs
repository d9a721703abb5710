//! Whether the covariance of a ball's center says how well it is known: balls of 40 mm, 0.4 to 3 m away, on the axis of a camera and off
//! it, without distortion and with it, each frame alone.
//!
//!     cargo run --release -p spindoe-studies -- position --help

use std::f64::consts::TAU;

use nalgebra::{Matrix6, Vector6};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::Vec3;
use spindoe::pattern::Pattern;
use spindoe::stats::Proportion;
use spindoe::synth::SynthConfig;
use spindoe::synth::config::SynthKind;
use spindoe::synth::dataset::SynthSequence;
use spindoe::synth::scene::Scene;
use spindoe::vision::{
    Budget, Camera, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Intrinsics, Lens,
    Prior,
};
use spindoe_studies::frames::DOTS20;
use spindoe_studies::pictures::seen_through;
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

/// Focal length of the camera, pixels: 50 degrees along 1300 of them.
const FOCAL_PX: f64 = 1400.0;
/// The ball's radius, m.
const RADIUS_M: f64 = 0.02;
/// Distances, m.
const FAR_M: [f64; 2] = [0.4, 3.0];
const BINS_M: [f64; 5] = [0.4, 0.7, 1.2, 2.0, 3.0];
/// Coefficients of the lens.
const LENS: [f64; 5] = [-0.28, 0.08, 0.001, -0.0005, 0.0];
/// A center that is off by more than this part of the distance is that of something else.
const GROSS: f64 = 0.1;
/// 95 % of chi-squared lie below, of three degrees of freedom and of six.
const WITHIN: [f64; 2] = [7.815, 12.592];

#[derive(clap::Args)]
pub struct Args {
    /// Frames.
    #[arg(long, default_value_t = 300)]
    frames: u64,
    /// Seed of the first frame.
    #[arg(long, default_value_t = 65_100_001)]
    seed: u64,
    /// Greatest angle of a ball off the axis, degrees.
    #[arg(long, default_value_t = 24.0)]
    off_axis_deg: f64,
    /// All conditions instead of good ones.
    #[arg(long)]
    all: bool,
    /// Balls without dots: the orientation is rejected, and the outline stands.
    #[arg(long)]
    dotless: bool,
    /// Through a lens that distorts.
    #[arg(long)]
    lens: bool,
}

/// A frame's center.
struct Found {
    distance_m: f64,
    is_posed: bool,
    /// Error along the ray and across it, m, and both over their deviations.
    along_m: f64,
    across_m: f64,
    along: f64,
    across: f64,
    chi2: f64,
    /// Of center and orientation together.
    joint_chi2: Option<f64>,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        let found: Vec<Option<Found>> = (0..self.frames)
            .into_par_iter()
            .map(|k| self.frame(&pattern, self.seed + k))
            .collect::<spindoe::Result<_>>()?;
        let none = found.iter().filter(|f| f.is_none()).count();
        println!(
            "{} frames, seed {}, up to {} deg off the axis, {} conditions{}{}; {none} without an outline",
            self.frames,
            self.seed,
            self.off_axis_deg,
            if self.all { "all" } else { "good" },
            if self.lens { ", through a lens" } else { "" },
            if self.dotless { ", without dots" } else { "" },
        );
        let found: Vec<Found> = found.into_iter().flatten().collect();
        let table = Table::new([
            "orientation",
            "distance, m",
            "frames",
            "chi2 of the center within 95 %",
            "of center and orientation",
            "off by a tenth",
            "across, mm",
            "along, mm",
            "across, deviations",
            "along, deviations",
        ]);
        for (name, is_posed) in [("accepted", true), ("rejected", false)] {
            let bins = BINS_M.windows(2).map(|ends| [ends[0], ends[1]]);
            for [low, high] in bins.chain([[0.9 * FAR_M[0], 1.1 * FAR_M[1]]]) {
                let some: Vec<&Found> = found
                    .iter()
                    .filter(|f| f.is_posed == is_posed && (low..high).contains(&f.distance_m))
                    .collect();
                if !some.is_empty() {
                    let bin = match high > FAR_M[1] {
                        true => "all".to_owned(),
                        false => format!("{low} to {high}"),
                    };
                    add_row(&table, name, bin, &some);
                }
            }
        }
        Ok(())
    }

    /// The center that a frame gives, against the truth; `None` without an outline.
    fn frame(&self, pattern: &Pattern, seed: u64) -> spindoe::Result<Option<Found>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let distance = FAR_M[0] * (FAR_M[1] / FAR_M[0]).powf(rng.random());
        let tan = (self.off_axis_deg.to_radians() * rng.random::<f64>()).tan();
        let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
        let radius = FOCAL_PX * tan.hypot(1.0) * (RADIUS_M / distance).asin().tan();
        let base = match self.all {
            true => SynthConfig::default(),
            false => SynthConfig::good(),
        };
        let config = SynthConfig {
            kind: match self.dotless {
                true => SynthKind::Dotless,
                false => SynthKind::Dotted,
            },
            ball_px: Some([2.0 * radius; 2]),
            fill: [0.55, 0.7],
            cut_share: 0.0,
            parallel_share: 0.0,
            ..base
        };
        let mut scene = Scene::random(pattern, &config, &mut rng)?;
        let seen = scene.circle.center;
        let (u, v) = (FOCAL_PX * tan * cos, FOCAL_PX * tan * sin);
        let pinhole = Intrinsics::pinhole(FOCAL_PX, FOCAL_PX, seen.u - u, seen.v - v);
        scene.camera = Camera::Perspective(pinhole);
        // As the scene has it, whose crop is of whole pixels: a sphere touches the cone of the half angle `asin(R / d)`.
        let ray = Vec3::new(tan * cos, -tan * sin, -1.0);
        let half = (scene.circle.radius / (FOCAL_PX * ray.norm())).atan();
        let truth = ray.normalize() * (RADIUS_M / half.sin());
        let frame = SynthSequence::of_scene(scene, 100.0, seed, 1).frame(0)?;
        let (k, image) = match self.lens {
            false => (pinhole, frame.image),
            true => {
                let lens = Lens::polynomial(&LENS)?;
                let at = Intrinsics { lens, ..pinhole }.project(&ray);
                let k = Intrinsics {
                    cx: pinhole.cx + seen.u - at.u,
                    cy: pinhole.cy + seen.v - at.v,
                    lens,
                    ..pinhole
                };
                (k, seen_through(&frame.image, &pinhole, &k)?)
            }
        };
        let config = EstimatorConfig {
            camera: Camera::Perspective(k).into(),
            ball_radius_m: Some(RADIUS_M),
            ..EstimatorConfig::default()
        };
        let estimator = Estimator::new(pattern, config, DetectorName::Cnn.build()?)?;
        let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
        estimator.estimate(
            &image,
            &Prior::default(),
            &Budget::default(),
            &mut ws,
            &mut out,
        );
        let turned = frame.truth.camera_orientation();
        let off = out
            .pose()
            .map(|pose| (turned * pose.rotation.inverse()).scaled_axis());
        Ok(Found::of(&out, &truth, off))
    }
}

impl Found {
    fn of(out: &FrameEstimate, truth: &Vec3, turn: Option<Vec3>) -> Option<Self> {
        let position = out.position()?;
        let off = truth - position.center_m;
        let ray = truth.normalize();
        let along_m = off.dot(&ray);
        let across_m = (off - ray * along_m).norm();
        let variance = ray.dot(&(position.covariance * ray));
        let rest = 0.5 * (position.covariance.trace() - variance);
        let inverse = position.covariance.try_inverse()?;
        let joint_chi2 = out.pose().zip(turn).and_then(|(pose, turn)| {
            let mut joint = Matrix6::zeros();
            let both = position.with_rotation?;
            joint
                .fixed_view_mut::<3, 3>(0, 0)
                .copy_from(&position.covariance);
            joint
                .fixed_view_mut::<3, 3>(3, 3)
                .copy_from(&pose.covariance);
            joint.fixed_view_mut::<3, 3>(0, 3).copy_from(&both);
            joint
                .fixed_view_mut::<3, 3>(3, 0)
                .copy_from(&both.transpose());
            let off = Vector6::new(off.x, off.y, off.z, turn.x, turn.y, turn.z);
            Some(off.dot(&(joint.try_inverse()? * off)))
        });
        Some(Self {
            distance_m: truth.norm(),
            is_posed: out.pose().is_some(),
            along_m,
            across_m,
            along: along_m / variance.sqrt(),
            across: across_m / (2.0 * rest).sqrt(),
            chi2: off.dot(&(inverse * off)),
            joint_chi2,
        })
    }
}

fn add_row(table: &Table, name: &str, bin: String, some: &[&Found]) {
    let within = |chi2: Vec<f64>, most: f64| {
        let within = chi2.iter().filter(|x| **x < most).count();
        Proportion::new(within as u64, chi2.len() as u64)
    };
    let is_near = |f: &&&Found| f.along_m.hypot(f.across_m) <= GROSS * f.distance_m;
    let near: Vec<&&Found> = some.iter().filter(is_near).collect();
    let root = |value: fn(&Found) -> f64| {
        let squares: f64 = near.iter().map(|f| value(f).powi(2)).sum();
        (squares / near.len() as f64).sqrt()
    };
    // Half of the square across is along either axis.
    let axis = 0.5f64.sqrt();
    row!(
        table;
        name,
        bin,
        some.len(),
        within(some.iter().map(|f| f.chi2).collect(), WITHIN[0]),
        within(some.iter().filter_map(|f| f.joint_chi2).collect(), WITHIN[1]),
        some.len() - near.len(),
        figure(1e3 * axis * root(|f| f.across_m), 3, ""),
        figure(1e3 * root(|f| f.along_m), 2, ""),
        figure(root(|f| f.across), 2, ""),
        figure(root(|f| f.along), 2, "")
    );
}
