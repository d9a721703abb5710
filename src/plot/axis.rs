//! Axes: the range that shows the data, round ticks in it, and their labels.

use std::ops::Range;

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};

use crate::error::{Error, Result};

/// Fraction of the data's span left free at either end.
const MARGIN: f64 = 0.05;
/// About how many ticks an axis gets.
const TICKS: f64 = 7.0;

/// How values are written at the ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unit {
    /// As they are.
    Plain,
    /// Fractions, in percent.
    Percent,
}

/// How values become positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scale {
    /// Themselves.
    Linear,
    /// Their decimal logarithms.
    Log,
    /// Their square roots.
    Root,
}

/// An axis. Positions are the values, their decimal logarithms or their square roots.
#[derive(Debug, Clone)]
pub(super) struct Axis {
    /// Lower end, as a position.
    pub low: f64,
    /// Upper end, as a position.
    pub high: f64,
    /// Where labels stand, as positions.
    pub ticks: Vec<f64>,
    scale: Scale,
    unit: Unit,
    decimals: usize,
}

impl Axis {
    /// A linear axis that shows all `values` with a margin, kept within `bounds`.
    ///
    /// # Errors
    /// [`Error::Argument`] for no values, or values that no axis can show.
    pub fn linear(
        name: &str,
        values: impl Iterator<Item = f64>,
        unit: Unit,
        bounds: (f64, f64),
    ) -> Result<Self> {
        let (low, high) = span(name, values)?;
        // A constant still needs an axis of some length.
        let pad = match MARGIN * (high - low) {
            p if p > 0.0 && p > 1e-9 * low.abs().max(high.abs()) => p,
            _ if unit == Unit::Percent => 0.01,
            _ => 0.1 * low.abs().max(high.abs()).max(1e-9),
        };
        let (low, high) = ((low - pad).max(bounds.0), (high + pad).min(bounds.1));
        Ok(Self::linear_exactly(low, high, unit))
    }

    /// A linear axis from `low` to `high` (finite, `low < high`).
    pub fn linear_exactly(low: f64, high: f64, unit: Unit) -> Self {
        let rough = (high - low) / TICKS;
        let decade = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .map(|m| m * decade)
            .into_iter()
            .find(|s| *s >= rough * 0.999)
            .unwrap_or(rough);
        let first = (low / step - 1e-6).ceil();
        let count = ((high / step + 1e-6).floor() - first).clamp(0.0, 20.0) as usize;
        let shown = match unit {
            Unit::Plain => step,
            Unit::Percent => 100.0 * step,
        };
        Self {
            low,
            high,
            ticks: (0..=count).map(|i| (first + i as f64) * step).collect(),
            scale: Scale::Linear,
            unit,
            decimals: (-(shown.log10() + 1e-9).floor()).clamp(0.0, 12.0) as usize,
        }
    }

    /// The axis of whole numbers: ticks stand at these only.
    pub fn whole(mut self) -> Self {
        self.ticks.retain(|t| (t - t.round()).abs() < 1e-9);
        self.decimals = 0;
        self
    }

    /// A logarithmic axis from `low` to `high` (finite, `0 < low < high`).
    pub fn logarithmic(low: f64, high: f64, unit: Unit) -> Self {
        let (low, high) = (low.log10(), high.log10());
        let multiples: &[f64] = match high - low {
            d if d < 0.5 => &[1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
            d if d < 1.2 => &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0],
            d if d < 3.2 => &[1.0, 2.0, 5.0],
            _ => &[1.0],
        };
        let stride = ((high - low) / 10.0).ceil().max(1.0) as i32;
        let ticks = (low.floor() as i32..=high.ceil() as i32)
            .filter(|e| e % stride == 0)
            .flat_map(|e| multiples.iter().map(move |m| f64::from(e) + m.log10()))
            .filter(|t| (low - 1e-9..=high + 1e-9).contains(t))
            .collect();
        Self {
            low,
            high,
            ticks,
            scale: Scale::Log,
            unit,
            decimals: 0,
        }
    }

    /// An axis of square roots from 0 to `high` (finite, positive).
    fn roots(high: f64, unit: Unit) -> Self {
        const ROUND: [f64; 15] = [
            0.0, 1e-4, 5e-4, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.75, 1.0,
        ];
        let end = high.sqrt();
        let mut ticks: Vec<f64> = Vec::new();
        for tick in ROUND.map(f64::sqrt).into_iter().filter(|t| *t <= end) {
            if ticks.last().is_none_or(|last| tick - last > end / 11.0) {
                ticks.push(tick);
            }
        }
        Self {
            low: 0.0,
            high: end,
            ticks,
            scale: Scale::Root,
            unit,
            decimals: 0,
        }
    }

    /// Where `value` stands; off a logarithmic axis' lower end there is only that end.
    pub fn position(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => value,
            Scale::Root => value.max(0.0).sqrt(),
            Scale::Log if value > 0.0 => value.log10().max(self.low),
            Scale::Log => self.low,
        }
    }

    /// The label of the tick at `position`.
    pub fn label(&self, position: f64) -> String {
        let value = match self.scale {
            Scale::Linear => position,
            Scale::Log => 10f64.powf(position),
            Scale::Root => position * position,
        };
        match (self.unit, self.scale != Scale::Linear) {
            (Unit::Percent, true) => format!("{} %", significant(100.0 * value)),
            (Unit::Percent, false) => format!("{:.*} %", self.decimals, 100.0 * value),
            (Unit::Plain, true) => significant(value),
            (Unit::Plain, false) if value.abs() >= 1e6 => significant(value),
            (Unit::Plain, false) if self.decimals > 5 && value != 0.0 => significant(value),
            // Minus zero reads oddly.
            (Unit::Plain, false) => format!("{:.*}", self.decimals, value + 0.0),
        }
    }
}

