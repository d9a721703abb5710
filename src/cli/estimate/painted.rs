//! `spindoe estimate` of a painted ball: orientations of a ball with marks of any shape.

use serde_json::{Value, json};

use super::Arguments;
use super::written::{FoundSpin, add_orientation, add_spin, clip_json, say_times, spin_words};
use crate::ball::USUAL_BALL_MM;
use crate::cli::inputs::{self, Counting};
use crate::cli::spin_summary;
use crate::clip::{self, Batch, BatchFrame, SurfaceObserver};
use crate::error::{Error, Result};
use crate::files;
use crate::geometry::{CameraFrame, turned_covariance};
use crate::spin::orientations::{OrientationRow, Orientations};
use crate::spin::robust::SpinConfig;
use crate::vision::outline::circle::CircleConfig;
use crate::vision::outline::find::OutlineFinder;
use crate::vision::painted::{PaintedFrame, PaintedPose, PaintedPoses, PaintedTracker, Surface};

/// Radius of a ball of which nothing is said, m.
const USUAL_RADIUS_M: f64 = 0.5e-3 * USUAL_BALL_MM;
/// Balls below this diameter, pixels, are called small.
const SMALL_PX: f64 = 50.0;

/// Estimates by the ball's surface, where an earlier clip left one.
pub(super) fn run(arguments: &Arguments, surface: Option<&Surface>) -> Result<()> {
    arguments.check_numbers()?;
    let asked = &arguments.asked;
    let camera = asked.camera()?;
    let finder = OutlineFinder::new(CircleConfig::default(), asked.source.outline, &camera)?;
    let finder = finder.with_ball_radius_m(asked.ball_radius_m()?.unwrap_or(USUAL_RADIUS_M));
    let config = arguments.batch()?;
    let file = arguments.output.as_deref().map(files::OutputFile::create);
    let file = file.transpose()?;
    if let Some(path) = &arguments.write_surface {
        files::check_writable(path)?;
    }
    let shown = Counting::new(&arguments.images, SurfaceObserver::default());
    let tracker = PaintedTracker::new(&asked.source.camera()?);
    let mut batch = clip::run(&finder, &arguments.images, &config, &shown)?;
    shown.finish();
    inputs::say(&batch, &config)?;
    inputs::say_not_increasing(&batch, &arguments.images, "no spin");
    let kept = batch.frames.iter_mut();
    let frames: Vec<PaintedFrame> = kept.map(|f| std::mem::take(&mut f.kept)).collect();
    say_small(&frames);
    let (poses, made) = match surface {
        Some(surface) => (tracker.place(&frames, surface), None),
        None => {
            let track = tracker.track(&frames);
            (track.poses, Some(track.surface))
        }
    };
    let posed = poses.iter().flatten().count();
    // Alone, the first frame says nothing.
    let is_answered = posed > usize::from(made.is_some());
    let known = made.as_ref().map(Surface::known);
    let report = Report::new(arguments, &batch, poses, known)?;
    // Rows that another program's format refuses leave nothing written.
    let rows = asked.rows(&report.orientations)?;
    if let (Some(path), Some(surface), true) = (&arguments.write_surface, &made, is_answered) {
        surface.write_npz(path)?;
    }
    arguments.write(file, &rows, || report.to_json())?;
    report.say(posed);
    asked.say_format()?;
    match is_answered {
        true => Ok(()),
        false => Err(Error::NoAnswer {
            path: inputs::named(&arguments.images),
            reason: match asked.table.first() {
                None => "no frame shows the paint of another one".to_owned(),
                Some(table) => format!("no frame shows the paint of {}", table.display()),
            },
        }),
    }
}

/// Warns of balls that show little of their paint.
fn say_small(frames: &[PaintedFrame]) {
    let mut diameters: Vec<f64> = frames
        .iter()
        .filter_map(PaintedFrame::diameter_px)
        .collect();
    let diameter = crate::stats::median(&mut diameters);
    if diameter > 0.0 && diameter < SMALL_PX {
        errln!(
            "note: the ball is {diameter:.0} pixels wide: below {SMALL_PX:.0} its paint is followed less well, and lost sooner"
        );
    }
}

