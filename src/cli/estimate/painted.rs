//! `spindoe estimate` of a painted ball: orientations of a ball with marks of any shape.

#[cfg(feature = "plot")]
use std::path::Path;

use serde_json::{Value, json};

#[cfg(feature = "plot")]
use super::overlay;
#[cfg(feature = "plot")]
use super::page;
use super::written::{
    ClipRows, FoundSpin, WrittenRow, add_orientation, add_spin, found_spin, say_times, spin_words,
};
use super::{Arguments, Asked, Picture, Pictures};
use crate::ball::USUAL_BALL_MM;
use crate::cli::inputs::{self, Counting};
use crate::clip::{
    self, BallEstimate, BatchObserver, PaintedClip, PaintedEstimator, SequenceEvidence,
    SurfaceObserver,
};
use crate::error::{Error, Result};
use crate::files;
use crate::geometry::CameraFrame;
#[cfg(feature = "plot")]
use crate::geometry::Vec3;
use crate::image::RgbImage;
use crate::spin::orientations::OrientationRow;
use crate::surface::{PaintedFrame, PaintedPose, PaintedPoses, PaintedRejection, SurfaceMap};

/// Radius of a ball of which nothing is said, m.
const USUAL_RADIUS_M: f64 = 0.5e-3 * USUAL_BALL_MM;
/// Balls below this diameter, pixels, are called small.
const SMALL_PX: f64 = 50.0;

/// Estimates by the ball's surface, where an earlier clip left one.
pub(super) fn run(arguments: &Arguments, surface: Option<&SurfaceMap>) -> Result<()> {
    arguments.check_numbers()?;
    let asked = &arguments.asked;
    let estimator = estimator(asked)?;
    let config = arguments.batch()?;
    let file = arguments.output.as_deref().map(files::OutputFile::create);
    let file = file.transpose()?;
    if let Some(path) = &arguments.write_surface {
        files::check_writable(path)?;
    }
    #[cfg(feature = "plot")]
    let overlay = arguments
        .overlay
        .as_deref()
        .map(overlay::OverlayTarget::new);
    #[cfg(feature = "plot")]
    let overlay = overlay.transpose()?;
    let seeing = PaintedSeeing {
        paint: SurfaceObserver::default(),
        pictures: Pictures {
            wanted: arguments.wants_pictures(),
        },
    };
    let shown = Counting::new(&arguments.images, seeing);
    let batch = clip::run(&estimator.finder, &arguments.images, &config, &shown)?;
    shown.finish();
    inputs::say(&batch, &config)?;
    inputs::say_not_increasing(&batch, &arguments.images, "no spin");
    let clip = estimator.lay_out(batch, |seen| std::mem::take(&mut seen.paint), surface);
    say_small(clip.diameter_px);
    let report = PaintedReport::new(arguments, &clip)?;
    // Rows that another program's format refuses leave nothing written.
    let rows = report.rows.text()?;
    #[cfg(feature = "plot")]
    if let Some(shown) = surface.or(clip.made.as_ref())
        && arguments.wants_pictures()
    {
        let drawing = SurfaceDrawing {
            surface: shown,
            poses: &clip.poses,
            borders: shown.borders(),
        };
        report.draw(&drawing, overlay, arguments.report.as_deref())?;
    }
    if let (Some(path), Some(surface), true) =
        (&arguments.write_surface, &clip.made, clip.is_answered())
    {
        surface.write_npz(path)?;
    }
    arguments.write(file, &rows, || report.to_json())?;
    report.say();
    asked.say_format()?;
    match clip.is_answered() {
        true => Ok(()),
        false => Err(no_answer(arguments)),
    }
}

/// No frame has an orientation.
fn no_answer(arguments: &Arguments) -> Error {
    Error::NoAnswer {
        path: inputs::named(&arguments.images),
        reason: match arguments.asked.table.first() {
            None => "no frame shows the paint of another one".to_owned(),
            Some(table) => format!("no frame shows the paint of {}", table.display()),
        },
    }
}

