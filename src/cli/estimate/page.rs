//! The page of `spindoe estimate --report`.

use std::path::Path;

use super::output::Report;
use super::{Picture, overlay};
use crate::clip::Batch;
use crate::error::Result;
use crate::files;
use crate::plot::frame_thumbnail;
use crate::report::page::EstimatePage;
use crate::vision::Estimator;

/// Writes the page of `batch`, with the spin that is reported of it.
pub(super) fn write(
    path: &Path,
    estimator: &Estimator,
    batch: &Batch<Picture>,
    report: &Report<'_>,
) -> Result<()> {
    let spin = report.spin();
    let page = EstimatePage::new(
        estimator.ball(),
        batch,
        report.orientations(),
        spin.as_ref(),
        |shown| {
            let drawn = || frame_thumbnail(&overlay::one_ball(estimator, shown));
            shown.kept.as_ref().map(|_| drawn()).transpose()
        },
    )?;
    files::write_bytes(path, page.html()?.as_bytes())
}
