//! The page of a design's folder: what it reads there, and what the page shows.
//!
//! It reads `report.json`, and `table.npz` and `stencil/` where they are there, so that `spindoe report` and `spindoe design` make the same page.

use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use super::features::{DotFeatures, PageFeatures, dot_features};
use super::stencil::PageStencil;
use super::{PAGE, PageData, rounded};
use crate::ball::ObjectiveRecord;
use crate::design::CameraRank;
use crate::design::objective::bound::BoundSummary;
use crate::design::{DesignCandidate, DesignViews, KeepOut, Milestone};
use crate::error::{Error, Result};
use crate::files;
use crate::recognize::paper::FeatureTree;
use crate::report::folder::read_ball;
use crate::report::{DesignReport, DotPlace, Seeds};
use crate::stats::Proportion;
use crate::stencil::StencilConfig;
use crate::validate::{NamedValidation, SensitivityPoint};
use crate::view::{Noise, Protocol, ProtocolName};

/// Rates of the published pattern, measured by `spindoe validate` and stored beside the page.
const PUBLISHED: &str = include_str!("published.json");

/// A camera for which the page computes what to expect.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CameraFigures {
    /// Diameter of the ball in the image, pixels.
    pub pixels: f64,
    /// Error of a detected dot per image axis, pixels.
    pub noise: f64,
    /// Frames per second.
    pub rate: f64,
    /// Frames from which a spin is estimated.
    pub frames: usize,
}

impl Default for CameraFigures {
    /// 60 pixels, an error of 1 pixel, 10 frames at 350 per second, as in the SpinDOE paper.
    fn default() -> Self {
        Self {
            pixels: 60.0,
            noise: 1.0,
            rate: crate::spin::DEFAULT_FPS,
            frames: 10,
        }
    }
}

/// The page of a design.
#[derive(Debug, Serialize)]
pub struct DesignPage {
    spindoe_version: String,
    sha256: String,
    command: Option<String>,
    seeds: Seeds,
    dots: Vec<[f64; 3]>,
    /// Where those are to be drawn that come to drawn ones.
    added: Vec<DotPlace>,
    ball_diameter_mm: f64,
    dot_diameter_mm: f64,
    keep_out: Vec<KeepOut>,
    summary: PageSummary,
    bound: BoundSummary,
    validation: Vec<NamedValidation>,
    /// Protocols with their standard values: only these compare with the published pattern.
    standard_protocols: Vec<ProtocolName>,
    published: Value,
    sensitivity: Vec<SensitivityPoint>,
    /// Sigma of the sweeps over a dot's noise per tangent axis.
    sigma_per_noise: f64,
    camera: CameraFigures,
    /// How the finalists were ranked for a camera, where they were.
    ranking: Option<PageRanking>,
    search: PageSearch,
    stencil: Option<PageStencil>,
    features: Option<PageFeatures>,
    dot_features: Option<Vec<DotFeatures>>,
}

#[derive(Debug, Serialize)]
struct PageSummary {
    min_separation_deg: f64,
    mean_nearest_separation_deg: f64,
    min_visible: usize,
    mean_visible: f64,
}

/// What was measured of the winner on rendered frames of the camera.
#[derive(Debug, Serialize)]
struct PageRanking {
    frames: u64,
    winner: CameraRank,
}

#[derive(Debug, Serialize)]
struct PageSearch {
    starts: usize,
    stopped: bool,
    protocol: DesignViews,
    objective: ObjectiveRecord,
    milestones: Vec<Milestone>,
    finalists: Vec<PageFinalist>,
}

/// A finalist, without its dots.
#[derive(Debug, Serialize)]
struct PageFinalist {
    start: usize,
    value: f64,
    answered: Option<Proportion>,
}

impl PageSummary {
    fn of(report: &DesignReport) -> Self {
        let summary = &report.pattern.summary;
        Self {
            min_separation_deg: summary.min_separation_rad.to_degrees(),
            mean_nearest_separation_deg: summary.mean_nearest_separation_rad.to_degrees(),
            min_visible: summary.min_visible,
            mean_visible: summary.mean_visible,
        }
    }
}

impl PageRanking {
    fn of(report: &DesignReport) -> Option<Self> {
        let winner = *report.camera.as_ref()?.finalists.first()?;
        Some(Self {
            frames: winner.right.trials,
            winner,
        })
    }
}

impl PageSearch {
    fn of(report: &DesignReport) -> Self {
        let finalist = |f: &DesignCandidate| PageFinalist {
            start: f.start,
            value: f.value,
            answered: f.answered,
        };
        Self {
            starts: report.starts,
            stopped: report.stopped,
            protocol: report.config.views,
            objective: report.objective.clone(),
            milestones: report.milestones.clone(),
            finalists: report.finalists.iter().map(finalist).collect(),
        }
    }
}

