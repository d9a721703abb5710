//! The page of `spindoe estimate --report`.

use std::path::Path;

use super::output::SequenceReport;
use super::painted::{SeenPaint, SurfaceDrawing};
use super::written::{ClipRows, FoundSpin, by_own_axes};
use super::{Picture, balls, overlay};
use crate::clip::{Batch, NamedFrame};
use crate::error::Result;
use crate::files;
use crate::plot::frame_thumbnail;
use crate::report::page::{Carried, EstimatePage, ShownBall};
use crate::vision::Estimator;

/// Writes the page of one ball, with the spin that is reported of it.
pub(super) fn write(
    path: &Path,
    estimator: &Estimator,
    batch: &Batch<Picture>,
    report: &SequenceReport<'_>,
) -> Result<()> {
    let ball = ShownBall {
        carries: Carried::Dots(estimator.ball()),
        number: None,
        frames: batch.named(),
        orientations: report.rows().orientations(),
        spin: report
            .spin()
            .map(|spin| by_own_axes(spin, report.rows().axes)),
        sequence: &batch.sequence,
    };
    let page = EstimatePage::new(&[ball], |_, at| {
        let shown = &batch.frames[at];
        let drawn = || frame_thumbnail(&overlay::one_ball(estimator, shown));
        shown.kept.as_ref().map(|_| drawn()).transpose()
    })?;
    files::write_bytes(path, page.html()?.as_bytes())
}

/// Writes the page of several balls, each with its own frames.
pub(super) fn write_balls(
    path: &Path,
    estimators: &[Estimator],
    batch: &Batch<Picture>,
    report: &balls::BallsReport<'_>,
) -> Result<()> {
    let all: Vec<balls::BallRows<'_>> = report.by_number();
    let shown = all.iter().map(|ball| ShownBall {
        carries: Carried::Dots(estimators[ball.table].ball()),
        number: Some(ball.number),
        frames: ball
            .frames
            .iter()
            .map(|(_, named)| *named)
            .collect::<Vec<NamedFrame<'_>>>(),
        orientations: ball.orientations.clone(),
        spin: ball.spin.map(|spin| by_own_axes(spin, report.axes())),
        sequence: &batch.sequence,
    });
    let shown: Vec<ShownBall<'_>> = shown.collect();
    let page = EstimatePage::new(&shown, |ball, at| {
        let (frame, _) = all[ball].frames[at];
        let kept = batch.frames[frame].kept.as_ref();
        let drawn = || frame_thumbnail(&report.drawn(frame, estimators));
        kept.map(|_| drawn()).transpose()
    })?;
    files::write_bytes(path, page.html()?.as_bytes())
}

/// Writes the page of a painted ball.
pub(super) fn write_painted(
    path: &Path,
    batch: &Batch<SeenPaint>,
    drawing: &SurfaceDrawing<'_>,
    rows: &ClipRows<'_, SeenPaint>,
    spin: Option<&FoundSpin>,
) -> Result<()> {
    let ball = ShownBall {
        carries: Carried::Paint {
            surface: drawing.surface,
            poses: drawing.poses,
        },
        number: None,
        frames: batch.named(),
        orientations: rows.orientations(),
        spin: spin.map(|spin| by_own_axes(spin, rows.axes)),
        sequence: &batch.sequence,
    };
    let page = EstimatePage::new(&[ball], |_, at| {
        let shown = &batch.frames[at];
        let drawn = || {
            frame_thumbnail(&overlay::painted(
                shown,
                &drawing.poses[at],
                &drawing.borders,
            ))
        };
        shown.kept.picture.as_ref().map(|_| drawn()).transpose()
    })?;
    files::write_bytes(path, page.html()?.as_bytes())
}
