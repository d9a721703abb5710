//! What a rolling shutter costs where it is ignored, and what its correction gains. The tables of docs/measurements/spin.md come from
//! here.
//!
//! Clips of a ball that crosses a picture of 1080 rows from top to bottom or back, at frame rates and readouts of phones: a readout is
//! no longer than the time between two frames. Three ways: *ignored*, the frames' times and poses as they come; *times*, those at which
//! the ball is seen; *times and rows*, the poses corrected, too, and the spin chosen by the rows. Errors of poses are against the
//! truth when the row of the ball's center is exposed.

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::camera::FrameOutcome;
use spindoe::clip::{
    NamedFrame, SequenceConfig, SequenceRows, estimate_sequence, orientations, seen_times,
};
use spindoe::geometry::{CameraFrame, Vec3, random_direction};
use spindoe::image::ImageView;
use spindoe::pattern::Pattern;
use spindoe::spin::alias::AliasConfig;
use spindoe::spin::estimate::{MotionModel, SpinEstimate};
use spindoe::spin::robust::SpinConfig;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, FrameTruth, SynthFrame, SynthSequence};
use spindoe::vision::frame::CameraModel;
use spindoe::vision::{DetectorName, DotDetector, Estimator, EstimatorConfig, FrameEstimate};
use spindoe_studies::frames::DOTS20;
use spindoe_studies::score::{bins, median, rates, share};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

/// Rows of the picture, and its columns: enough for a ball that moves along the rows.
const SIZE: [usize; 2] = [160, 1080];
/// The ball stays so far within the picture, pixels.
const MARGIN: f64 = 40.0;
/// A named dot farther from a true one than this, in its radii, is none.
const NEAR: f64 = 0.7;
/// Edges of the turns from the ball's upper rim to its lower one, degrees.
const TURNS_DEG: [f64; 7] = [0.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0];
/// Set in the seed of a clip's spin.
const SPIN: u64 = 0x5b14 << 32;
const WAYS: [&str; 3] = ["ignored", "times", "times and rows"];

#[derive(clap::Args)]
pub struct Args {
    /// Clips of a frame rate and a readout.
    #[arg(long, default_value_t = 40)]
    clips: u64,
    /// Frames of a clip.
    #[arg(long, default_value_t = 12)]
    frames: usize,
    /// Seed of the clips.
    #[arg(long, default_value_t = 32_520_001)]
    seed: u64,
    /// Diameter of the ball, pixels.
    #[arg(long, default_value_t = 60.0)]
    px: f64,
    /// Exposure of a frame, milliseconds.
    #[arg(long, default_value_t = 0.25)]
    exposure_ms: f64,
    /// Spins, revolutions per second, log-uniform.
    #[arg(long, value_delimiter = ',', default_value = "5,100")]
    rps: Vec<f64>,
    /// Frames per second, and readouts in milliseconds.
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "30:8,30:16,30:33,60:8,60:16,240:4"
    )]
    cameras: Vec<String>,
}

/// A frame in one way.
struct Judged {
    truth: FrameTruth,
    found: FrameEstimate,
    turn_deg: f64,
    names: usize,
    wrong_names: usize,
}

/// A clip's spin in one way.
#[derive(Clone, Copy)]
struct Spun {
    /// Whether it is the true one but for its error, not one faster or slower by whole turns.
    is_right: bool,
    /// Of it, or of the alias nearest to the truth: the rate over the true one, and the axis' angle, degrees.
    rate_error: f64,
    axis_deg: f64,
}

/// A clip in all ways; of frames, *times* are as *ignored*.
struct Clip {
    ignored_and_corrected: [Vec<Judged>; 2],
    spins: [Option<Spun>; 3],
}