impl DesignPage {
    /// Reads a design's folder.
    ///
    /// # Errors
    /// [`Error::Read`] where there is no `report.json`; [`Error::Input`] for a file that is not what
    /// its name says, or belongs to another pattern.
    pub fn read(dir: &Path) -> Result<Self> {
        let report = DesignReport::read(dir)?;
        let sha256 = report.pattern.sha256.clone();
        let stencil = PageStencil::read(&dir.join("stencil"), &sha256)?;
        let ball = read_ball(dir, &sha256)?;
        let tree = ball.as_ref().map(FeatureTree::new).transpose()?;
        let distances = tree.as_ref().map(FeatureTree::nearest_distances);
        let shown = tree.as_ref().zip(distances.as_deref());
        let searched = &report.config.protocols;
        let is_standard = |name: &ProtocolName| {
            let own = searched.iter().find(|protocol| protocol.name() == *name);
            own.is_none_or(|own| *own == Protocol::standard(*name))
        };
        let searched_for = report.config.constraints.stencil.as_ref();
        let made = stencil.as_ref().map(|s| &s.parameters);
        let size = |name: &str, searched: Option<f64>, or: f64| {
            let made = made.and_then(|p| p.get(name)).and_then(Value::as_f64);
            made.or(searched).unwrap_or(or)
        };
        let defaults = StencilConfig::default();
        let search = PageSearch::of(&report);
        Ok(Self {
            ball_diameter_mm: size(
                "ball_diameter_mm",
                searched_for.map(|s| s.ball_diameter_mm),
                defaults.ball_diameter_mm,
            ),
            dot_diameter_mm: size(
                "hole_diameter_mm",
                searched_for.map(|s| s.hole_diameter_mm),
                defaults.hole_diameter_mm,
            ),
            summary: PageSummary::of(&report),
            features: shown.map(|(tree, distances)| PageFeatures::new(tree.features(), distances)),
            dot_features: shown.map(|(tree, distances)| {
                dot_features(report.pattern.dots.len(), tree.features(), distances)
            }),
            standard_protocols: ProtocolName::ALL.into_iter().filter(is_standard).collect(),
            published: serde_json::from_str(PUBLISHED)
                .map_err(|e| Error::Internal(format!("published.json: {e}")))?,
            camera: CameraFigures::of(&report),
            ranking: PageRanking::of(&report),
            sigma_per_noise: sigma_per_noise(&report.sensitivity),
            spindoe_version: report.spindoe_version,
            command: report.command,
            seeds: report.seeds,
            dots: report.pattern.dots,
            added: report.added,
            keep_out: report.config.constraints.keep_out,
            bound: report.orientation_bound,
            validation: report.validation,
            sensitivity: report.sensitivity,
            search,
            stencil,
            sha256,
        })
    }

    /// The camera that the page begins with; the reader can change it.
    pub fn camera_mut(&mut self) -> &mut CameraFigures {
        &mut self.camera
    }

    /// The page as HTML.
    ///
    /// # Errors
    /// [`Error::Internal`] where the data are no JSON.
    pub fn html(&self) -> Result<String> {
        let tag = &self.sha256[..12.min(self.sha256.len())];
        PageData {
            kind: "design",
            title: &format!("Dot pattern {tag}"),
            subtitle: &format!(
                "{} dots of {} mm on a ball of {} mm, designed by spindoe {}",
                self.dots.len(),
                self.dot_diameter_mm,
                self.ball_diameter_mm,
                self.spindoe_version
            ),
            content: self,
        }
        .html()
    }

    /// Writes `report.html` to `dir`.
    ///
    /// # Errors
    /// As [`DesignPage::html`]; [`Error::Write`] where the system refuses.
    pub fn write(&self, dir: &Path) -> Result<()> {
        files::write_bytes(&dir.join(PAGE), self.html()?.as_bytes())
    }
}

impl CameraFigures {
    /// The camera that a design was for, where it had one: that of the ranking, or of the protocol.
    fn of(report: &DesignReport) -> Self {
        let stated = report
            .camera
            .as_ref()
            .map(|camera| &camera.request.conditions);
        let number = |name: &str| stated?.get(name)?.as_f64();
        let by_pixels = |p: &&Protocol| matches!(p.view().noise, Noise::Pixel { .. });
        let protocol = report.config.protocols.iter().find(by_pixels);
        let usual = protocol.map_or_else(Self::default, Self::of_protocol);
        Self {
            pixels: number("ball_px").unwrap_or(usual.pixels),
            rate: number("fps").unwrap_or(usual.rate),
            ..usual
        }
    }

    fn of_protocol(protocol: &Protocol) -> Self {
        match protocol.view().noise {
            Noise::Pixel {
                sigma_px,
                radius_px,
            } => Self {
                pixels: rounded(2.0 * radius_px),
                noise: rounded(sigma_px),
                ..Self::default()
            },
            Noise::RandomAxis { .. } | Noise::HeavyTailed { .. } => Self::default(),
        }
    }
}

/// Sigma of the sweeps for a noise of 1 per tangent axis of a dot: a rotation about a random axis by
/// N(0, sigma) moves a dot by sigma / sqrt(3) per tangent axis, pixel noise by sigma.
fn sigma_per_noise(sweep: &[SensitivityPoint]) -> f64 {
    let by_pixels = sweep
        .first()
        .is_some_and(|p| p.result.validation.protocol == ProtocolName::Image);
    if by_pixels { 1.0 } else { 3f64.sqrt() }
}