/// What is reported.
struct Report<'a> {
    arguments: &'a Arguments,
    batch: &'a Batch<PaintedFrame>,
    axes: CameraFrame,
    poses: PaintedPoses,
    orientations: Orientations,
    /// Share of the ball that the clip shows.
    known: Option<f64>,
    /// Where all frames have times that increase.
    spin: Option<FoundSpin>,
}

impl<'a> Report<'a> {
    fn new(
        arguments: &'a Arguments,
        batch: &'a Batch<PaintedFrame>,
        poses: PaintedPoses,
        known: Option<f64>,
    ) -> Result<Self> {
        let axes = arguments.asked.frame()?;
        let orientations = orientations(batch, &poses, axes);
        let config = SpinConfig {
            times: batch.times.origin(),
            ..arguments.asked.spin()
        };
        let timed = batch.times_s();
        let spin = timed.map(|_| spin_summary::of_rows(&orientations, &config));
        Ok(Self {
            arguments,
            batch,
            axes,
            poses,
            orientations,
            known,
            spin,
        })
    }

    /// Summarizes the outcome on standard error.
    fn say(&self, posed: usize) {
        for (frame, pose) in self.batch.frames.iter().zip(&self.poses) {
            match (&frame.unreadable, pose) {
                (Some(why), _) => errln!("{why}"),
                (None, Err(why)) => errln!("{}: {why}", frame.name),
                _ => {}
            }
        }
        if let Some(known) = self.known {
            errln!("{:.0} % of the ball shown", 100.0 * known);
        }
        let count = self.poses.len();
        errln!("{posed} of {count} frames have an orientation");
        say_times(self.batch);
        if let Some(words) = spin_words(self.spin.as_ref(), self.axes) {
            errln!("spin: {words}");
        }
    }

    fn to_json(&self) -> Value {
        let frames = self.batch.frames.iter().zip(&self.poses);
        let frames = frames.zip(&self.orientations.rows);
        let frames = frames.map(|((frame, pose), row)| {
            let mut json = json!({ "frame": frame.name, "time_s": frame.time_s });
            add_orientation(row, self.axes, &mut json);
            match (&frame.unreadable, pose) {
                (Some(why), _) => json["refusal"] = why.clone().into(),
                (None, Err(why)) => json["refusal"] = why.to_string().into(),
                (None, Ok(pose)) => json["agreement"] = pose.agreement.into(),
            }
            json
        });
        let (frames, identified) = (frames.collect(), self.poses.iter().flatten().count());
        let mut json = clip_json(
            &self.arguments.asked,
            self.axes,
            self.batch,
            frames,
            identified,
        );
        json["surface_known"] = self.known.into();
        add_spin(self.spin.as_ref(), self.axes, &mut json);
        json
    }
}

fn orientations(
    batch: &Batch<PaintedFrame>,
    poses: &PaintedPoses,
    axes: CameraFrame,
) -> Orientations {
    let turn = axes.turn();
    let posed = poses.iter().map(|pose| pose.as_ref().ok());
    let rows = batch.frames.iter().zip(posed);
    let row = |(frame, pose): (&BatchFrame<PaintedFrame>, Option<&PaintedPose>)| OrientationRow {
        frame: frame.name.clone(),
        time_s: frame.time_s.unwrap_or(f64::NAN),
        // How often a pose is right depends on how far its clip has drifted, which the frame does not know: no confidence.
        orientation: pose.map(|p| turn * p.rotation),
        covariance: pose.map(|p| turned_covariance(&turn, &p.covariance)),
        position: frame.estimate().position().map(|p| p.turned(&turn)),
        ..OrientationRow::default()
    };
    Orientations {
        rows: rows.map(row).collect(),
        camera_frame: Some(axes),
        ..Orientations::default()
    }
}
