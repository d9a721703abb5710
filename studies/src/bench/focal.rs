//! Do a ball's outlines contradict the camera's intrinsics? Clips of a ball that crosses the picture or stays at a place of it, by
//! cameras of several fields of view, without distortion and with it, by the right intrinsics and by wrong ones.
//!
//!     cargo run --release -p spindoe-studies -- focal --help

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::Vec3;
use spindoe::clip::{FocalDoubt, SeenOval, focal_doubt};
use spindoe::geometry::Rotation;
use spindoe::image::RgbImage;
use spindoe::pattern::Pattern;
use spindoe::stats::Proportion;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::SynthSequence;
use spindoe::synth::scene::Scene;
use spindoe::vision::frame::CameraModel;
use spindoe::vision::{
    BallCircle, Budget, Camera, DetectorName, Estimator, EstimatorConfig, FrameEstimate,
    Intrinsics, Lens, OutlinePrior, Pixel, Prior,
};
use spindoe_studies::frames::DOTS20;
use spindoe_studies::pictures::seen_through;
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// Columns and rows of the pictures.
const SIZE: [usize; 2] = [640, 480];
/// Fields of view along the columns, degrees.
const FIELDS_DEG: [f64; 4] = [30.0, 50.0, 70.0, 90.0];
/// Diameters of the balls, pixels.
const BALL_PX: [f64; 2] = [40.0, 200.0];
const FPS: f64 = 120.0;
/// Standard deviation of where the ball is looked for, radii.
const NEAR: f64 = 0.1;
/// Greatest angles off the axis of the table's lines, degrees.
const BINS_DEG: [f64; 6] = [5.0, 10.0, 15.0, 20.0, 30.0, 60.0];

#[derive(clap::Args)]
pub struct Args {
    /// Clips.
    #[arg(long, default_value_t = 40)]
    clips: u64,
    /// Frames of a clip.
    #[arg(long, default_value_t = 12)]
    frames: usize,
    /// Seed of the first clip.
    #[arg(long, default_value_t = 60_100_001)]
    seed: u64,
    /// With the right intrinsics alone.
    #[arg(long)]
    right: bool,
    /// Prints each outline: field of view, angle off the axis, radius, way, stretch that the lens gives, what is beyond it and its deviation.
    #[arg(long)]
    outlines: bool,
}

/// What is given in place of the right intrinsics.
const GIVEN: [(&str, f64, f64); 7] = [
    ("right", 1.0, 1.0),
    ("f x 0.5", 0.5, 1.0),
    ("f x 2", 2.0, 1.0),
    ("K x 0.5", 0.5, 0.5),
    ("K x 2", 2.0, 2.0),
    ("f x 0.67", 0.67, 1.0),
    ("f x 1.5", 1.5, 1.0),
];

/// A camera's clip.
struct Clip {
    k: Intrinsics,
    images: Vec<RgbImage>,
    /// The ball's place in each, and its way to the next, over the picture's rows.
    circles: Vec<BallCircle>,
    rolling: f64,
    off_deg: f64,
    words: String,
}

