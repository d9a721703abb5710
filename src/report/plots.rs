//! The plots of a design: the ball, its features, its rates, and how they depend on noise and
//! alpha.

use std::path::Path;

use serde::Deserialize;

use super::page::folder::{known_version, parsed, read_ball};
use super::{DesignEvaluation, REPORT_VERSION};
use crate::ball::Ball;
use crate::design::Milestone;
use crate::error::{Error, Result};
use crate::plot::{
    BallDrawing, BarChart, BarGroup, CurvePlot, RatePoint, RateScale, RateSeries, bar_comparison,
    feature_plot, pattern_views, rate_curves,
};
use crate::recognize::RecognizerName;
use crate::recognize::paper::FeatureTree;
use crate::stencil::StencilConfig;
use crate::validate::{NamedValidation, Proportion, SensitivityPoint, SweptParameter, Validation};
use crate::view::{Protocol, ProtocolName};

pub(super) fn point(x: f64, p: &Proportion) -> RatePoint {
    RatePoint {
        x,
        rate: p.rate,
        low: p.low,
        high: p.high,
    }
}

/// The formats of a plot, by the file's ending.
const ENDINGS: [&str; 2] = ["png", "svg"];

/// Draws a plot in each format to `dir/name`.
///
/// # Errors
/// Those of `draw`.
pub(crate) fn in_each_format(
    dir: &Path,
    name: &str,
    draw: impl Fn(&Path) -> Result<()>,
) -> Result<()> {
    ENDINGS
        .iter()
        .try_for_each(|ending| draw(&dir.join(format!("{name}.{ending}"))))
}

/// Draws all plots of a design into `dir`, as PNG and SVG.
///
/// # Errors
/// [`crate::Error::Write`] on an I/O failure.
pub fn write_all(dir: &Path, design: &DesignEvaluation, stencil: &StencilConfig) -> Result<()> {
    let report = &design.report;
    let search = Search {
        protocol: report.config.protocol.name(),
        finalists: report.finalists.iter().map(|f| f.identity).collect(),
        milestones: &report.timing.milestones,
    };
    write(dir, &design.ball, stencil, &report.validation, &search)?;
    sensitivity_plots(dir, &report.sensitivity)
}

/// The parts of `report.json` that the plots show.
#[derive(Deserialize)]
struct ReportFile {
    format_version: u32,
    config: ConfigPart,
    finalists: Vec<FinalistPart>,
    pattern: PatternPart,
    validation: Vec<NamedValidation>,
    sensitivity: Vec<SensitivityPoint>,
    timing: TimingPart,
}

#[derive(Deserialize)]
struct ConfigPart {
    protocol: Protocol,
    constraints: ConstraintsPart,
}

#[derive(Deserialize)]
struct ConstraintsPart {
    stencil: Option<SizePart>,
}

#[derive(Deserialize)]
struct SizePart {
    ball_diameter_mm: f64,
    hole_diameter_mm: f64,
}

#[derive(Deserialize)]
struct FinalistPart {
    identity: Option<Proportion>,
}

#[derive(Deserialize)]
struct PatternPart {
    sha256: String,
}

#[derive(Deserialize)]
struct TimingPart {
    #[serde(default)]
    milestones: Vec<Milestone>,
}

/// Draws the plots of a design's folder anew in the folder `to`, from its `report.json` and `table.npz`.
///
/// # Errors
/// [`Error::Read`] where one of them is absent; [`Error::Input`] where one is not what its name says,
/// or belongs to another pattern; [`Error::Write`] on an I/O failure.
pub fn redraw(dir: &Path, to: &Path) -> Result<()> {
    let path = dir.join("report.json");
    let report: ReportFile = parsed(&path)?;
    known_version(&path, report.format_version, REPORT_VERSION)?;
    let ball = read_ball(dir, &report.pattern.sha256)?
        .ok_or_else(|| Error::input(dir, "table.npz", "expected the design's table"))?;
    let mut stencil = StencilConfig::default();
    if let Some(size) = report.config.constraints.stencil {
        stencil.ball_diameter_mm = size.ball_diameter_mm;
        stencil.hole_diameter_mm = size.hole_diameter_mm;
    }
    let search = Search {
        protocol: report.config.protocol.name(),
        finalists: report.finalists.iter().map(|f| f.identity).collect(),
        milestones: &report.timing.milestones,
    };
    write(to, &ball, &stencil, &report.validation, &search)?;
    sensitivity_plots(to, &report.sensitivity)
}

/// The course of a search.
struct Search<'a> {
    protocol: ProtocolName,
    /// The rates of the finalists, best first.
    finalists: Vec<Option<Proportion>>,
    milestones: &'a [Milestone],
}

/// All plots but those of the sweeps.
fn write(
    dir: &Path,
    ball: &Ball,
    stencil: &StencilConfig,
    validation: &[NamedValidation],
    search: &Search<'_>,
) -> Result<()> {
    in_each_format(dir, "pattern", |path| dots(path, ball, stencil))?;
    in_each_format(dir, "features", |path| features(path, ball))?;
    in_each_format(dir, "rates", |path| rates(path, validation))?;
    progress(dir, search)
}

