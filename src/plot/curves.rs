//! Rates over a parameter with their intervals, predicted against observed rates, and points.

use std::path::Path;

use plotters::prelude::*;

use super::axis::{Axis, Unit, rate_axis};
use super::canvas::{
    Area, Chart, Drawn, GRAY, Key, LegendSign, chart, color, mark, picture, px, stroke, titled,
    with_legend,
};
use super::{RatePoint, RateScale};
use crate::error::{Error, Result};

/// Width and height of the pictures of [`rate_curves`] and [`scatter_plot`], pixels.
pub const CURVES_SIZE: (u32, u32) = (1000, 640);
/// Width and height of [`reliability_plot`]'s picture, pixels.
pub const RELIABILITY_SIZE: (u32, u32) = (760, 780);

/// Everything on the line: no bound.
const UNBOUNDED: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

/// A named sequence of measured rates.
#[derive(Debug, Clone, PartialEq)]
pub struct RateSeries {
    /// Its name in the legend.
    pub name: String,
    /// The points, in the order in which they are joined.
    pub points: Vec<RatePoint>,
}

/// Rates over a parameter, for [`rate_curves`].
#[derive(Debug, Clone, PartialEq)]
pub struct CurvePlot {
    /// Title of the plot.
    pub title: String,
    /// Label of the horizontal axis, with its unit.
    pub x_label: String,
    /// Label of the vertical axis; percent signs stand at its ticks.
    pub y_label: String,
    /// Whether rates or failure rates are drawn: `y_label` should say the same.
    pub scale: RateScale,
    /// Whether the horizontal axis is logarithmic; every x must then be positive.
    pub log_x: bool,
    /// The curves.
    pub series: Vec<RateSeries>,
}

/// Predicted against observed rates, for [`reliability_plot`].
#[derive(Debug, Clone, PartialEq)]
pub struct ReliabilityPlot {
    /// Title of the plot.
    pub title: String,
    /// Label of the predicted probability's axis; percent signs stand at its ticks.
    pub x_label: String,
    /// Label of the observed rate's axis.
    pub y_label: String,
    /// The points: `x` is the predicted probability in [0, 1], the rate what was observed.
    pub series: Vec<RateSeries>,
}

/// A named sequence of points.
#[derive(Debug, Clone, PartialEq)]
pub struct LineSeries {
    /// Its name in the legend.
    pub name: String,
    /// The points (x, y), in the order in which they are joined, in the units of the plot's labels.
    pub points: Vec<(f64, f64)>,
}

/// Points, for [`scatter_plot`].
#[derive(Debug, Clone, PartialEq)]
pub struct ScatterPlot {
    /// Title of the plot.
    pub title: String,
    /// Label of the horizontal axis, with its unit.
    pub x_label: String,
    /// Label of the vertical axis, with its unit.
    pub y_label: String,
    /// The points; those of a series look alike.
    pub series: Vec<LineSeries>,
}

/// Draws rates over a parameter as curves with 95 % bands.
///
/// # Errors
/// [`Error::Argument`] for no points at all, numbers that are not finite, or rates outside their
/// intervals or [0, 1]; [`Error::Write`] where the file cannot be written.
pub fn rate_curves(path: &Path, plot: &CurvePlot) -> Result<()> {
    let points = checked(&plot.series)?;
    let xs = points.iter().map(|p| p.x);
    // Ranks and rounds have no halves.
    let is_whole = xs.clone().all(|x| x == x.round());
    let x = match (plot.log_x, is_whole) {
        (true, _) => logarithmic("x", xs)?,
        (false, true) => Axis::linear("x", xs, Unit::Plain, UNBOUNDED)?.whole(),
        (false, false) => Axis::linear("x", xs, Unit::Plain, UNBOUNDED)?,
    };
    let y = rate_axis("rates", plot.scale, &points)?;
    picture(path, CURVES_SIZE, |root| {
        let area = titled(root, &plot.title)?;
        let keys = keys(plot.series.iter().map(|s| &s.name), LegendSign::Series);
        let area = with_legend(&area, &keys)?;
        let chart = chart(
            &area,
            (&x, &plot.x_label),
            (&y, &plot.y_label),
            (true, true),
        )?;
        for (i, series) in plot.series.iter().enumerate() {
            let drawn: Vec<_> = series
                .points
                .iter()
                .map(|p| {
                    let [rate, low, high] = p.on(plot.scale).map(|v| y.position(v));
                    [low, rate, high].map(|v| chart.backend_coord(&(x.position(p.x), v)))
                })
                .collect();
            draw_rates(root, i, &drawn, true)?;
        }
        Ok(())
    })
}