/// What a clip's outlines say.
struct Judged {
    /// The greatest angle off the axis, degrees.
    off_deg: f64,
    /// Of each of the intrinsics.
    doubts: Vec<Option<FocalDoubt>>,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        println!(
            "{} clips of {} frames of {} x {}, seed {}, balls of {} to {} px",
            self.clips, self.frames, SIZE[0], SIZE[1], self.seed, BALL_PX[0], BALL_PX[1]
        );
        let given = if self.right { 1 } else { GIVEN.len() };
        let judged: Vec<Judged> = (0..self.clips)
            .into_par_iter()
            .map(|k| self.judged(&pattern, self.seed + k, given))
            .collect::<spindoe::Result<_>>()?;
        if self.outlines {
            return Ok(());
        }
        let table = Table::new([
            "intrinsics",
            "ball off the axis, up to",
            "clips",
            "contradicted",
        ]);
        for (which, (name, ..)) in GIVEN.iter().enumerate().take(given) {
            let mut low = 0.0;
            for high in BINS_DEG {
                let some = judged.iter().filter(|j| (low..high).contains(&j.off_deg));
                let some: Vec<_> = some.map(|j| j.doubts[which]).collect();
                low = high;
                if some.is_empty() {
                    continue;
                }
                let said = some.iter().filter(|doubt| doubt.is_some()).count();
                let rate = Proportion::new(said as u64, some.len() as u64);
                row!(table; *name, format!("{high:.0} deg"), some.len(), rate);
            }
        }
        Ok(())
    }

    /// The greatest angle off the axis of a clip, and what its outlines say of each of the intrinsics.
    fn judged(&self, pattern: &Pattern, seed: u64, given: usize) -> spindoe::Result<Judged> {
        let clip = self.clip(pattern, seed)?;
        let mut doubts = Vec::new();
        for (name, focal, whole) in &GIVEN[..given] {
            let k = Intrinsics {
                fx: clip.k.fx * focal,
                fy: clip.k.fy * focal,
                cx: (clip.k.cx + 0.5) * whole - 0.5,
                cy: (clip.k.cy + 0.5) * whole - 0.5,
                ..clip.k
            };
            let config = EstimatorConfig {
                camera: CameraModel::Known(Camera::Perspective(k)),
                ..EstimatorConfig::default()
            };
            let estimator = Estimator::new(pattern, config, DetectorName::Cnn.build()?)?;
            let (seen, posed) = self.ovals(&estimator, &clip, &k, seed);
            if self.outlines {
                println!(
                    "seed {seed} {name} {}: radius {:.0}, {:.0} deg, {posed} poses, {} outlines",
                    clip.words,
                    clip.circles[0].radius,
                    clip.off_deg,
                    seen.len()
                );
            }
            let doubt = focal_doubt(&k, &seen);
            if let (Some(doubt), "right") = (&doubt, *name) {
                println!("seed {seed}, {}: {doubt}", clip.words);
            }
            doubts.push(doubt);
        }
        Ok(Judged {
            off_deg: clip.off_deg,
            doubts,
        })
    }

    /// How far outlines are drawn out in the frames of a clip that have a pose, and how many those are.
    fn ovals(
        &self,
        estimator: &Estimator,
        clip: &Clip,
        k: &Intrinsics,
        seed: u64,
    ) -> (Vec<SeenOval>, usize) {
        let mut ws = estimator.workspace();
        let (mut seen, mut posed) = (Vec::new(), 0);
        for (image, circle) in clip.images.iter().zip(&clip.circles) {
            // What is sought is not whether the ball is found.
            let prior = Prior {
                outline: Some(OutlinePrior {
                    sigma_px: NEAR * circle.radius,
                    ..OutlinePrior::given(*circle)
                }),
                ..Prior::default()
            };
            let (mut found, budget) = (FrameEstimate::default(), Budget::default());
            estimator.estimate(image, &prior, &budget, &mut ws, &mut found);
            posed += usize::from(found.pose().is_some());
            let posed = found.pose();
            let one = posed.and_then(|_| SeenOval::of(&found, clip.rolling));
            if let (true, Some(one)) = (self.outlines, one) {
                let (s, c) = (one.oval.stretch_px, one.oval.covariance);
                let ray = k.ray(circle.center).map_or(0.0, |r| r.xy().norm().atan());
                println!(
                    "{seed} {} {:.1} {:.1} {:.3} {:.3} {:.3} {:.3}",
                    clip.words,
                    ray.to_degrees(),
                    one.circle.radius,
                    clip.rolling,
                    s.x,
                    s.y,
                    (0.5 * c.trace()).sqrt()
                );
            }
            seen.extend(one);
        }
        (seen, posed)
    }

    /// Where a ball is in the first frame, and its way to the next, pixels: it stays whole in the picture, and before the camera.
    fn path(&self, axis: Pixel, radius: f64, rng: &mut ChaCha8Rng) -> ([f64; 2], [f64; 2]) {
        let room = SIZE.map(|side| (0.5 * side as f64 - 1.3 * radius).max(1.0));
        let mut place =
            || [0, 1].map(|k| [axis.u, axis.v][k] + room[k] * rng.random_range(-1.0..1.0));
        let (from, to) = (place(), place());
        let crosses = rng.random_bool(0.6);
        let count = self.frames.max(2) as f64;
        let way = [0, 1].map(|k| (to[k] - from[k]) / (count - 1.0));
        (from, if crosses { way } else { [0.0; 2] })
    }

    fn clip(&self, pattern: &Pattern, seed: u64) -> spindoe::Result<Clip> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let field = FIELDS_DEG[rng.random_range(0..FIELDS_DEG.len())];
        let radius = 0.5 * BALL_PX[0] * (BALL_PX[1] / BALL_PX[0]).powf(rng.random());
        let [width, height] = SIZE.map(|side| side as f64);
        let focal = 0.5 * width / (0.5 * field.to_radians()).tan();
        let axis = Pixel {
            u: 0.5 * (width - 1.0) + rng.random_range(-12.0..12.0),
            v: 0.5 * (height - 1.0) + rng.random_range(-12.0..12.0),
        };
        let pinhole = Intrinsics::pinhole(focal, focal, axis.u, axis.v);
        let lens = match rng.random_range(0..3) {
            0 => Lens::polynomial(&[-0.28, 0.08, 0.001, -0.0005, 0.0])?,
            _ => Lens::Ideal,
        };
        let base = match rng.random_bool(0.5) {
            true => SynthConfig::default(),
            false => SynthConfig::good(),
        };
        let config = SynthConfig {
            image_px: Some(SIZE),
            ball_px: Some([2.0 * radius; 2]),
            cut_share: 0.0,
            parallel_share: 0.0,
            occlusion_share: 0.5 * base.occlusion_share,
            ..base
        };
        let mut scene = Scene::random(pattern, &config, &mut rng)?;
        scene.camera = Camera::Perspective(pinhole);
        let (from, way) = self.path(axis, radius, &mut rng);
        let rolls = rng.random_bool(0.4);
        scene.velocity_px_s = way.map(|w| w * FPS);
        scene.shift_px = way.map(|w| w * FPS * scene.exposure_s.min(1.0 / FPS));
        scene.row_s = match rolls {
            true => rng.random_range(0.3..1.0) / FPS / height,
            false => 0.0,
        };
        let k = Intrinsics { lens, ..pinhole };
        let turn = scene.spin.norm() / FPS;
        let axis_of_spin = scene.spin.try_normalize(1e-9).unwrap_or_else(Vec3::z);
        let (mut images, mut circles) = (Vec::new(), Vec::new());
        for frame in 0..self.frames {
            let t = frame as f64;
            let mut scene = scene.clone();
            let center = Pixel {
                u: from[0] + t * way[0],
                v: from[1] + t * way[1],
            };
            scene.circle = BallCircle::new(center, radius);
            let angle = (turn * t).rem_euclid(TAU);
            scene.rotation = Rotation::from_scaled_axis(axis_of_spin * angle) * scene.rotation;
            scene.noise_seed = rng.random();
            let ray = pinhole.ray(center).unwrap_or_else(|| -Vec3::z());
            circles.push(BallCircle::new(k.project(&ray), radius));
            let drawn = SynthSequence::of_scene(scene, FPS, seed, 1).frame(0)?.image;
            images.push(seen_through(&drawn, &pinhole, &k)?);
        }
        let off_axis = |c: &BallCircle| k.ray(c.center).map_or(0.0, |r| r.xy().norm().atan());
        let off_deg = circles
            .iter()
            .map(off_axis)
            .fold(0.0, f64::max)
            .to_degrees();
        Ok(Clip {
            rolling: 0.5 * way[0].hypot(way[1]) / height,
            words: format!(
                "{field:.0} {} {}",
                if lens == Lens::Ideal { "ideal" } else { "lens" },
                if rolls { "rolling" } else { "global" }
            ),
            k,
            images,
            circles,
            off_deg,
        })
    }
}