impl Args {
    pub fn run(&self) -> Outcome {
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        let detector = DetectorName::Cnn.build()?;
        println!(
            "{} clips of {} frames a camera, ball of {} px in {} rows, {} ms of exposure, {} to {} rps, seed {}",
            self.clips,
            self.frames,
            self.px,
            SIZE[1],
            self.exposure_ms,
            self.rps[0],
            self.rps[1],
            self.seed
        );
        let table = Table::new([
            "fps",
            "readout",
            "rows",
            "clips with a spin",
            "the right one",
            "error of the rate, median",
            "error of the axis, median",
        ]);
        let mut all = Vec::new();
        for camera in &self.cameras {
            let parts = camera.split_once(':').ok_or("expected FPS:MS")?;
            let (fps, ms): (f64, f64) = (parts.0.parse()?, parts.1.parse()?);
            let clip = |k| self.clip(&pattern, &detector, fps, 1e-3 * ms, self.seed + k);
            let clips = (0..self.clips).into_par_iter().map(clip);
            let clips: Vec<Clip> = clips.collect::<spindoe::Result<_>>()?;
            for (k, way) in WAYS.into_iter().enumerate() {
                let spins: Vec<Spun> = clips.iter().filter_map(|c| c.spins[k]).collect();
                row!(table; fps, format!("{ms} ms"), way, spins.len(), share(&spins, |s| s.is_right),
                    figure(100.0 * median(&spins, |s| s.rate_error), 2, "%"),
                    figure(median(&spins, |s| s.axis_deg), 2, "deg"));
            }
            all.extend(clips);
        }
        print_frames(&all);
        Ok(())
    }

    fn clip(
        &self,
        pattern: &Pattern,
        detector: &DotDetector,
        fps: f64,
        readout_s: f64,
        seed: u64,
    ) -> spindoe::Result<Clip> {
        let sequence = self.sequence(pattern, fps, readout_s, seed)?;
        let config = EstimatorConfig {
            camera: CameraModel::Known(sequence.scene(0).0.camera),
            ..EstimatorConfig::default()
        };
        let estimator = &Estimator::new(pattern, config, detector.clone())?;
        let frames = (0..self.frames).map(|k| sequence.frame(k));
        let frames: Vec<SynthFrame> = frames.collect::<spindoe::Result<_>>()?;
        let times_s: Vec<f64> = (0..self.frames)
            .map(|k| 1e-9 * sequence.scene(k).1 as f64)
            .collect();
        let images: Vec<ImageView<'_>> = frames.iter().map(|f| ImageView::from(&f.image)).collect();
        let row_s = readout_s / (SIZE[1] as f64 - 1.0);
        let rolling = SequenceConfig {
            row_s,
            ..SequenceConfig::default()
        };
        let (ignored, _) =
            estimate_sequence(estimator, &SequenceConfig::default(), &times_s, &images);
        let (corrected, _) = estimate_sequence(estimator, &rolling, &times_s, &images);
        let truth = sequence.spin();
        let turn_deg = (truth.norm() * row_s * self.px).to_degrees();
        let spin = |times: &[f64], found: &[FrameEstimate], row_s: f64| {
            spun(
                estimator,
                &truth,
                0.25 * fps * TAU,
                &NamedFrame::of_times(times, found),
                row_s,
            )
        };
        let spins = [
            spin(&times_s, &ignored, 0.0),
            spin(&seen_times(row_s, &times_s, &ignored), &ignored, 0.0),
            spin(&seen_times(row_s, &times_s, &corrected), &corrected, row_s),
        ];
        let judged = |found: Vec<FrameEstimate>| {
            let each = frames.iter().zip(found);
            each.map(|(frame, found)| Judged::new(&frame.truth, found, turn_deg))
                .collect()
        };
        Ok(Clip {
            ignored_and_corrected: [ignored, corrected].map(judged),
            spins,
        })
    }

    /// A ball that crosses the picture about where it was drawn.
    fn sequence(
        &self,
        pattern: &Pattern,
        fps: f64,
        readout_s: f64,
        seed: u64,
    ) -> spindoe::Result<SynthSequence> {
        let config = SynthConfig {
            ball_px: Some([self.px; 2]),
            image_px: Some(SIZE),
            parallel_share: 0.0,
            ..SynthConfig::good()
        };
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ SPIN);
        let rps = rng.random_range(self.rps[0].ln()..=self.rps[1].ln()).exp();
        let spin = random_direction(&mut rng) * (rps * TAU);
        let still = ClipConfig {
            fps,
            spin: Some(spin.into()),
            exposure_s: Some(1e-3 * self.exposure_ms),
            drift_px: Some([0.0; 2]),
            readout_s,
        };
        let middle = SynthSequence::random(pattern, &config, &still, seed, self.frames)?;
        let v = middle.scene(0).0.circle.center.v;
        let reach = 2.0 * (v - MARGIN).min(SIZE[1] as f64 - MARGIN - v).max(0.0);
        let up = if rng.random() { -1.0 } else { 1.0 };
        let clip = ClipConfig {
            drift_px: Some([0.0, 0.9 * up * reach]),
            ..still
        };
        SynthSequence::random(pattern, &config, &clip, seed, self.frames)
    }
}

