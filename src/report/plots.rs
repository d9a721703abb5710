//! The plots of a design: the ball, its features, its rates, and how they depend on noise and
//! alpha.

use std::path::Path;

use super::folder::read_ball;
use super::{DesignEvaluation, DesignReport};
use crate::ball::Ball;
#[cfg(feature = "vision")]
use crate::camera::CameraPoint;
use crate::error::{Error, Result};
use crate::plot::{
    BallDrawing, BarChart, BarGroup, CurvePlot, RatePoint, RateScale, RateSeries, bar_comparison,
    feature_plot, pattern_views, rate_curves,
};
use crate::recognize::RecognizerName;
use crate::recognize::paper::FeatureTree;
use crate::stencil::StencilConfig;
use crate::validate::{NamedValidation, Proportion, SensitivityPoint, SweptParameter, Validation};
use crate::view::ProtocolName;

pub(super) fn point(x: f64, p: &Proportion) -> RatePoint {
    RatePoint {
        x,
        rate: p.rate,
        low: p.low,
        high: p.high,
    }
}

/// A format of pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureFormat {
    /// Pixels.
    Png,
    /// Lines and text.
    Svg,
}

impl PictureFormat {
    /// All formats.
    pub const ALL: [Self; 2] = [Self::Png, Self::Svg];

    /// Its name, which is the ending of its files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Svg => "svg",
        }
    }
}

impl std::str::FromStr for PictureFormat {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "pictures", name)
    }
}

/// Draws a picture in each format to `dir/name`.
///
/// # Errors
/// Those of `draw`.
pub(crate) fn in_each_format(
    dir: &Path,
    name: &str,
    formats: &[PictureFormat],
    draw: impl Fn(&Path) -> Result<()>,
) -> Result<()> {
    formats
        .iter()
        .try_for_each(|format| draw(&dir.join(format!("{name}.{}", format.as_str()))))
}

/// Draws all pictures of a design into `dir`: the ball, its features, its rates, the course of the search and how the rates
/// depend on noise and alpha.
///
/// # Errors
/// [`crate::Error::Write`] on an I/O failure.
pub fn write_all(
    dir: &Path,
    report: &DesignReport,
    ball: &Ball,
    formats: &[PictureFormat],
) -> Result<()> {
    let size = report
        .config
        .constraints
        .stencil
        .clone()
        .unwrap_or_default();
    in_each_format(dir, "pattern", formats, |path| dots(path, ball, &size))?;
    // Thousands of points: an SVG of them is what nobody opens.
    if !formats.is_empty() {
        features(&dir.join("features.png"), ball)?;
    }
    in_each_format(dir, "rates", formats, |path| {
        rates(path, &report.validation)
    })?;
    progress(dir, report, formats)?;
    sensitivity_plots(dir, &report.sensitivity, formats)
}

/// Draws the pictures of a design's folder in the folder `to`, from its `report.json` and `table.npz`.
///
/// # Errors
/// [`Error::Read`] where one of them is absent; [`Error::Input`] where one is not what its name says,
/// or belongs to another pattern; [`Error::Write`] on an I/O failure.
pub fn redraw(dir: &Path, to: &Path, formats: &[PictureFormat]) -> Result<()> {
    let report = DesignReport::read(dir)?;
    let ball = read_ball(dir, &report.pattern.sha256)?
        .ok_or_else(|| Error::input(dir, "table.npz", "expected the design's table"))?;
    write_all(to, &report, &ball, formats)
}

/// The best rate over the rounds of the search; of a search of one round, which has no course, the
/// rates of its finalists.
fn progress(dir: &Path, report: &DesignReport, formats: &[PictureFormat]) -> Result<()> {
    let protocol = report.config.views;
    let milestones = &report.milestones;
    let [first, _, ..] = milestones.as_slice() else {
        let tried = report.finalists.iter().filter_map(|f| f.answered.as_ref());
        let points: Vec<RatePoint> = (1..)
            .zip(tried)
            .map(|(rank, p)| point(f64::from(rank), p))
            .collect();
        if points.len() < 2 {
            return Ok(());
        }
        let plot = CurvePlot {
            title: format!(
                "Finalists of the search: \u{201c}{protocol}\u{201d} views not answered right"
            ),
            x_label: "rank of the finalist".into(),
            y_label: "views not answered right".into(),
            scale: RateScale::Failure,
            log_x: false,
            series: vec![RateSeries {
                name: "on the trials that ranked them".into(),
                points,
            }],
        };
        return in_each_format(dir, "progress", formats, |path| rate_curves(path, &plot));
    };
    let trials = first.answered.trials;
    let rounds = RateSeries {
        name: format!("best so far ({trials} trials, 95 % intervals)"),
        points: milestones
            .iter()
            .map(|m| point(m.rounds as f64, &m.answered))
            .collect(),
    };
    let plot = CurvePlot {
        title: format!("Best pattern so far: \u{201c}{protocol}\u{201d} views not answered right"),
        x_label: "rounds of the search".into(),
        y_label: "views not answered right".into(),
        scale: RateScale::Failure,
        log_x: false,
        series: vec![rounds],
    };
    in_each_format(dir, "progress", formats, |path| rate_curves(path, &plot))
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
        to_draw: 0,
    };
    pattern_views(path, pattern, &view)
}

