//! Orientations of painted balls, on rendered clips. The tables of docs/measurements/painted.md come from here.
//!
//!     cargo run --release -p spindoe-studies -- painted --help
//!
//! The clips are those of `spindoe_studies::painted`. Errors are relative to the first frame with a pose; a pose is *wrong* where it is
//! more than 10 deg off. *Chained* are the same frames two at a time, each pair's turn upon the turns before it: what following from frame
//! to frame gives. *Again* is a second clip of the same ball on the surface of the first, each frame alone; *live* the same frames as they come.

use std::sync::Arc;

use nalgebra::Matrix3;
use rayon::prelude::*;
use spindoe::clip::{PaintedEstimator, PaintedStream, TrackerConfig};
use spindoe::geometry::{Rotation, rotation_angle};
use spindoe::spin::robust::SpinConfig;
use spindoe::surface::{PaintedFrame, PaintedPose, PaintedPoses, PaintedTracker, SurfaceMap};
use spindoe::synth::Rendering;
use spindoe::validate::Proportion;
use spindoe::vision::frame::{CameraModel, OutlineMethod};
use spindoe::vision::optics::camera::Camera;
use spindoe::vision::outline::find::OutlineFinder;
use spindoe::vision::{CircleConfig, FrameEstimate, Outline, Prior};
use spindoe::{Measurement, SpinEstimator};
use spindoe_studies::Outcome;
use spindoe_studies::painted::{Handling, PaintedClip};

/// A pose is wrong beyond so many degrees.
const WRONG_DEG: f64 = 10.0;
/// The balls' radius, m: no camera's intrinsics are known.
const RADIUS_M: f64 = 0.02;
/// Marks the second clip of a ball.
const AGAIN: u64 = 77;

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Clips of each kind.
    #[arg(long, default_value_t = 20)]
    clips: u64,
    /// Seed of the clips.
    #[arg(long, default_value_t = 35_400_001)]
    seed: u64,
    /// Only clips of this kind.
    #[arg(long, value_enum)]
    only: Option<Handling>,
    /// The camera's distance is not given.
    #[arg(long)]
    unknown_distance: bool,
    /// True outlines instead of those that are found.
    #[arg(long)]
    true_outlines: bool,
    /// Without the chained pairs, which take longest.
    #[arg(long)]
    no_chain: bool,
    /// Clips each of whose frames shows another ball, in the place of the others: every pose beyond the first is wrong.
    #[arg(long)]
    unrelated: bool,
    /// A line for every clip.
    #[arg(long)]
    each: bool,
}

/// A clip as it is seen.
struct Seen {
    frames: Vec<PaintedFrame>,
    truth: Vec<Rotation>,
    camera: CameraModel,
}

/// What became of one or of many clips.
#[derive(Default)]
struct Judged {
    frames: u64,
    posed: u64,
    wrong: u64,
    errors_deg: Vec<f64>,
    ends_deg: Vec<f64>,
    /// Squared errors about one constant turn, over their covariances.
    chi2: Vec<f64>,
    chained_deg: Vec<f64>,
    chained_ends_deg: Vec<f64>,
    again: Placed,
    live: Placed,
    /// Of the stream's frames.
    live_milliseconds: f64,
    spins_percent: Vec<f64>,
    milliseconds: f64,
}

/// Frames of a second clip on the surface of the first.
#[derive(Default)]
struct Placed {
    frames: u64,
    posed: u64,
    wrong: u64,
    errors_deg: Vec<f64>,
}

impl Placed {
    /// Takes a frame, with its pose if it has one and the truth in the frame of the surface.
    fn take(&mut self, pose: Option<&PaintedPose>, truth: &Rotation) {
        self.frames += 1;
        if let Some(pose) = pose {
            let off = rotation_angle(&pose.rotation, truth).to_degrees();
            self.posed += 1;
            self.wrong += u64::from(off > WRONG_DEG);
            self.errors_deg.push(off);
        }
    }

    fn join(&mut self, other: Self) {
        self.frames += other.frames;
        self.posed += other.posed;
        self.wrong += other.wrong;
        self.errors_deg.extend(other.errors_deg);
    }

    fn say(&self, name: &str) {
        let (posed, frames) = (self.posed, self.frames.max(1));
        println!("  {name}, with a pose: {}", Proportion::new(posed, frames));
        let wrong = Proportion::new(self.wrong, posed.max(1));
        println!("  {name}, wrong: {wrong}");
        println!("  {name}, error: {} deg", middle_and_most(&self.errors_deg));
    }
}

