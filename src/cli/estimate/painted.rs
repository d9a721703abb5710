//! `spindoe estimate --painted`: orientations of a ball with marks of any shape.

use std::io::Write as _;

use super::{Arguments, inputs};
use crate::ball::Ball;
use crate::calibrate::SurfaceObserver;
use crate::cli::images::order_warning;
use crate::cli::output::Counter;
use crate::error::{Error, Result};
use crate::files;
use crate::geometry::{CameraFrame, spiral_directions};
use crate::image::RgbImage;
use crate::pattern::Pattern;
use crate::spin::orientations::{OrientationRow, Orientations};
use crate::vision::FrameEstimate;
use crate::vision::estimator::{BatchFrame, BatchObserver, estimate_inputs, turned_covariance};
use crate::vision::painted::{
    PaintedFrame, PaintedPose, PaintedPoses, PaintedRejection, PaintedTracker, Surface,
};

/// Directions of the pattern that stands in where there is none: only the ball's outline is used.
const STAND_IN_DOTS: usize = 20;

/// Keeps what frames show of the paint.
struct Shown(Counter);

impl BatchObserver for Shown {
    type Kept = PaintedFrame;

    fn keep(&self, image: &RgbImage, estimate: &FrameEstimate) -> Result<PaintedFrame> {
        let outline = estimate.outline.as_ref();
        let taken = outline.map(|outline| PaintedFrame::take(&image.to_gray(), outline));
        Ok(taken.unwrap_or_default())
    }

    fn progress(&self, frames: usize) {
        self.0.set(frames as u64);
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let surface = match &arguments.table[..] {
        [] => None,
        [path] => Some(Surface::read_npz(path)?),
        _ => {
            let problem = "expected one surface with --painted";
            return Err(Error::argument("--table", problem));
        }
    };
    if surface.is_some() && arguments.write_surface.is_some() {
        let problem = "expected without --table: that surface stays as it is";
        return Err(Error::argument("--write-surface", problem));
    }
    let stand_in = Pattern::new(spiral_directions(STAND_IN_DOTS).collect())?;
    let estimator = arguments.estimator(&Ball::new(stand_in))?;
    let config = SurfaceObserver::settings(arguments.batch()?);
    let file = arguments.output.as_deref().map(files::OutputFile::create);
    let file = file.transpose()?;
    if let Some(path) = &arguments.write_surface {
        files::check_writable(path)?;
    }
    let shown = Shown(Counter::new(0, "frames"));
    let tracker = PaintedTracker::new(&arguments.source.camera()?);
    let batch = estimate_inputs(&estimator, &arguments.images, &config, &shown)?;
    shown.0.finish();
    if let Some(warning) = order_warning(batch.frames.iter().map(|f| f.name.as_str())) {
        errln!("spindoe: {warning}");
    }
    inputs::say_skipped(&batch.skipped);
    inputs::say_cut_short(&batch.cut_short);
    if let Some(words) = inputs::times_words(&batch.times, batch.frames.len()) {
        errln!("times: {words}");
    }
    let frames: Vec<PaintedFrame> = batch.frames.iter().map(|f| f.kept.clone()).collect();
    let poses = match &surface {
        Some(surface) => tracker.place(&frames, surface),
        None => {
            let track = tracker.track(&frames);
            if let Some(path) = &arguments.write_surface {
                track.surface.write_npz(path)?;
            }
            errln!("{:.0} % of the ball shown", 100.0 * track.surface.known());
            track.poses
        }
    };
    say_rejected(&batch.frames, &poses);
    let text = orientations(&batch.frames, &poses, arguments.frame()?).to_csv();
    match (file, &arguments.output) {
        (Some(mut file), Some(path)) => {
            file.write_all(text.as_bytes())
                .map_err(|e| Error::write(path, e))?;
            file.finish()?;
        }
        _ => crate::cli::write_stdout(text.as_bytes())?,
    }
    let posed = poses.iter().flatten().count();
    errln!("{posed} of {} frames have an orientation", poses.len());
    // Alone, the first frame says nothing.
    match posed > usize::from(surface.is_none()) {
        true => Ok(()),
        false => Err(Error::NoAnswer {
            path: arguments.images[0].clone(),
            reason: "no frame shows the paint of another one".to_owned(),
        }),
    }
}

fn say_rejected<K>(frames: &[BatchFrame<K>], poses: &PaintedPoses) {
    for (frame, pose) in frames.iter().zip(poses) {
        match (&frame.unreadable, pose) {
            (Some(why), _) => errln!("{why}"),
            (None, Err(why)) => errln!("{}: {why}", frame.name),
            _ => {}
        }
    }
}

fn orientations<K>(
    frames: &[BatchFrame<K>],
    poses: &PaintedPoses,
    axes: CameraFrame,
) -> Orientations {
    let turn = axes.turn();
    let row = |(frame, pose): (
        &BatchFrame<K>,
        &std::result::Result<PaintedPose, PaintedRejection>,
    )| {
        let pose = pose.as_ref().ok();
        OrientationRow {
            frame: frame.name.clone(),
            time_s: frame.time_s.unwrap_or(f64::NAN),
            orientation: pose.map(|p| turn * p.rotation),
            dots: None,
            matched: None,
            residual_rad: None,
            // How often a pose is right depends on how far its clip has drifted, which the frame does not know.
            confidence: None,
            covariance: pose.map(|p| turned_covariance(&turn, &p.covariance)),
            turn: None,
        }
    };
    Orientations {
        rows: frames.iter().zip(poses).map(row).collect(),
        camera_frame: Some(axes),
    }
}
