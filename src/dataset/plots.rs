//! A flight's own check: its spin over time, and its positions.

use std::f64::consts::TAU;
use std::path::Path;

use nalgebra::Matrix3;

use super::flight::Flight;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::plot::{LineSeries, ValuePlot, ValuePoint, ValueSeries, value_curves};
use crate::spin::estimate::SpinEstimate;
use crate::spin::windows::spin_over_time;
use crate::spin::{Fit, MIN_FRAMES};

/// Half-width of a 95 % interval in standard deviations.
const Z95: f64 = 1.96;
/// Sections of a curve.
const SECTIONS: usize = 100;
/// Runs of a short flight; of a long one there are more.
const RUNS: usize = 4;

/// The pictures of a flight; without a spin there is none of it.
pub(super) fn write(dir: &Path, number: usize, flight: &Flight) -> Result<()> {
    if let Ok(spin) = &flight.spin {
        let plot = spin_plot(number, flight, spin);
        value_curves(&dir.join(format!("{number:03}_spin.png")), &plot)?;
    }
    let plot = positions_plot(number, flight);
    value_curves(&dir.join(format!("{number:03}_positions.png")), &plot)
}

/// The spin of short runs of orientations, and the fitted motion with its band.
fn spin_plot(number: usize, flight: &Flight, spin: &SpinEstimate) -> ValuePlot {
    let [from, to] = spin.span_s();
    let half = |fit: &Fit| Z95 * fit.magnitude_std_rad_s().unwrap_or(0.0) / TAU;
    let curve = |name: String, sign: f64| {
        let at = |k: usize| {
            let time_s = from + (to - from) * k as f64 / SECTIONS as f64;
            let fit = spin.at(time_s);
            (time_s, fit.motion.rps() + sign * half(&fit))
        };
        LineSeries {
            name,
            points: (0..=SECTIONS).map(at).collect(),
        }
    };
    let config = &flight.config;
    let measurements = flight.measurements();
    let length = (measurements.len() / RUNS).clamp(MIN_FRAMES, config.window);
    // A flight too short for a run has the fit alone.
    let runs = spin_over_time(&measurements, length, config).unwrap_or_default();
    let points: Vec<ValuePoint> = runs
        .iter()
        .map(|run| interval(run.time_s, run.fit.motion.rps(), half(&run.fit)))
        .collect();
    let runs = ValueSeries {
        name: format!("runs of {length} orientations, 95 % intervals"),
        points,
    };
    ValuePlot {
        title: format!("Flight {number}: spin"),
        x_label: "time (s)".into(),
        y_label: "spin (revolutions per second)".into(),
        values: Some(runs)
            .filter(|runs| !runs.points.is_empty())
            .into_iter()
            .collect(),
        lines: vec![
            curve(
                format!("{} spin, with its 95 % band", spin.motion.model()),
                0.0,
            ),
            curve(String::new(), -1.0),
            curve(String::new(), 1.0),
        ],
    }
}

/// A value with the half-width of its interval.
fn interval(x: f64, y: f64, half: f64) -> ValuePoint {
    ValuePoint {
        x,
        y,
        low: y - half,
        high: y + half,
    }
}

/// The coordinates over time, from the first position on.
fn positions_plot(number: usize, flight: &Flight) -> ValuePlot {
    let rows = flight.file.rows.iter();
    let placed: Vec<(f64, Vec3, Matrix3<f64>)> = rows
        .filter_map(|row| {
            let position = row.position?;
            Some((row.time_s, position.center_m, position.covariance))
        })
        .collect();
    let first = placed.first().map_or(Vec3::zeros(), |p| p.1);
    let axis = |(k, name): (usize, &str)| {
        let points = placed.iter().map(|(time_s, center, covariance)| {
            interval(
                *time_s,
                center[k] - first[k],
                Z95 * covariance[(k, k)].max(0.0).sqrt(),
            )
        });
        ValueSeries {
            name: format!("{name}, from {:.3} m on", first[k]),
            points: points.collect(),
        }
    };
    ValuePlot {
        title: format!("Flight {number}: positions"),
        x_label: "time (s)".into(),
        y_label: "coordinates from the first position on (m), 95 % intervals".into(),
        values: ["x", "y", "z"].into_iter().enumerate().map(axis).collect(),
        lines: Vec::new(),
    }
}