/// The best rate over the time of the search; of a search of one round, which has no course, the
/// rates of its finalists.
fn progress(dir: &Path, search: &Search<'_>) -> Result<()> {
    let Search {
        protocol,
        finalists,
        milestones,
    } = search;
    let Some(first) = milestones.first() else {
        return Ok(());
    };
    if milestones.len() == 1 {
        let tried = finalists.iter().flatten();
        let points: Vec<RatePoint> = (1..)
            .zip(tried)
            .map(|(rank, p)| point(f64::from(rank), p))
            .collect();
        if points.len() < 2 {
            return Ok(());
        }
        let plot = CurvePlot {
            title: format!("Finalists of the search: `{protocol}` views not identified"),
            x_label: "rank of the finalist".into(),
            y_label: "views not identified".into(),
            scale: RateScale::Failure,
            log_x: false,
            series: vec![RateSeries {
                name: "on the trials that ranked them".into(),
                points,
            }],
        };
        return in_each_format(dir, "progress", |path| rate_curves(path, &plot));
    }
    let trials = first.identity.trials;
    let rounds = RateSeries {
        name: format!("rounds of the search ({trials} trials, 95 % intervals)"),
        points: milestones
            .iter()
            .map(|m| point(m.elapsed_s / 60.0, &m.identity))
            .collect(),
    };
    let plot = CurvePlot {
        title: format!("Best pattern so far: `{protocol}` views not identified"),
        x_label: "time [min]".into(),
        y_label: "views not identified".into(),
        scale: RateScale::Failure,
        log_x: false,
        series: vec![rounds],
    };
    in_each_format(dir, "progress", |path| rate_curves(path, &plot))
}

/// The pattern from both sides of the ball.
///
/// # Errors
/// [`crate::Error::Write`] on an I/O failure.
pub fn dots(path: &Path, ball: &Ball, stencil: &StencilConfig) -> Result<()> {
    let pattern = ball.pattern();
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

/// The hash features of a ball and the distances to their nearest neighbors.
///
/// # Errors
/// [`crate::Error::Write`] on an I/O failure.
pub fn features(path: &Path, ball: &Ball) -> Result<()> {
    let tree = FeatureTree::new(ball)?;
    let values: Vec<[f64; 3]> = tree.features().iter().map(|f| f.value).collect();
    let title = format!(
        "{} hash features of {} dots",
        values.len(),
        ball.pattern().len()
    );
    feature_plot(path, &values, &tree.nearest_distances(), &title)
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
            title: format!("Views not identified: {trials} trials per protocol, 95 % intervals"),
            y_label: "views not identified".into(),
            scale: RateScale::Failure,
            series: RecognizerName::ALL
                .map(|r| recognizer_name(r).to_owned())
                .to_vec(),
            groups: groups.to_vec(),
        },
    )
}

/// A recognizer in a legend.
fn recognizer_name(recognizer: RecognizerName) -> &'static str {
    match recognizer {
        RecognizerName::Paper => "the paper's recognizer",
        RecognizerName::Robust => "our recognizer",
    }
}

/// The success that is plotted for a protocol: with false and missed dots it is the orientation.
pub(super) fn success(name: ProtocolName, v: &Validation) -> &Proportion {
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

/// The curves of a sweep, one picture per swept parameter, as PNG and SVG: `sensitivity_sigma` and
/// `sensitivity_alpha`.
///
/// # Errors
/// [`crate::Error::Write`] on an I/O failure.
pub fn sensitivity_plots(dir: &Path, points: &[SensitivityPoint]) -> Result<()> {
    for parameter in [SweptParameter::SigmaDeg, SweptParameter::Alpha] {
        let of: Vec<&SensitivityPoint> =
            points.iter().filter(|p| p.parameter == parameter).collect();
        let Some(first) = of.first() else {
            continue;
        };
        let (name, x_label, title) = match parameter {
            SweptParameter::SigmaDeg => (
                "sensitivity_sigma",
                "noise of a dot, sigma [deg]",
                "Success against the noise of a dot",
            ),
            SweptParameter::Alpha => (
                "sensitivity_alpha",
                "alpha of the paper's recognizer",
                "Success against the paper's alpha",
            ),
        };
        let v = &first.result.validation;
        let plot = CurvePlot {
            title: format!(
                "{title}: `{}` views, {} trials per point",
                v.protocol, v.samples
            ),
            x_label: x_label.into(),
            y_label: "success".into(),
            scale: RateScale::Success,
            log_x: parameter == SweptParameter::Alpha,
            series: swept_series(&of),
        };
        in_each_format(dir, name, |path| rate_curves(path, &plot))?;
    }
    Ok(())
}

/// Identity and orientation of each recognizer over the swept values.
fn swept_series(points: &[&SensitivityPoint]) -> Vec<RateSeries> {
    let mut series = Vec::new();
    for recognizer in RecognizerName::ALL {
        let of = |pick: fn(&Validation) -> &Proportion| -> Vec<RatePoint> {
            points
                .iter()
                .filter(|p| p.result.recognizer == recognizer)
                .map(|p| point(p.value, pick(&p.result.validation)))
                .collect()
        };
        let who = recognizer_name(recognizer);
        for (what, points) in [
            ("identity", of(|v| &v.identity)),
            ("orientation", of(|v| &v.orientation)),
        ] {
            if !points.is_empty() {
                series.push(RateSeries {
                    name: format!("{who}, {what}"),
                    points,
                });
            }
        }
    }
    series
}