/// Draws observed rates against predicted probabilities, with the diagonal of a perfect prediction.
///
/// # Errors
/// As [`rate_curves`].
pub fn reliability_plot(path: &Path, plot: &ReliabilityPlot) -> Result<()> {
    let points = checked(&plot.series)?;
    let values = points.iter().flat_map(|p| [p.x, p.low, p.high]);
    // One range for both axes: the diagonal is then one.
    let axis = Axis::linear("predictions", values, Unit::Percent, (0.0, 1.0))?;
    if points.iter().any(|p| !(0.0..=1.0).contains(&p.x)) {
        return Err(Error::argument("predictions", "expected x in [0, 1]"));
    }
    picture(path, RELIABILITY_SIZE, |root| {
        let area = titled(root, &plot.title)?;
        let mut keys = keys(plot.series.iter().map(|s| &s.name), LegendSign::Series);
        keys.push(Key {
            name: "perfectly calibrated".into(),
            sign: LegendSign::Dashes,
        });
        let area = with_legend(&area, &keys)?;
        let axes = ((&axis, &*plot.x_label), (&axis, &*plot.y_label));
        let chart = chart(&area, axes.0, axes.1, (true, true))?;
        draw_diagonal(root, &chart, &axis)?;
        for (i, series) in plot.series.iter().enumerate() {
            let drawn: Vec<_> = series
                .points
                .iter()
                .map(|p| [p.low, p.rate, p.high].map(|v| chart.backend_coord(&(p.x, v))))
                .collect();
            draw_rates(root, i, &drawn, false)?;
        }
        Ok(())
    })
}

/// Draws points, each by a mark.
///
/// # Errors
/// [`Error::Argument`] for no points at all or numbers that are not finite; [`Error::Write`] where the file cannot be
/// written.
pub fn scatter_plot(path: &Path, plot: &ScatterPlot) -> Result<()> {
    let points = || plot.series.iter().flat_map(|s| &s.points);
    let x = Axis::linear("x", points().map(|p| p.0), Unit::Plain, UNBOUNDED)?;
    let y = Axis::linear("y", points().map(|p| p.1), Unit::Plain, UNBOUNDED)?;
    picture(path, CURVES_SIZE, |root| {
        let area = titled(root, &plot.title)?;
        let keys = keys(plot.series.iter().map(|s| &s.name), LegendSign::Series);
        let area = with_legend(&area, &keys)?;
        let axes = ((&x, &*plot.x_label), (&y, &*plot.y_label));
        let chart = chart(&area, axes.0, axes.1, (true, true))?;
        for (i, series) in plot.series.iter().enumerate() {
            for point in &series.points {
                mark(root, i, chart.backend_coord(point))?;
            }
        }
        Ok(())
    })
}

/// A logarithmic axis that shows all `values`.
fn logarithmic(name: &'static str, values: impl Iterator<Item = f64> + Clone) -> Result<Axis> {
    let low = values.clone().fold(f64::INFINITY, f64::min);
    let high = values.fold(0.0, f64::max);
    if !(low > 0.0 && high.is_finite()) {
        let problem = format!("expected positive numbers on a logarithmic axis, found {low}");
        return Err(Error::argument(name, problem));
    }
    Ok(Axis::logarithmic(low / 1.2, high * 1.2, Unit::Plain))
}

/// All points of `series`, each one checked.
fn checked(series: &[RateSeries]) -> Result<Vec<RatePoint>> {
    for s in series {
        for (i, point) in s.points.iter().enumerate() {
            point.check(&format!("series \"{}\", point {i}", s.name))?;
        }
    }
    Ok(series.iter().flat_map(|s| s.points.clone()).collect())
}

/// Legend entries for series; a single one without a name gets none.
fn keys<'a>(names: impl Iterator<Item = &'a String>, sign: fn(usize) -> LegendSign) -> Vec<Key> {
    names
        .enumerate()
        .map(|(i, name)| Key {
            name: name.clone(),
            sign: sign(i),
        })
        .collect()
}

/// Draws one series: (low, rate, high) in pixels. `joined` adds the band and the line.
pub(super) fn draw_rates(
    root: &Area<'_>,
    i: usize,
    points: &[[(i32, i32); 3]],
    joined: bool,
) -> Drawn {
    if joined && points.len() > 1 {
        let there = points.iter().map(|p| p[0]);
        let back = points.iter().rev().map(|p| p[2]);
        let band: Vec<_> = there.chain(back).collect();
        root.draw(&Polygon::new(band, color(i).mix(0.16).filled()))?;
        let line: Vec<_> = points.iter().map(|p| p[1]).collect();
        root.draw(&PathElement::new(line, stroke(color(i), 2.0)))?;
    }
    for [low, rate, high] in points {
        whisker(root, *low, *high, stroke(color(i), 1.3))?;
        mark(root, i, *rate)?;
    }
    Ok(())
}

/// An interval's line with its end bars.
pub(super) fn whisker(
    root: &Area<'_>,
    low: (i32, i32),
    high: (i32, i32),
    style: ShapeStyle,
) -> Drawn {
    root.draw(&PathElement::new(vec![low, high], style))?;
    for (x, y) in [low, high] {
        let bar = vec![(x - px(4.0), y), (x + px(4.0), y)];
        root.draw(&PathElement::new(bar, style))?;
    }
    Ok(())
}

/// A dashed line from the axes' lower ends to their upper ends.
fn draw_diagonal(root: &Area<'_>, chart: &Chart<'_>, axis: &Axis) -> Drawn {
    const DASHES: usize = 40;
    let at = |step: usize| {
        let v = axis.low + (axis.high - axis.low) * step as f64 / (2 * DASHES - 1) as f64;
        chart.backend_coord(&(v, v))
    };
    for dash in 0..DASHES {
        let ends = vec![at(2 * dash), at(2 * dash + 1)];
        root.draw(&PathElement::new(ends, stroke(GRAY, 1.6)))?;
    }
    Ok(())
}