impl Ranged for Axis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, position: &f64, limit: (i32, i32)) -> i32 {
        let part = (position - self.low) / (self.high - self.low);
        limit.0 + (part * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

/// A linear axis, or for failures one of square roots, for rates that are drawn as fractions.
///
/// # Errors
/// As [`Axis::linear`].
pub(super) fn rate_axis(
    name: &str,
    scale: super::RateScale,
    points: &[super::RatePoint],
) -> Result<Axis> {
    let values = || points.iter().flat_map(|p| p.on(scale));
    if scale == super::RateScale::Success {
        return Axis::linear(name, values(), Unit::Percent, (0.0, 1.0));
    }
    let (_, max) = span(name, values())?;
    // Below a thousandth, only zero would be distinguished from the rest.
    let high = (max * 1.1).clamp(1e-3, 1.0);
    Ok(Axis::roots(high, Unit::Percent))
}

/// Minimum and maximum of `values`.
fn span(name: &str, values: impl Iterator<Item = f64>) -> Result<(f64, f64)> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for v in values {
        if !v.is_finite() {
            return Err(Error::argument(name.to_owned(), "expected finite numbers"));
        }
        (low, high) = (low.min(v), high.max(v));
    }
    if low > high {
        return Err(Error::argument(name.to_owned(), "there is nothing to draw"));
    }
    if high.max(-low) > 1e300 {
        return Err(Error::argument(
            name.to_owned(),
            "numbers above 1e300 cannot be drawn",
        ));
    }
    Ok((low, high))
}

/// `value` with at most three significant digits, in powers of ten where it is long otherwise.
pub(super) fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value:.0}");
    }
    let exponent = (value.abs() * 1.000_000_1).log10().floor() as i32;
    if !(-4..6).contains(&exponent) {
        let mantissa = value / 10f64.powi(exponent);
        return format!("{}e{exponent}", trimmed(format!("{mantissa:.2}")));
    }
    let decimals = (2 - exponent).max(0) as usize;
    trimmed(format!("{value:.decimals$}"))
}

/// A rate as a number of percent, with enough decimals that neither 0 nor 100 is shown for anything
/// else.
pub(super) fn percent(rate: f64) -> String {
    let value = 100.0 * rate;
    let rest = value.min(100.0 - value);
    if rest <= 0.0 {
        return format!("{value:.0}");
    }
    let decimals = (1.0 - rest.log10().floor()).clamp(1.0, 6.0) as usize;
    format!("{value:.decimals$}")
}

/// Without zeros behind the decimal point.
fn trimmed(text: String) -> String {
    if !text.contains('.') {
        return text;
    }
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::linear_exactly(0.93, 1.0, Unit::Percent);
        assert_eq!(axis.label(axis.ticks[0]), "93 %");
        assert!(axis.ticks.iter().all(|t| (0.929..=1.001).contains(t)));
        let axis = Axis::logarithmic(0.0007, 5.0, Unit::Percent);
        let labels: Vec<_> = axis.ticks.iter().map(|t| axis.label(*t)).collect();
        assert_eq!(labels, ["0.1 %", "1 %", "10 %", "100 %"]);
    }

    #[test]
    fn failures_have_a_place_for_none() {
        let point = |rate: f64| crate::plot::RatePoint {
            x: 0.0,
            rate,
            // As a computed interval may be: a little off.
            low: rate - 1e-4 * rate,
            high: rate + 1e-16,
        };
        let axis = |points: &[_]| {
            rate_axis("rates", crate::plot::RateScale::Failure, points).expect("there are points")
        };
        for points in [&[point(1.0)][..], &[point(1.0), point(0.3)]] {
            let axis = axis(points);
            assert_eq!(axis.label(axis.position(0.0)), "0 %");
            assert!(axis.position(0.7) > axis.position(0.2) && axis.ticks.len() > 2);
        }
        let labels =
            |axis: Axis| -> Vec<String> { axis.ticks.iter().map(|t| axis.label(*t)).collect() };
        assert_eq!(
            labels(axis(&[point(0.52)])),
            ["0 %", "0.5 %", "2 %", "5 %", "10 %", "20 %", "30 %", "50 %"]
        );
    }

    #[test]
    fn constants_and_extremes_have_an_axis() {
        for values in [[0.0; 2], [5.0; 2], [1e-12, 1e-12], [-1e300, 1e300]] {
            let axis = Axis::linear("x", values.into_iter(), Unit::Plain, (-1e301, 1e301))
                .expect("finite numbers have an axis");
            assert!(axis.low < axis.high && !axis.ticks.is_empty(), "{axis:?}");
        }
        assert!(
            Axis::linear("x", [f64::NAN].into_iter(), Unit::Plain, (0.0, 1.0))
                .is_err_and(|e| e.is_usage())
        );
        assert!(Axis::linear("x", std::iter::empty(), Unit::Plain, (0.0, 1.0)).is_err());
    }

    #[test]
    fn numbers_are_short() {
        let written = [0.25, 1.0, 12.34, 1e-7, 123_456.0, 2.5e9].map(significant);
        assert_eq!(written, ["0.25", "1", "12.3", "1e-7", "123456", "2.5e9"]);
        let written = [0.0, 0.0002, 0.41, 0.956, 0.9998, 1.0].map(percent);
        assert_eq!(written, ["0", "0.020", "41.0", "95.6", "99.980", "100"]);
    }
}