impl Args {
    pub fn run(&self) -> Outcome {
        if self.unrelated {
            return self.run_unrelated();
        }
        let asked = |handling: &Handling| self.only.is_none_or(|only| only == *handling);
        for handling in Handling::ALL.into_iter().filter(asked) {
            let clips = 0..self.clips;
            let judged: Result<Vec<Judged>, String> = clips
                .into_par_iter()
                .map(|k| self.one(handling, k).map_err(|e| e.to_string()))
                .collect();
            let mut all = Judged::default();
            for (k, one) in judged?.into_iter().enumerate() {
                if self.each {
                    println!("{} {k}:", handling.words());
                    one.say();
                }
                all.join(one);
            }
            println!("{}, {} clips:", handling.words(), self.clips);
            all.say();
        }
        Ok(())
    }

    fn run_unrelated(&self) -> Outcome {
        let one = |k: u64| -> Result<[u64; 2], String> {
            let clip = PaintedClip::unrelated(self.seed, k).map_err(|e| e.to_string())?;
            let seen = self.see(&clip).map_err(|e| e.to_string())?;
            let track = PaintedTracker::new(&seen.camera).track(&seen.frames);
            let posed = track.poses.iter().flatten().count() as u64;
            Ok([posed.saturating_sub(1), u64::from(posed > 1)])
        };
        let found: Result<Vec<[u64; 2]>, String> =
            (0..self.clips).into_par_iter().map(one).collect();
        let found = found?;
        let (mut poses, mut answered) = (0, 0);
        for [more, is_answered] in found {
            (poses, answered) = (poses + more, answered + is_answered);
        }
        println!(
            "unrelated frames, answered: {}, {poses} poses beyond the first",
            Proportion::new(answered, self.clips)
        );
        Ok(())
    }

    fn one(&self, handling: Handling, k: u64) -> Outcome<Judged> {
        let clip = PaintedClip::random(handling, self.seed, k, 0)?;
        let seen = self.see(&clip)?;
        let tracker = PaintedTracker::new(&seen.camera);
        let clock = cpu_time::ThreadTime::now();
        let track = tracker.track(&seen.frames);
        let mut judged = Judged {
            milliseconds: 1e3 * clock.elapsed().as_secs_f64(),
            ..Judged::default()
        };
        let Some(first) = track.poses.iter().position(Result::is_ok) else {
            judged.frames = seen.frames.len() as u64;
            return Ok(judged);
        };
        let base = seen.truth[first].inverse();
        judged.take(&track.poses, &seen.truth, &base);
        if let Some(spin) = clip.spin {
            judged
                .spins_percent
                .extend(spin_error(&clip, &track.poses, &spin));
        }
        if !self.no_chain {
            judged.chain(&tracker, &seen);
        }
        let second = PaintedClip::random(handling, self.seed, k, AGAIN)?;
        let again = self.see(&second)?;
        let poses = tracker.place(&again.frames, &track.surface);
        for (pose, truth) in poses.iter().zip(&again.truth) {
            judged.again.take(pose.as_ref().ok(), &(truth * base));
        }
        judged.follow(&second, &again.camera, track.surface, &base)?;
        Ok(judged)
    }

    fn see(&self, clip: &PaintedClip) -> Outcome<Seen> {
        let camera = CameraModel::default();
        let finder =
            OutlineFinder::new(CircleConfig::default(), OutlineMethod::default(), &camera)?;
        let mut workspace = finder.workspace();
        let mut seen = Seen {
            frames: Vec::new(),
            truth: Vec::new(),
            camera: CameraModel::default(),
        };
        clip.show(|shown| {
            seen.camera = self.camera(shown);
            let outline = if self.true_outlines {
                Some(Outline::given(shown.circle, Matrix3::zeros()))
            } else {
                let mut found = FrameEstimate::default();
                let prior = Prior::default();
                finder.find(&shown.image, &prior, &mut workspace, &mut found);
                found.outline
            };
            let taken = outline.map(|o| PaintedFrame::take(&shown.image, &o));
            seen.frames.push(taken.unwrap_or_default());
            seen.truth.push(shown.rotation);
        })?;
        Ok(seen)
    }

    /// Balls are seen near the axis: the view frame is the truth's.
    fn camera(&self, shown: &Rendering) -> CameraModel {
        match self.unknown_distance {
            true => CameraModel::default(),
            false => CameraModel::Known(Camera::Near {
                inverse_distance: shown.distance.map_or(0.0, |d| 1.0 / d),
            }),
        }
    }
}

/// The error of the spin of a ball in flight over its size, percent.
fn spin_error(clip: &PaintedClip, poses: &PaintedPoses, truth: &spindoe::Vec3) -> Option<f64> {
    let timed = poses.iter().enumerate();
    let measured: Vec<Measurement> = timed
        .filter_map(|(k, pose)| {
            let pose = pose.as_ref().ok()?;
            Some(Measurement::new(k as f64 / clip.fps, pose.rotation))
        })
        .collect();
    let fit = SpinEstimator::new(SpinConfig::default())
        .fit(&measured)
        .ok()?;
    Some(100.0 * (fit.motion.spin - truth).norm() / truth.norm())
}

