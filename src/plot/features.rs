//! The features of a pattern in hash space, and how far each is from its nearest neighbor.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::axis::{Axis, Unit, significant};
use super::canvas::{
    Area, Drawn, GRID, INK, Key, LegendSign, SMALL, chart, color, picture, px, stroke, text,
    titled, with_legend,
};
use crate::error::{Error, Result};

/// Width and height of [`feature_plot`]'s picture, pixels.
pub const FEATURES_SIZE: (u32, u32) = (1280, 1060);

/// Quantiles between which the axes of the projections lie: a few bases are close to singular, and
/// their features far out.
const SHOWN: (f64, f64) = (0.01, 0.99);
/// Number of the histogram's bins.
const BINS: usize = 60;
/// Distances below this part of the median count as this much: a logarithm needs an end.
const MIN_PART: f64 = 1e-6;

/// Draws features in hash space: two projections, colored by the distance to the nearest other
/// feature, and the histogram of these distances with their mean.
///
/// Hash coordinates and distances have no unit. Axes span most of the features and say how many lie
/// outside.
///
/// # Errors
/// [`Error::Argument`] for no features, numbers that are not finite, negative distances, or not one
/// distance a feature; [`Error::Write`] where the file cannot be written.
pub fn feature_plot(
    path: &Path,
    features: &[[f64; 3]],
    nearest_distance: &[f64],
    title: &str,
) -> Result<()> {
    if features.len() != nearest_distance.len() {
        let problem = format!(
            "expected one for each of {} features, found {}",
            features.len(),
            nearest_distance.len()
        );
        return Err(Error::argument("nearest distances", problem));
    }
    if nearest_distance.iter().any(|d| *d < 0.0) {
        let problem = "expected distances that are not negative";
        return Err(Error::argument("nearest distances", problem));
    }
    let distances = Distances::new(nearest_distance)?;
    let axes = [
        feature_axis(features, 0)?,
        feature_axis(features, 1)?,
        feature_axis(features, 2)?,
    ];
    picture(path, FEATURES_SIZE, |root| {
        let area = titled(root, title)?;
        let (top, bottom) = area.split_vertically(px(590.0));
        let (plots, bar) = top.split_horizontally(px(1150.0));
        for (plot, other) in plots.split_evenly((1, 2)).iter().zip([1, 2]) {
            draw_projection(root, plot, features, &distances, &axes, other)?;
        }
        draw_color_bar(&bar, &distances)?;
        draw_histogram(root, &bottom, &distances)
    })
}

/// Distances with what is needed to color and count them.
struct Distances<'a> {
    values: &'a [f64],
    /// Minimum distance that is distinguished from zero.
    floor: f64,
    mean: f64,
    median: f64,
    /// Decimal logarithms of the ends of the color scale.
    colors: (f64, f64),
}

impl<'a> Distances<'a> {
    fn new(values: &'a [f64]) -> Result<Self> {
        // Checks that there are some, and that they are finite.
        Axis::linear(
            "nearest distances",
            values.iter().copied(),
            Unit::Plain,
            (0.0, f64::INFINITY),
        )?;
        let sorted = sorted(values.iter().copied());
        let median = quantile(&sorted, 0.5);
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        // Where most distances are zero the mean, and where all are any number, gives the scale.
        let scale = [median, mean].into_iter().find(|d| *d > 0.0);
        let floor = MIN_PART * scale.unwrap_or(1.0);
        let log = |q: f64| quantile(&sorted, q).max(floor).log10();
        let (low, high) = (log(0.02), log(0.98));
        Ok(Self {
            values,
            floor,
            mean,
            median,
            colors: (low, high.max(low + 0.1)),
        })
    }

    /// Color of a distance given by its decimal logarithm.
    fn color(&self, log: f64) -> RGBColor {
        let (low, high) = self.colors;
        viridis((log - low) / (high - low))
    }
}

/// `values` in ascending order.
fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// The quantile `q` of sorted values (at least one).
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let last = sorted.len().saturating_sub(1);
    sorted
        .get((q * last as f64).round() as usize)
        .copied()
        .unwrap_or(0.0)
}

/// The axis of hash coordinate `i`.
fn feature_axis(features: &[[f64; 3]], i: usize) -> Result<Axis> {
    let name = format!("features, coordinate h{}", i + 1);
    let bounds = (f64::NEG_INFINITY, f64::INFINITY);
    let all = features.iter().map(|f| f[i]);
    Axis::linear(&name, all.clone(), Unit::Plain, bounds)?;
    let sorted = sorted(all);
    let ends = [quantile(&sorted, SHOWN.0), quantile(&sorted, SHOWN.1)];
    Axis::linear(&name, ends.into_iter(), Unit::Plain, bounds)
}

/// Scatters h1 against hash coordinate `other`.
fn draw_projection(
    root: &Area<'_>,
    area: &Area<'_>,
    features: &[[f64; 3]],
    distances: &Distances<'_>,
    axes: &[Axis; 3],
    other: usize,
) -> Drawn {
    let (x, y) = (&axes[0], &axes[other]);
    let (note_area, area) = area.split_vertically(px(28.0));
    let y_label = format!("h{} (no unit)", other + 1);
    let chart = chart(&area, (x, "h1 (no unit)"), (y, &y_label), (true, true))?;
    // The loneliest last, so that they are not buried.
    let mut order: Vec<usize> = (0..features.len()).collect();
    order.sort_by(|a, b| distances.values[*a].total_cmp(&distances.values[*b]));
    let mut outside = 0;
    for i in order {
        let at = (features[i][0], features[i][other]);
        if !(x.low..=x.high).contains(&at.0) || !(y.low..=y.high).contains(&at.1) {
            outside += 1;
            continue;
        }
        let color = distances.color(distances.values[i].max(distances.floor).log10());
        root.draw(&Circle::new(
            chart.backend_coord(&at),
            px(1.8),
            color.filled(),
        ))?;
    }
    let note = format!(
        "{} of {} features lie outside the axes ({} %)",
        outside,
        features.len(),
        significant(100.0 * f64::from(outside) / features.len() as f64)
    );
    let at = (note_area.dim_in_pixel().0 as i32 / 2 + px(30.0), px(16.0));
    text(&note_area, &note, at, HPos::Center, SMALL, INK)
}