/// The spin of frames, weighed by their rows where the time between these is not 0.
fn spun(
    estimator: &Estimator,
    truth: &Vec3,
    apart: f64,
    named: &[NamedFrame<'_>],
    row_s: f64,
) -> Option<Spun> {
    let axes = CameraFrame::Camera;
    let found = orientations(named, axes, true);
    let (measurements, config) = (
        found.measurements(),
        found.spin_config(SpinConfig::default()),
    );
    let rows = SequenceRows::new(estimator, row_s, named, axes);
    let constant = MotionModel::Constant;
    let fit = match &rows {
        Some(rows) => SpinEstimate::fit_with(&measurements, constant, &config, rows),
        None => SpinEstimate::fit(&measurements, constant, &config),
    }
    .ok()?;
    let listed = AliasConfig::of(&config);
    let summary = fit.summary(&measurements, fit.middle_s(), &listed, named.len());
    let chosen = summary.fit.motion.spin;
    let others = summary.alternatives.iter().map(|a| a.spin);
    let off = |spin: &Vec3| (spin - truth).norm();
    let nearest = others
        .chain([chosen])
        .min_by(|a, b| off(a).total_cmp(&off(b)))?;
    Some(Spun {
        is_right: off(&chosen) < apart,
        rate_error: (nearest.norm() / truth.norm() - 1.0).abs(),
        axis_deg: nearest.angle(truth).to_degrees(),
    })
}

impl Judged {
    fn new(truth: &FrameTruth, found: FrameEstimate, turn_deg: f64) -> Self {
        let named = found.dots.iter().zip(&found.assignment);
        let named = named.filter_map(|(dot, name)| Some((dot.pixel, (*name)?)));
        let is_wrong = |(pixel, name): &(spindoe::vision::Pixel, u16)| {
            let near = |d: &&spindoe::synth::dataset::DotTruth| {
                let reach = NEAR * d.radius_rad * truth.radius_px;
                (d.pixel.u - pixel.u).hypot(d.pixel.v - pixel.v) < reach
            };
            let is_it = |d: &spindoe::synth::dataset::DotTruth| d.index == usize::from(*name);
            !truth.dots.iter().find(near).is_some_and(is_it)
        };
        let is_posed = found.pose().is_some();
        let names = named.clone().filter(|_| is_posed).count();
        let wrong_names = named.filter(|n| is_posed && is_wrong(n)).count();
        Self {
            truth: truth.clone(),
            found,
            turn_deg,
            names,
            wrong_names,
        }
    }
}

fn print_frames(clips: &[Clip]) {
    let table = Table::new([
        "turn across the ball",
        "rows",
        "frames",
        "right",
        "wrong",
        "unanswered",
        "mean error",
        "median",
        "names that are wrong",
    ]);
    for bin in bins(&TURNS_DEG) {
        for (k, way) in [WAYS[0], WAYS[2]].into_iter().enumerate() {
            let frames = clips.iter().flat_map(|clip| &clip.ignored_and_corrected[k]);
            let frames: Vec<&Judged> = frames.filter(|f| bin.holds(f.turn_deg)).collect();
            let outcomes: Vec<_> = frames
                .iter()
                .map(|f| FrameOutcome::of(&f.found, &f.truth.camera_orientation()))
                .collect();
            let names: usize = frames.iter().map(|f| f.names).sum();
            let wrong: usize = frames.iter().map(|f| f.wrong_names).sum();
            let wrong = spindoe::stats::Proportion::new(wrong as u64, names as u64);
            row!(table; bin.named("deg"), way, frames.len(); rates(&outcomes); [wrong]);
        }
    }
}
