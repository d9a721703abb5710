//! Plots of measured values with intervals over a parameter, and of curves beside them.

use std::path::Path;

use super::axis::{Axis, Unit};
use super::canvas::{Key, LegendSign, chart, color, picture, stroke, titled, with_legend};
use super::curves::{CURVES_SIZE, LineSeries, draw_rates};
use crate::error::{Error, Result};
use plotters::prelude::PathElement;

/// A value measured at `x`, with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValuePoint {
    /// Abscissa, in the unit that the plot's `x_label` states.
    pub x: f64,
    /// The value, in the unit that the plot's `y_label` states.
    pub y: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

/// A named sequence of measured values.
#[derive(Debug, Clone, PartialEq)]
pub struct ValueSeries {
    /// Its name in the legend.
    pub name: String,
    /// The points.
    pub points: Vec<ValuePoint>,
}

/// Values over a parameter, for [`value_curves`].
#[derive(Debug, Clone, PartialEq)]
pub struct ValuePlot {
    /// Title of the plot.
    pub title: String,
    /// Label of the horizontal axis, with its unit.
    pub x_label: String,
    /// Label of the vertical axis, with its unit.
    pub y_label: String,
    /// What was measured: marks with whiskers, not joined.
    pub values: Vec<ValueSeries>,
    /// Curves over the same axes.
    pub lines: Vec<LineSeries>,
}

/// Draws measured values with their intervals, and curves.
///
/// # Errors
/// [`Error::Argument`] for no points at all, numbers that are not finite, or values outside their
/// intervals; [`Error::Write`] where the file cannot be written.
pub fn value_curves(path: &Path, plot: &ValuePlot) -> Result<()> {
    let points = || plot.values.iter().flat_map(|s| &s.points);
    for p in points() {
        if !(p.low <= p.y && p.y <= p.high) {
            let problem = format!(
                "expected low <= y <= high, found {} <= {} <= {}",
                p.low, p.y, p.high
            );
            return Err(Error::argument("values", problem));
        }
    }
    let lined = || plot.lines.iter().flat_map(|s| &s.points);
    let xs = points().map(|p| p.x).chain(lined().map(|p| p.0));
    let ys = points().flat_map(|p| [p.low, p.high]);
    let ys = ys.chain(lined().map(|p| p.1));
    let unbounded = (f64::NEG_INFINITY, f64::INFINITY);
    let x = Axis::linear("x", xs, Unit::Plain, unbounded)?;
    let y = Axis::linear("y", ys, Unit::Plain, unbounded)?;
    let measured = plot.values.len();
    picture(path, CURVES_SIZE, |root| {
        let area = titled(root, &plot.title)?;
        let key = |name: &String, sign| Key {
            name: name.clone(),
            sign,
        };
        let values = plot.values.iter().enumerate();
        let mut keys: Vec<Key> = values
            .map(|(i, s)| key(&s.name, LegendSign::Series(i)))
            .collect();
        let lines = plot.lines.iter().enumerate();
        keys.extend(lines.map(|(i, s)| key(&s.name, LegendSign::Line(measured + i))));
        let area = with_legend(&area, &keys)?;
        let axes = ((&x, &*plot.x_label), (&y, &*plot.y_label));
        let chart = chart(&area, axes.0, axes.1, (true, true))?;
        let at = |x: f64, y: f64| chart.backend_coord(&(x, y));
        for (i, series) in plot.lines.iter().enumerate() {
            let drawn: Vec<_> = series.points.iter().map(|p| at(p.0, p.1)).collect();
            root.draw(&PathElement::new(drawn, stroke(color(measured + i), 2.0)))?;
        }
        for (i, series) in plot.values.iter().enumerate() {
            let drawn: Vec<_> = series
                .points
                .iter()
                .map(|p| [p.low, p.y, p.high].map(|v| at(p.x, v)))
                .collect();
            draw_rates(root, i, &drawn, false)?;
        }
        Ok(())
    })
}