/// A ball whose last dots are to be drawn, from both sides.
///
/// # Errors
/// [`crate::Error::Write`] on an I/O failure.
pub(super) fn to_draw(path: &Path, found: &DesignEvaluation, size: &StencilConfig) -> Result<()> {
    let (pattern, added) = (found.ball.pattern(), found.report.added.len());
    let view = BallDrawing {
        title: format!("{added} dots to add to {}", pattern.len() - added),
        ball_diameter_mm: size.ball_diameter_mm,
        dot_diameter_mm: size.hole_diameter_mm,
        to_draw: added,
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

/// Failures of the rated recognizers in all protocols.
fn rates(path: &Path, validation: &[NamedValidation]) -> Result<()> {
    let bar = |recognizer: RecognizerName, name: ProtocolName| {
        validation
            .iter()
            .find(|v| v.recognizer == recognizer && v.validation.protocol == name)
            .map(|v| point(0.0, &v.validation.answered))
    };
    let groups = ProtocolName::ALL.map(|name| BarGroup {
        name: name.to_string(),
        rates: RecognizerName::ALL.map(|r| bar(r, name)).to_vec(),
    });
    let trials = validation.first().map_or(0, |v| v.validation.samples);
    bar_comparison(
        path,
        &BarChart {
            title: format!(
                "Views not answered right: {trials} trials per protocol, 95 % intervals"
            ),
            y_label: "views not answered right".into(),
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
        RecognizerName::Voting => "the paper's recognizer",
        RecognizerName::Robust => "our recognizer",
    }
}

/// The curves of a sweep, one picture per swept parameter, in each format: `sensitivity_sigma` and
/// `sensitivity_alpha`.
///
/// # Errors
/// [`crate::Error::Write`] on an I/O failure.
pub fn sensitivity_plots(
    dir: &Path,
    points: &[SensitivityPoint],
    formats: &[PictureFormat],
) -> Result<()> {
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
                "{title}: \u{201c}{}\u{201d} views, {} trials per point",
                v.protocol, v.samples
            ),
            x_label: x_label.into(),
            y_label: "success".into(),
            scale: RateScale::Success,
            log_x: parameter == SweptParameter::Alpha,
            series: swept_series(&of),
        };
        in_each_format(dir, name, formats, |path| rate_curves(path, &plot))?;
    }
    Ok(())
}

/// The curves of a camera's sweep, one picture per swept property, in each format: `sensitivity_ball_px` and so on.
///
/// # Errors
/// [`crate::Error::Write`] on an I/O failure.
#[cfg(feature = "vision")]
pub fn camera_plots(dir: &Path, points: &[CameraPoint], formats: &[PictureFormat]) -> Result<()> {
    for same in points.chunk_by(|a, b| a.parameter == b.parameter) {
        let [first, _, ..] = same else { continue };
        let series = |name: &str, of: fn(&CameraPoint) -> &Proportion| RateSeries {
            name: name.to_owned(),
            points: same.iter().map(|p| point(p.value, of(p))).collect(),
        };
        let plot = CurvePlot {
            title: format!(
                "Frames against {}: {} frames per point",
                first.parameter.words(),
                first.frames.right.trials
            ),
            x_label: first.parameter.words().into(),
            y_label: "share of the frames".into(),
            scale: RateScale::Success,
            log_x: true,
            series: vec![
                series("right", |p| &p.frames.right),
                series("wrong", |p| &p.frames.wrong),
            ],
        };
        let name = format!("sensitivity_{}", first.parameter.as_str());
        in_each_format(dir, &name, formats, |path| rate_curves(path, &plot))?;
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
            ("right orientations", of(|v| &v.answered)),
            ("all dots right, of views with enough", of(|v| &v.identity)),
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
