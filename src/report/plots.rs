//! The plots of a design: the ball, its features, its rates, and how they depend on noise and
//! alpha.

use std::path::Path;

use super::{DesignEvaluation, DesignReport};
use crate::design::Milestone;
use crate::error::Result;
use crate::hash::HashTable;
use crate::plot::{
    BallDrawing, BarChart, BarGroup, CurvePlot, RatePoint, RateScale, RateSeries, bar_comparison,
    feature_plot, pattern_views, rate_curves,
};
use crate::recognize::RecognizerName;
use crate::stencil::StencilConfig;
use crate::validate::{
    NamedValidation, Proportion, ProtocolName, SensitivityPoint, SweptParameter,
};

pub(super) fn point(x: f64, p: &Proportion) -> RatePoint {
    RatePoint {
        x,
        rate: p.rate,
        low: p.low,
        high: p.high,
    }
}

/// Draws all plots of a design into `dir`.
///
/// # Errors
/// [`crate::Error::Write`] on an I/O failure.
pub fn write_all(dir: &Path, design: &DesignEvaluation, stencil: &StencilConfig) -> Result<()> {
    let (table, report) = (&design.table, &design.report);
    ball(&dir.join("pattern.png"), table, stencil)?;
    features(&dir.join("features.png"), table)?;
    rates(&dir.join("rates.png"), &report.validation)?;
    progress(&dir.join("progress.png"), report)?;
    sensitivity_plots(dir, &report.sensitivity)
}

/// The best rate over the time of the search.
fn progress(path: &Path, report: &DesignReport) -> Result<()> {
    let milestones = &report.timing.milestones;
    let Some(first) = milestones.first() else {
        return Ok(());
    };
    let curve = |name: &str, of: &dyn Fn(&Milestone) -> bool| RateSeries {
        name: name.into(),
        points: milestones
            .iter()
            .filter(|m| of(m))
            .map(|m| point(m.elapsed_s / 60.0, &m.identity))
            .collect(),
    };
    let mut series = vec![
        curve("rounds of the search", &|m| m.polished == 0),
        curve("polishing", &|m| m.polished > 0),
    ];
    series.retain(|s| !s.points.is_empty());
    rate_curves(
        path,
        &CurvePlot {
            title: format!(
                "Best pattern so far: failures of {} `{}` views that select nothing",
                first.identity.trials, report.config.protocol.name
            ),
            x_label: "time [min]".into(),
            y_label: "failures".into(),
            scale: RateScale::Failure,
            series,
        },
    )
}

/// The pattern from both sides of the ball.
///
/// # Errors
/// [`crate::Error::Write`] on an I/O failure.
pub fn ball(path: &Path, table: &HashTable, stencil: &StencilConfig) -> Result<()> {
    let pattern = table.pattern();
    let view = BallDrawing {
        title: format!(
            "{} dots, pattern {}",
            pattern.len(),
            &pattern.sha256()[..12]
        ),
        ball_diameter_mm: stencil.ball_diameter_mm,
        dot_diameter_mm: stencil.hole_diameter_mm,
    };
    pattern_views(path, pattern, &view)
}

/// The table's features and the distances to their nearest neighbors.
///
/// # Errors
/// [`crate::Error::Write`] on an I/O failure.
pub fn features(path: &Path, table: &HashTable) -> Result<()> {
    let title = format!(
        "{} hash features of {} dots",
        table.features().len(),
        table.pattern().len()
    );
    feature_plot(path, table.features(), &table.nearest_distances(), &title)
}

/// Failures of both recognizers in all protocols.
fn rates(path: &Path, validation: &[NamedValidation]) -> Result<()> {
    let bar = |recognizer: RecognizerName, name: ProtocolName| {
        validation
            .iter()
            .find(|v| v.recognizer == recognizer && v.validation.protocol == name)
            .map(|v| point(0.0, success(name, &v.validation)))
    };
    let groups = ProtocolName::ALL.map(|name| BarGroup {
        name: format!("{name}: {}", success_name(name)),
        rates: RecognizerName::ALL.map(|r| bar(r, name)).to_vec(),
    });
    let trials = validation.first().map_or(0, |v| v.validation.samples);
    bar_comparison(
        path,
        &BarChart {
            title: format!("Views not identified, of {trials} a protocol"),
            y_label: "failures".into(),
            scale: RateScale::Failure,
            series: RecognizerName::ALL
                .map(|r| format!("recognizer {r}"))
                .to_vec(),
            groups: groups.to_vec(),
        },
    )
}

/// The success that is plotted for a protocol: with false and missed dots it is the orientation.
pub(super) fn success(name: ProtocolName, v: &crate::validate::Validation) -> &Proportion {
    match name {
        ProtocolName::Paper | ProtocolName::Sparse => &v.identity,
        ProtocolName::Clutter | ProtocolName::Image => &v.orientation,
    }
}

pub(super) fn success_name(name: ProtocolName) -> &'static str {
    match name {
        ProtocolName::Paper | ProtocolName::Sparse => "identity",
        ProtocolName::Clutter | ProtocolName::Image => "orientation",
    }
}

/// The curves of a sweep, one picture per swept parameter: `sensitivity_sigma.png` and
/// `sensitivity_alpha.png`.
///
/// # Errors
/// [`crate::Error::Write`] on an I/O failure.
pub fn sensitivity_plots(dir: &Path, points: &[SensitivityPoint]) -> Result<()> {
    let parameters = [
        (
            SweptParameter::SigmaDeg,
            "sensitivity_sigma.png",
            "noise of a dot, sigma [deg]",
            "Success against the noise of a dot",
        ),
        (
            SweptParameter::Alpha,
            "sensitivity_alpha.png",
            "alpha (log10)",
            "Success against the paper's alpha",
        ),
    ];
    for (parameter, file, x_label, title) in parameters {
        let mut series = Vec::new();
        for recognizer in RecognizerName::ALL {
            let of = |pick: fn(&crate::validate::Validation) -> &Proportion| -> Vec<RatePoint> {
                points
                    .iter()
                    .filter(|p| p.parameter == parameter && p.result.recognizer == recognizer)
                    .map(|p| {
                        let x = match parameter {
                            SweptParameter::SigmaDeg => p.value,
                            SweptParameter::Alpha => p.value.log10(),
                        };
                        point(x, pick(&p.result.validation))
                    })
                    .collect()
            };
            let curves = [
                (format!("{recognizer}, identity"), of(|v| &v.identity)),
                (format!("{recognizer}, orientation"), of(|v| &v.orientation)),
            ];
            for (name, points) in curves {
                if !points.is_empty() {
                    series.push(RateSeries { name, points });
                }
            }
        }
        let Some(first) = points.iter().find(|p| p.parameter == parameter) else {
            continue;
        };
        let v = &first.result.validation;
        rate_curves(
            &dir.join(file),
            &CurvePlot {
                title: format!(
                    "{title}; protocol {}, {} trials per point",
                    v.protocol, v.samples
                ),
                x_label: x_label.into(),
                y_label: "success".into(),
                scale: RateScale::Success,
                series,
            },
        )?;
    }
    Ok(())
}