/// The estimator of a painted ball.
pub(in crate::cli) fn estimator(asked: &Asked) -> Result<PaintedEstimator> {
    let radius_m = asked.ball_radius_m()?.unwrap_or(USUAL_RADIUS_M);
    PaintedEstimator::new(&asked.camera()?, asked.source.outline, radius_m)
}

/// What is kept of a frame: what it shows of the ball, and its picture where that is drawn.
#[derive(Default)]
pub(super) struct SeenPaint {
    paint: PaintedFrame,
    #[cfg_attr(not(feature = "plot"), allow(dead_code))]
    pub picture: Picture,
}

/// Keeps it.
struct PaintedSeeing {
    paint: SurfaceObserver,
    pictures: Pictures,
}

impl BatchObserver for PaintedSeeing {
    type Kept = SeenPaint;

    fn keep(&self, image: &RgbImage, balls: &[BallEstimate]) -> Result<SeenPaint> {
        let picture = match self.pictures.wants_images() {
            true => self.pictures.keep(image, balls)?,
            false => None,
        };
        Ok(SeenPaint {
            paint: self.paint.keep(image, balls)?,
            picture,
        })
    }
}

/// What of the ball's surface is drawn on its frames.
#[cfg(feature = "plot")]
pub(super) struct SurfaceDrawing<'a> {
    pub surface: &'a SurfaceMap,
    pub poses: &'a PaintedPoses,
    /// Those of the surface's marks.
    pub borders: Vec<[Vec3; 2]>,
}

/// Warns of balls that show little of their paint.
fn say_small(diameter_px: f64) {
    if diameter_px > 0.0 && diameter_px < SMALL_PX {
        errln!(
            "note: the ball is {diameter_px:.0} pixels wide: below {SMALL_PX:.0} its paint is followed less well, and lost sooner"
        );
    }
}

/// What is reported.
struct PaintedReport<'a> {
    rows: ClipRows<'a, SeenPaint>,
    /// Share of the ball that the clip shows.
    known: Option<f64>,
    /// Where all frames have times that increase.
    spin: Option<FoundSpin>,
}

impl<'a> PaintedReport<'a> {
    fn new(arguments: &'a Arguments, clip: &'a PaintedClip<SeenPaint>) -> Result<Self> {
        let (asked, batch) = (&arguments.asked, &clip.batch);
        let axes = asked.frame()?;
        let file = clip.orientations(axes);
        let spin = batch.is_sequence().then(|| {
            let (timed, nothing) = ((&file, &batch.times), SequenceEvidence::default());
            found_spin(asked, timed, arguments.motion, &nothing)
        });
        let frames = file.rows.into_iter().zip(&clip.poses);
        let rows = ClipRows {
            asked,
            axes,
            batch,
            frames: frames
                .map(|(row, pose)| vec![of_frame(row, pose, axes)])
                .collect(),
            columns: file.columns,
        };
        let known = clip.made.as_ref().map(SurfaceMap::known);
        Ok(Self { rows, known, spin })
    }

    /// Draws the frames, and writes the page.
    #[cfg(feature = "plot")]
    fn draw(
        &self,
        drawing: &SurfaceDrawing<'_>,
        overlay: Option<overlay::OverlayTarget>,
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

/// What is written of a frame.
pub(in crate::cli) fn of_frame(
    row: OrientationRow,
    pose: &std::result::Result<PaintedPose, PaintedRejection>,
    axes: CameraFrame,
) -> WrittenRow {
    let mut json = json!({});
    add_orientation(&row, axes, &mut json);
    let note = pose.as_ref().err().map(ToString::to_string);
    match (pose, &note) {
        (Ok(pose), _) => json["agreement"] = pose.agreement.into(),
        (Err(_), why) => json["refusal"] = why.as_deref().into(),
    }
    WrittenRow { row, json, note }
}