impl Judged {
    fn take(&mut self, poses: &PaintedPoses, truth: &[Rotation], base: &Rotation) {
        let mut sum = Matrix3::zeros();
        let both = poses.iter().zip(truth);
        let posed = both.filter_map(|(pose, truth)| Some((pose.as_ref().ok()?, truth)));
        for (pose, truth) in posed.clone() {
            let off = rotation_angle(&pose.rotation, &(truth * base)).to_degrees();
            self.posed += 1;
            self.wrong += u64::from(off > WRONG_DEG);
            self.errors_deg.push(off);
            sum += (pose.rotation.inverse() * truth)
                .to_rotation_matrix()
                .matrix();
        }
        self.frames += truth.len() as u64;
        self.ends_deg.extend(self.errors_deg.last());
        // One constant turn takes the error of the first frame off all others.
        let constant = Rotation::from_matrix(&sum);
        for (pose, truth) in posed {
            let off = (truth * (pose.rotation * constant).inverse()).scaled_axis();
            if let Some(root) = pose.covariance.cholesky() {
                self.chi2.push(off.dot(&root.solve(&off)) / 3.0);
            }
        }
    }

    /// The frames of a clip as they come.
    fn follow(
        &mut self,
        clip: &PaintedClip,
        camera: &CameraModel,
        surface: SurfaceMap,
        base: &Rotation,
    ) -> Outcome {
        let estimator = PaintedEstimator::new(camera, OutlineMethod::default(), RADIUS_M)?;
        let config = TrackerConfig::default();
        let mut stream = PaintedStream::new(Arc::new(estimator), surface, config)?;
        let mut number = 0;
        clip.show(|shown| {
            let clock = cpu_time::ThreadTime::now();
            let time_s = f64::from(number) / clip.fps;
            if let Ok(state) = stream.update(&shown.image, time_s, None) {
                let pose = state.pose.as_ref().ok();
                self.live.take(pose, &(shown.rotation * base));
            }
            self.live_milliseconds += 1e3 * clock.elapsed().as_secs_f64();
            number += 1;
        })?;
        Ok(())
    }

    fn chain(&mut self, tracker: &PaintedTracker, seen: &Seen) {
        let mut rotation = Rotation::identity();
        let base = seen.truth[0].inverse();
        let mut last = None;
        for k in 1..seen.frames.len() {
            let poses = tracker.track(&seen.frames[k - 1..=k]).poses;
            if let [Ok(one), Ok(two)] = poses[..] {
                rotation = two.rotation * one.rotation.inverse() * rotation;
            }
            let off = rotation_angle(&rotation, &(seen.truth[k] * base)).to_degrees();
            self.chained_deg.push(off);
            last = Some(off);
        }
        self.chained_ends_deg.extend(last);
    }

    fn join(&mut self, one: Self) {
        self.frames += one.frames;
        self.posed += one.posed;
        self.wrong += one.wrong;
        self.errors_deg.extend(one.errors_deg);
        self.ends_deg.extend(one.ends_deg);
        self.chi2.extend(one.chi2);
        self.chained_deg.extend(one.chained_deg);
        self.chained_ends_deg.extend(one.chained_ends_deg);
        self.again.join(one.again);
        self.live.join(one.live);
        self.live_milliseconds += one.live_milliseconds;
        self.spins_percent.extend(one.spins_percent);
        self.milliseconds += one.milliseconds;
    }

    fn say(&self) {
        println!(
            "  with a pose: {}",
            Proportion::new(self.posed, self.frames)
        );
        println!(
            "  wrong: {}",
            Proportion::new(self.wrong, self.posed.max(1))
        );
        println!("  error: {} deg", middle_and_most(&self.errors_deg));
        println!("  at the end: {} deg", middle_and_most(&self.ends_deg));
        println!(
            "  chi2 / 3 by the covariance: {}",
            middle_and_most(&self.chi2)
        );
        println!("  chained: {} deg", middle_and_most(&self.chained_deg));
        println!(
            "  chained, at the end: {} deg",
            middle_and_most(&self.chained_ends_deg)
        );
        self.again.say("again");
        self.live.say("live");
        println!("  spin: {} %", middle_and_most(&self.spins_percent));
        println!(
            "  {:.1} ms a frame",
            self.milliseconds / self.frames.max(1) as f64
        );
        println!(
            "  live, {:.1} ms a frame",
            self.live_milliseconds / self.live.frames.max(1) as f64
        );
    }
}

fn middle_and_most(values: &[f64]) -> String {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |q: f64| spindoe::stats::quantile(&sorted, q);
    match values {
        [] => "none".to_owned(),
        _ => format!("median {:.2}, 95 % below {:.2}", at(0.5), at(0.95)),
    }
}
