//! `spindoe estimate` of a painted ball: orientations of a ball with marks of any shape.

#[cfg(feature = "plot")]
use std::path::Path;

use serde_json::{Value, json};

#[cfg(feature = "plot")]
use super::overlay;
#[cfg(feature = "plot")]
use super::page;
use super::written::{ClipRows, FoundSpin, Row, add_orientation, add_spin, say_times, spin_words};
use super::{Arguments, Picture, Pictures};
use crate::ball::USUAL_BALL_MM;
use crate::cli::inputs::{self, Counting};
use crate::cli::spin_summary;
use crate::clip::{self, BallEstimate, Batch, BatchFrame, BatchObserver, SurfaceObserver};
use crate::error::{Error, Result};
use crate::files;
#[cfg(feature = "plot")]
use crate::geometry::Vec3;
use crate::geometry::{CameraFrame, turned_covariance};
use crate::image::RgbImage;
use crate::spin::orientations::{BallColumns, OrientationRow};
use crate::spin::robust::SpinConfig;
use crate::surface::{
    PaintedFrame, PaintedPose, PaintedPoses, PaintedRejection, PaintedTracker, SurfaceMap,
};
use crate::vision::outline::circle::CircleConfig;
use crate::vision::outline::find::OutlineFinder;

/// Radius of a ball of which nothing is said, m.
const USUAL_RADIUS_M: f64 = 0.5e-3 * USUAL_BALL_MM;
/// Balls below this diameter, pixels, are called small.
const SMALL_PX: f64 = 50.0;

/// Estimates by the ball's surface, where an earlier clip left one.
pub(super) fn run(arguments: &Arguments, surface: Option<&SurfaceMap>) -> Result<()> {
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
    #[cfg(feature = "plot")]
    let overlay = arguments.overlay.as_deref().map(overlay::Target::new);
    #[cfg(feature = "plot")]
    let overlay = overlay.transpose()?;
    let seeing = Seeing {
        paint: SurfaceObserver::default(),
        pictures: Pictures {
            wanted: arguments.wants_pictures(),
        },
    };
    let shown = Counting::new(&arguments.images, seeing);
    let tracker = PaintedTracker::new(&asked.source.camera()?);
    let mut batch = clip::run(&finder, &arguments.images, &config, &shown)?;
    shown.finish();
    inputs::say(&batch, &config)?;
    inputs::say_not_increasing(&batch, &arguments.images, "no spin");
    let kept = batch.frames.iter_mut();
    let frames: Vec<PaintedFrame> = kept.map(|f| std::mem::take(&mut f.kept.paint)).collect();
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
    let known = made.as_ref().map(SurfaceMap::known);
    let report = Report::new(arguments, &batch, &poses, known)?;
    // Rows that another program's format refuses leave nothing written.
    let rows = report.rows.text()?;
    #[cfg(feature = "plot")]
    if let Some(shown) = surface.or(made.as_ref())
        && arguments.wants_pictures()
    {
        let drawing = Drawing {
            surface: shown,
            poses: &poses,
            borders: shown.borders(),
        };
        report.draw(&drawing, overlay, arguments.report.as_deref())?;
    }
    if let (Some(path), Some(surface), true) = (&arguments.write_surface, &made, is_answered) {
        surface.write_npz(path)?;
    }
    arguments.write(file, &rows, || report.to_json())?;
    report.say();
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

/// What is kept of a frame: what it shows of the ball, and its picture where that is drawn.
#[derive(Default)]
pub(super) struct Seen {
    paint: PaintedFrame,
    #[cfg_attr(not(feature = "plot"), allow(dead_code))]
    pub picture: Picture,
}

/// Keeps it.
struct Seeing {
    paint: SurfaceObserver,
    pictures: Pictures,
}

impl BatchObserver for Seeing {
    type Kept = Seen;

    fn keep(&self, image: &RgbImage, balls: &[BallEstimate]) -> Result<Seen> {
        let picture = match self.pictures.wants_images() {
            true => self.pictures.keep(image, balls)?,
            false => None,
        };
        Ok(Seen {
            paint: self.paint.keep(image, balls)?,
            picture,
        })
    }
}

/// What of the ball's surface is drawn on its frames.
#[cfg(feature = "plot")]
pub(super) struct Drawing<'a> {
    pub surface: &'a SurfaceMap,
    pub poses: &'a PaintedPoses,
    /// Those of the surface's marks.
    pub borders: Vec<[Vec3; 2]>,
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
    rows: ClipRows<'a, Seen>,
    /// Share of the ball that the clip shows.
    known: Option<f64>,
    /// Where all frames have times that increase.
    spin: Option<FoundSpin>,
}

