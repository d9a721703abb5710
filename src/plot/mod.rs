//! Plots as PNG or SVG files, by the name's ending: the ball, rates with their intervals, features in hash space, measured values.
//!
//! Every function checks its data, draws in memory and writes the file atomically. Text is set in a
//! built-in font, so that a machine without fonts draws the same picture; for the same data the
//! file's bytes are the same. Rates are handed over as fractions in [0, 1] and drawn in percent.
//! Legends stand above the plotting area, never on the data.

mod axis;
mod backend;
mod ball;
mod bars;
mod canvas;
mod curves;
mod features;
mod offsets;
#[cfg(feature = "vision")]
mod overlay;
mod places;
mod recognition;
mod solid;
mod stencil;
#[cfg(feature = "vision")]
mod surface;
mod values;

pub use ball::{BallDrawing, VIEWS_SIZE, pattern_views};
pub use bars::{BARS_SIZE, BarChart, BarGroup, bar_comparison};
pub use curves::{
    CURVES_SIZE, CurvePlot, LineSeries, RELIABILITY_SIZE, RateSeries, ReliabilityPlot, ScatterPlot,
    rate_curves, reliability_plot, scatter_plot,
};
pub use features::{FEATURES_SIZE, feature_plot};
pub use offsets::{OFFSET_SCALE, OffsetDot, OffsetMark, offset_views};
#[cfg(feature = "vision")]
pub use overlay::{
    OVERLAY_SIDE, OverlayDot, OverlayFrame, OverlayMarks, OverlayOutline, OverlayPixels,
    SHEET_FRAMES, contact_sheet, frame_overlay, frame_thumbnail, overlay_pixels,
};
pub use recognition::{RECOGNITION_VIEW_SIZE, RecognitionView, recognition_views};
pub use stencil::{STENCIL_SIZE, stencil_views};
#[cfg(feature = "vision")]
pub use surface::{SURFACE_SIZE, surface_views};
pub use values::{ValuePlot, ValuePoint, ValueSeries, value_curves};

use crate::error::{Error, Result};

/// How rates are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RateScale {
    /// The rates themselves, on a linear axis.
    #[default]
    Success,
    /// `1 - rate` on an axis of square roots, where differences among rates near 1 can be seen, and
    /// no failure at all has its place too.
    Failure,
}

/// Rates may leave their intervals and [0, 1] by this much: intervals are computed, and rounded.
const ROUNDING: f64 = 1e-9;

/// A rate measured at `x`, with its 95 % interval; all three are fractions in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RatePoint {
    /// Abscissa, in the unit that the plot's `x_label` states.
    pub x: f64,
    /// The rate.
    pub rate: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl RatePoint {
    /// Rejects what is not a rate within its interval. `place` says which point it is.
    fn check(&self, place: &str) -> Result<()> {
        let steps = [0.0, self.low, self.rate, self.high, 1.0];
        let ordered = steps.windows(2).all(|w| w[0] <= w[1] + ROUNDING);
        if ordered && self.x.is_finite() {
            return Ok(());
        }
        let problem = format!(
            "expected a finite x and 0 <= low <= rate <= high <= 1, found x {} with {} <= {} <= {}",
            self.x, self.low, self.rate, self.high
        );
        Err(Error::argument(place.to_owned(), problem))
    }

    /// What is drawn on `scale`: the value and the ends of its interval, as fractions.
    fn on(&self, scale: RateScale) -> [f64; 3] {
        match scale {
            RateScale::Success => [self.rate, self.low, self.high],
            RateScale::Failure => [1.0 - self.rate, 1.0 - self.high, 1.0 - self.low],
        }
        .map(|v| if v < ROUNDING { 0.0 } else { v.min(1.0) })
    }
}
