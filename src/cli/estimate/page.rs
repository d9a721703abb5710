//! The page of `spindoe estimate --report`.

use std::path::Path;

use super::{Picture, overlay};
use crate::error::Result;
use crate::files;
use crate::pattern::Pattern;
use crate::plot::frame_thumbnail;
use crate::report::page::EstimatePage;
use crate::spin::Measurement;
use crate::spin::alias::{AliasConfig, alternatives};
use crate::vision::estimator::{Batch, SequenceOutcome};
use crate::vision::{Estimator, NamedDetector};

/// Alternatives are listed up to this multiple of the largest spin searched.
const LISTED_BEYOND: f64 = 2.0;

/// Writes the page of `batch`.
pub(super) fn write(
    path: &Path,
    estimator: &Estimator<NamedDetector>,
    pattern: &Pattern,
    batch: &Batch<Picture>,
    max_spin_rps: f64,
) -> Result<()> {
    let others = match &batch.sequence {
        SequenceOutcome::Estimated { spin: Ok(fit), .. } => {
            let measurements: Vec<Measurement> = batch
                .frames
                .iter()
                .filter_map(|f| Some(Measurement::new(f.time_s?, f.estimate.pose()?.rotation)))
                .collect();
            let config = AliasConfig {
                max_rps: LISTED_BEYOND * max_spin_rps,
                ..AliasConfig::default()
            };
            alternatives(&measurements, fit, &config)
        }
        _ => Vec::new(),
    };
    let page = EstimatePage::new(pattern, batch, &others, |shown| {
        overlay::drawn(estimator, shown)
            .map(|frame| frame_thumbnail(&frame))
            .transpose()
    })?;
    files::write_bytes(path, page.html()?.as_bytes())
}