impl<'a> Report<'a> {
    fn new(
        arguments: &'a Arguments,
        batch: &'a Batch<Seen>,
        poses: &PaintedPoses,
        known: Option<f64>,
    ) -> Result<Self> {
        let asked = &arguments.asked;
        let axes = asked.frame()?;
        let frames = batch.frames.iter().zip(poses);
        let frames = frames.map(|(frame, pose)| vec![row(frame, pose, axes)]);
        let rows = ClipRows {
            asked,
            axes,
            batch,
            frames: frames.collect(),
            columns: BallColumns::default(),
        };
        let config = SpinConfig {
            times: batch.times.origin(),
            ..asked.spin()
        };
        let timed = batch.times_s();
        let spin = timed.map(|_| spin_summary::of_rows(&rows.orientations(), &config));
        Ok(Self { rows, known, spin })
    }

    /// Draws the frames, and writes the page.
    #[cfg(feature = "plot")]
    fn draw(
        &self,
        drawing: &Drawing<'_>,
        overlay: Option<overlay::Target>,
        page: Option<&Path>,
    ) -> Result<()> {
        let batch = self.rows.batch;
        if let Some(target) = overlay {
            let frame =
                |k: usize| overlay::painted(&batch.frames[k], &drawing.poses[k], &drawing.borders);
            target.draw(&batch.times, batch.frames.len(), frame)?;
        }
        page.map_or(Ok(()), |path| {
            page::write_painted(path, batch, drawing, &self.rows, self.spin.as_ref())
        })
    }

    /// Summarizes the outcome on standard error.
    fn say(&self) {
        let count = self.rows.frames.len();
        (0..count).for_each(|k| self.rows.say_frame(k));
        if let Some(known) = self.known {
            errln!("{:.0} % of the ball shown", 100.0 * known);
        }
        let posed = self.rows.identified();
        errln!("{posed} of {count} frames have an orientation");
        say_times(self.rows.batch);
        if let Some(words) = spin_words(self.spin.as_ref(), self.rows.axes) {
            errln!("spin: {words}");
        }
    }

    fn to_json(&self) -> Value {
        let mut json = self.rows.to_json();
        json["surface_known"] = self.known.into();
        add_spin(self.spin.as_ref(), self.rows.axes, &mut json);
        json
    }
}

/// The row of a frame.
fn row(
    frame: &BatchFrame<Seen>,
    pose: &std::result::Result<PaintedPose, PaintedRejection>,
    axes: CameraFrame,
) -> Row {
    let turn = axes.turn();
    let found = pose.as_ref().ok();
    let row = OrientationRow {
        frame: frame.name.clone(),
        time_s: frame.time_s.unwrap_or(f64::NAN),
        // How often a pose is right depends on how far its clip has drifted, which the frame does not know: no confidence.
        orientation: found.map(|p| turn * p.rotation),
        covariance: found.map(|p| turned_covariance(&turn, &p.covariance)),
        position: frame.estimate().position().map(|p| p.turned(&turn)),
        ..OrientationRow::default()
    };
    let mut json = json!({});
    add_orientation(&row, axes, &mut json);
    let note = pose.as_ref().err().map(ToString::to_string);
    match (found, &note) {
        (Some(pose), _) => json["agreement"] = pose.agreement.into(),
        (None, why) => json["refusal"] = why.as_deref().into(),
    }
    Row { row, json, note }
}