/// The color scale of the distances, at the left of `area`.
fn draw_color_bar(area: &Area<'_>, distances: &Distances<'_>) -> Drawn {
    let (left, right) = (px(8.0), px(30.0));
    let (top, bottom) = (px(76.0), px(528.0));
    let (low, high) = distances.colors;
    for y in top..=bottom {
        let part = f64::from(bottom - y) / f64::from(bottom - top);
        let color = distances.color(low + part * (high - low));
        area.draw(&Rectangle::new([(left, y), (right, y + 1)], color.filled()))?;
    }
    let axis = Axis::logarithmic(10f64.powf(low), 10f64.powf(high), Unit::Plain);
    for tick in &axis.ticks {
        let y = bottom - ((tick - low) / (high - low) * f64::from(bottom - top)).round() as i32;
        area.draw(&PathElement::new(
            vec![(right, y), (right + px(5.0), y)],
            stroke(INK, 1.0),
        ))?;
        let at = (right + px(9.0), y);
        text(area, &axis.label(*tick), at, HPos::Left, SMALL, INK)?;
    }
    text(
        area,
        "distance to",
        (left, px(18.0)),
        HPos::Left,
        SMALL,
        INK,
    )?;
    text(
        area,
        "the nearest",
        (left, px(36.0)),
        HPos::Left,
        SMALL,
        INK,
    )?;
    text(area, "(no unit)", (left, px(54.0)), HPos::Left, SMALL, INK)
}

/// Counts the distances in bins that are equally wide on a logarithmic axis.
fn draw_histogram(root: &Area<'_>, area: &Area<'_>, distances: &Distances<'_>) -> Drawn {
    let sorted = sorted(distances.values.iter().map(|d| d.max(distances.floor)));
    // A handful of extreme distances would squeeze the rest: they are counted in the outermost
    // bins.
    let low = quantile(&sorted, 0.002).min(distances.mean.max(distances.floor));
    let high = quantile(&sorted, 0.998).max(distances.mean);
    let x = Axis::logarithmic(low / 1.1, high.max(low * 1.2) * 1.1, Unit::Plain);
    let mut counts = [0usize; BINS];
    for d in &sorted {
        let part = (d.log10() - x.low) / (x.high - x.low);
        counts[((part * BINS as f64).max(0.0) as usize).min(BINS - 1)] += 1;
    }
    let highest = counts.iter().copied().max().unwrap_or(1);
    let y = Axis::linear_exactly(0.0, (highest as f64 * 1.06).max(5.0), Unit::Plain);
    let keys = [
        ("mean", distances.mean, LegendSign::Line(1)),
        ("median", distances.median, LegendSign::Line(2)),
    ]
    .map(|(name, value, sign)| Key {
        name: format!("{name} {}", significant(value)),
        sign,
    });
    let area = with_legend(area, &keys)?;
    let label = "distance to the nearest other feature in hash space (no unit)";
    let chart = chart(&area, (&x, label), (&y, "features"), (true, true))?;
    let width = (x.high - x.low) / BINS as f64;
    for (i, count) in counts.iter().enumerate() {
        let left = x.low + i as f64 * width;
        let corners = [(left, *count as f64), (left + width, 0.0)].map(|p| chart.backend_coord(&p));
        root.draw(&Rectangle::new(corners, color(0).mix(0.8).filled()))?;
        root.draw(&Rectangle::new(corners, stroke(GRID, 0.5)))?;
    }
    for (i, value) in [(1, distances.mean), (2, distances.median)] {
        let ends = [y.low, y.high].map(|v| chart.backend_coord(&(x.position(value), v)));
        root.draw(&PathElement::new(ends.to_vec(), stroke(color(i), 2.5)))?;
    }
    Ok(())
}

/// The viridis color map (S. van der Walt, N. Smith, 2015; public domain), interpolated between
/// eight of its colors and without its palest end, hard to see on white; `part` is clamped to [0,
/// 1].
fn viridis(part: f64) -> RGBColor {
    const COLORS: [[f64; 3]; 8] = [
        [68.0, 1.0, 84.0],
        [71.0, 44.0, 122.0],
        [59.0, 81.0, 139.0],
        [44.0, 113.0, 142.0],
        [33.0, 144.0, 141.0],
        [39.0, 173.0, 129.0],
        [92.0, 200.0, 99.0],
        [170.0, 220.0, 50.0],
    ];
    let at = part.clamp(0.0, 1.0) * (COLORS.len() - 1) as f64;
    let i = (at as usize).min(COLORS.len() - 2);
    let t = at - i as f64;
    let [r, g, b] = [0, 1, 2].map(|c| {
        let v = COLORS[i][c] + t * (COLORS[i + 1][c] - COLORS[i][c]);
        v.round() as u8
    });
    RGBColor(r, g, b)
}
