//! The plot of `spindoe spin --plot`: the spin over time.

use std::path::Path;

use crate::error::{Error, Result};
use crate::plot::{LineSeries, ValuePlot, ValuePoint, ValueSeries, value_curves};
use crate::spin::estimate::{FittedMotion, SpinEstimate};
use crate::spin::windows::WindowFit;

/// Half-width of a 95 % interval in standard deviations.
const Z95: f64 = 1.96;
/// Sections of a plotted curve.
const CURVE_POINTS: usize = 100;

/// The spins of the runs with their intervals, and the fit to all of them.
pub(super) fn plot_over_time(path: &Path, runs: &[WindowFit], fitted: &SpinEstimate) -> Result<()> {
    use std::f64::consts::TAU;
    let points: Vec<ValuePoint> = runs
        .iter()
        .map(|r| {
            let y = r.fit.motion.rps();
            let half = Z95 * r.fit.magnitude_std_rad_s().unwrap_or(0.0) / TAU;
            ValuePoint {
                x: r.time_s,
                y,
                low: y - half,
                high: y + half,
            }
        })
        .collect();
    let ends = (points.first().map(|p| p.x), points.last().map(|p| p.x));
    let (Some(first), Some(last)) = ends else {
        return Err(Error::argument(
            "plot",
            "no run of orientations yields a spin",
        ));
    };
    let curve = |i: usize, half_widths: f64| {
        let t = first + (last - first) * i as f64 / CURVE_POINTS as f64;
        let fit = fitted.at(t);
        let half = Z95 * fit.magnitude_std_rad_s().unwrap_or(0.0) / TAU;
        (t, fit.motion.rps() + half_widths * half)
    };
    let name = match &fitted.motion {
        FittedMotion::Constant(_) => "constant spin fitted to all".into(),
        FittedMotion::Decaying(fit) => format!(
            "fit to all, c = {:.4} +- {:.4} /s",
            fit.motion.decay_per_s,
            fit.std_per_s()
        ),
        FittedMotion::Precessing(_) => "mean spin of the precession fitted to all".into(),
        FittedMotion::Free(_) => "free motion fitted to all, with its 95 % band".into(),
    };
    let mut bands = vec![(name, 0.0)];
    if matches!(fitted.motion, FittedMotion::Free(_)) {
        bands.extend([(String::new(), -1.0), (String::new(), 1.0)]);
    }
    let plot = ValuePlot {
        title: "Spin over time".into(),
        x_label: "time (s)".into(),
        y_label: "spin (revolutions per second)".into(),
        values: vec![ValueSeries {
            name: "runs of orientations, 95 % intervals".into(),
            points,
        }],
        lines: bands
            .into_iter()
            .map(|(name, sign)| LineSeries {
                name,
                points: (0..=CURVE_POINTS).map(|i| curve(i, sign)).collect(),
            })
            .collect(),
    };
    value_curves(path, &plot)
}
