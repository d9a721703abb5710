//! Rates in groups with intervals: bars, or for failures marks, since lengths on an axis of square roots
//! compare nothing.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::axis::{Axis, Unit, percent, rate_axis};
use super::canvas::{
    Area, Drawn, INK, Key, LABEL, LegendSign, SMALL, chart, color, fitted, font, mark, picture, px,
    stroke, text, text_width, titled, with_legend,
};
use super::curves::whisker;
use super::{RatePoint, RateScale};
use crate::error::{Error, Result};

/// Width and height of [`bar_comparison`]'s picture, pixels.
pub const BARS_SIZE: (u32, u32) = (1100, 640);

/// Part of a group's width that its bars fill.
const FILLED: f64 = 0.8;

/// Rates that belong together, such as those of one protocol.
#[derive(Debug, Clone, PartialEq)]
pub struct BarGroup {
    /// Its name beneath the bars.
    pub name: String,
    /// One rate a series, in the order of [`BarChart::series`]; `None` where there is none. The
    /// points' `x` plays no part.
    pub rates: Vec<Option<RatePoint>>,
}

/// Rates by group and series, for [`bar_comparison`].
#[derive(Debug, Clone, PartialEq)]
pub struct BarChart {
    /// Title of the plot.
    pub title: String,
    /// Label of the vertical axis; percent signs stand at its ticks.
    pub y_label: String,
    /// Whether rates or failure rates are drawn: `y_label` should say the same.
    pub scale: RateScale,
    /// Names of the series (pattern or recognizer) in the legend.
    pub series: Vec<String>,
    /// The groups, from left to right.
    pub groups: Vec<BarGroup>,
}

impl BarChart {
    /// The rates, each one checked.
    fn points(&self) -> Result<Vec<RatePoint>> {
        let mut points = Vec::new();
        for group in &self.groups {
            let place = format!("group \"{}\"", group.name);
            if group.rates.len() != self.series.len() {
                let problem = format!(
                    "expected a rate for each of {} series, found {}",
                    self.series.len(),
                    group.rates.len()
                );
                return Err(Error::argument(place, problem));
            }
            for rate in group.rates.iter().flatten() {
                RatePoint { x: 0.0, ..*rate }.check(&place)?;
                points.push(*rate);
            }
        }
        Ok(points)
    }
}

/// Draws groups of bars (marks on [`RateScale::Failure`]) with 95 % whiskers and the rates above them.
///
/// # Errors
/// [`Error::Argument`] for no rates at all, a group without a place for each series, or rates
/// outside their intervals or [0, 1]; [`Error::Write`] where the file cannot be written.
pub fn bar_comparison(path: &Path, plot: &BarChart) -> Result<()> {
    let mut y = rate_axis("rates", plot.scale, &plot.points()?)?;
    if plot.scale == RateScale::Success {
        // Lengths of bars are compared: they start from nothing.
        y = Axis::linear_exactly(0.0, y.high, Unit::Percent);
    }
    let groups = plot.groups.len();
    let mut x = Axis::linear_exactly(0.0, groups as f64, Unit::Plain);
    x.ticks.clear();
    picture(path, BARS_SIZE, |root| {
        let area = titled(root, &plot.title)?;
        let keys: Vec<_> = plot
            .series
            .iter()
            .enumerate()
            .map(|(i, name)| Key {
                name: name.clone(),
                sign: match plot.scale {
                    RateScale::Success => LegendSign::Box(i),
                    RateScale::Failure => LegendSign::Series(i),
                },
            })
            .collect();
        let area = with_legend(&area, &keys)?;
        let chart = chart(&area, (&x, ""), (&y, &plot.y_label), (false, true))?;
        let at = |x: f64, position: f64| chart.backend_coord(&(x, position));
        for (g, group) in plot.groups.iter().enumerate() {
            draw_group(root, plot, (g, group), &y, &at)?;
            let (x, bottom) = at(g as f64 + 0.5, y.low);
            let at = (x, bottom + px(24.0));
            let available = chart.plotting_area().dim_in_pixel().0 as usize / groups;
            let size = if text_width(&group.name, LABEL) > available as i32 {
                SMALL * 0.8
            } else {
                LABEL
            };
            let name = fitted(&group.name, &font(size), available as i32);
            text(root, &name, at, HPos::Center, size, INK)?;
        }
        Ok(())
    })
}

/// Draws the bars of group number `g`.
fn draw_group(
    root: &Area<'_>,
    plot: &BarChart,
    (g, group): (usize, &BarGroup),
    y: &Axis,
    at: &dyn Fn(f64, f64) -> (i32, i32),
) -> Drawn {
    let width = FILLED / plot.series.len() as f64;
    for (i, point) in group.rates.iter().enumerate() {
        let Some(point) = point else { continue };
        let left = g as f64 + (1.0 - FILLED) / 2.0 + i as f64 * width;
        let [rate, low, high] = point.on(plot.scale);
        let corners = [
            at(left + 0.06 * width, y.position(rate)),
            at(left + 0.94 * width, y.low),
        ];
        let middle = left + width / 2.0;
        let ends = [low, high].map(|v| at(middle, y.position(v)));
        let mut top = ends[0].1.min(ends[1].1);
        match plot.scale {
            RateScale::Success => {
                root.draw(&Rectangle::new(corners, color(i).mix(0.85).filled()))?;
                whisker(root, ends[0], ends[1], stroke(INK, 1.4))?;
            }
            RateScale::Failure => {
                whisker(root, ends[0], ends[1], stroke(color(i), 2.0))?;
                let place = at(middle, y.position(rate));
                mark(root, i, place)?;
                top = top.min(place.1 - px(5.0));
            }
        }
        let label = percent(rate);
        let available = at(left + width, y.low).0 - at(left, y.low).0;
        let size = if text_width(&label, SMALL) > available {
            SMALL * 0.75
        } else {
            SMALL
        };
        let place = (at(middle, y.low).0, top - px(12.0));
        text(root, &label, place, HPos::Center, size, INK)?;
    }
    Ok(())
}
