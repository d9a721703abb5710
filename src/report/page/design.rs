//! The page of a design's folder: what it reads there, and what the page shows.
//!
//! It reads `report.json` (of this version and the one before), `table.npz` and `stencil/`, where
//! they are there, so that `spindoe report` and `spindoe design` make the same page.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::mesh::PageMesh;
use super::{PAGE, Page, rounded};
use crate::design::objective::bound::BoundSummary;
use crate::design::{KeepOut, Milestone};
use crate::error::{Error, Result};
use crate::files;
use crate::geometry::Vec3;
use crate::hash::HashTable;
use crate::stats::Proportion;
use crate::stencil::{Mesh, StencilConfig};
use crate::validate::{Noise, Protocol, ProtocolName};

/// Rates of the published pattern, measured by `spindoe compare` and stored beside the page.
const PUBLISHED: &str = include_str!("published.json");
/// Maximum number of features shown.
const MAX_FEATURES: usize = 4000;
/// Features within this quantile of all are shown.
const SHOWN: f64 = 0.95;
/// Newest version of `report.json` that is read.
const MAX_VERSION: u32 = super::super::REPORT_VERSION;

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
            rate: 350.0,
            frames: 10,
        }
    }
}

/// The parts of `report.json` that the page shows.
#[derive(Debug, Deserialize)]
struct ReportFile {
    format_version: u32,
    spindoe_version: String,
    command: Option<String>,
    config: ConfigPart,
    seeds: BTreeMap<String, u64>,
    stopped: bool,
    starts: usize,
    finalists: Vec<Finalist>,
    #[serde(default)]
    polish: Vec<Value>,
    objective: ObjectivePart,
    pattern: PatternPart,
    orientation_bound: BoundSummary,
    validation: Vec<Rates>,
    sensitivity: Vec<Swept>,
    timing: TimingPart,
}

#[derive(Debug, Deserialize)]
struct ConfigPart {
    protocol: Protocol,
    constraints: ConstraintsPart,
}

#[derive(Debug, Deserialize)]
struct ConstraintsPart {
    #[serde(default)]
    keep_out: Vec<KeepOut>,
    stencil: Option<Value>,
}

#[derive(Debug, Serialize, Deserialize)]
struct ObjectivePart {
    name: String,
    value: f64,
}

#[derive(Debug, Serialize, Deserialize)]
struct Finalist {
    start: usize,
    #[serde(alias = "figure")]
    value: f64,
    identity: Option<Proportion>,
}

#[derive(Debug, Deserialize)]
struct PatternPart {
    sha256: String,
    summary: SummaryPart,
    dots: Vec<[f64; 3]>,
}

#[derive(Debug, Deserialize)]
struct SummaryPart {
    #[serde(alias = "least_separation_rad")]
    min_separation_rad: f64,
    mean_nearest_separation_rad: f64,
    #[serde(alias = "least_visible")]
    min_visible: usize,
    mean_visible: f64,
}

#[derive(Debug, Default, Deserialize)]
struct TimingPart {
    #[serde(default)]
    milestones: Vec<Milestone>,
}

/// Rates in a page.
#[derive(Debug, Serialize, Deserialize)]
struct Rates {
    recognizer: String,
    protocol: String,
    samples: u64,
    sigma_deg: f64,
    skipped: u64,
    identity: Proportion,
    orientation: Proportion,
    /// `None` where no view succeeded.
    mean_error_deg: Option<f64>,
    median_error_deg: Option<f64>,
}

/// A point of a sweep.
#[derive(Debug, Serialize, Deserialize)]
struct Swept {
    parameter: String,
    value: f64,
    #[serde(flatten)]
    rates: Rates,
}

/// The parts of `stencil.json` that the page shows.
#[derive(Debug, Deserialize)]
struct StencilFile {
    pattern_sha256: String,
    rotation_pattern_to_stencil: Quaternion,
    seam: SeamPart,
    dots: Vec<Value>,
    half_a: HalfPart,
    half_b: HalfPart,
    parameters: Value,
    joint: JointPart,
}

#[derive(Debug, Deserialize)]
struct Quaternion {
    qw: f64,
    qx: f64,
    qy: f64,
    qz: f64,
}

#[derive(Debug, Deserialize)]
struct SeamPart {
    normal_pattern_frame: [f64; 3],
    min_dot_latitude_deg: f64,
}

#[derive(Debug, Deserialize)]
struct JointPart {
    axis_mm: f64,
    lip_mm: f64,
}

#[derive(Debug, Deserialize)]
struct HalfPart {
    file: String,
    check: CheckPart,
}

#[derive(Debug, Deserialize)]
struct CheckPart {
    volume_mm3: f64,
}

/// The page of a design.
#[derive(Debug, Serialize)]
pub struct DesignPage {
    spindoe_version: String,
    sha256: String,
    command: Option<String>,
    seeds: BTreeMap<String, u64>,
    dots: Vec<[f64; 3]>,
    ball_diameter_mm: f64,
    dot_diameter_mm: f64,
    keep_out: Vec<KeepOut>,
    summary: PageSummary,
    bound: BoundSummary,
    validation: Vec<Rates>,
    /// Protocols with their standard values: only these compare with the published pattern.
    standard_protocols: Vec<ProtocolName>,
    published: Value,
    sensitivity: Vec<Swept>,
    /// Sigma of the sweeps over a dot's noise per tangent axis.
    sigma_per_noise: f64,
    camera: CameraFigures,
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

#[derive(Debug, Serialize)]
struct PageSearch {
    starts: usize,
    polished: usize,
    stopped: bool,
    protocol: ProtocolName,
    objective: ObjectivePart,
    milestones: Vec<Milestone>,
    finalists: Vec<Finalist>,
}

#[derive(Debug, Serialize)]
struct PageStencil {
    halves: [PageMesh; 2],
    boxes: [[f64; 3]; 2],
    volumes_mm3: [f64; 2],
    rotation_wxyz: [f64; 4],
    seam_normal: [f64; 3],
    seam_margin_deg: f64,
    axis_mm: f64,
    lip_mm: f64,
    dots: Vec<Value>,
    parameters: Value,
}

#[derive(Debug, Serialize)]
struct PageFeatures {
    total: usize,
    shown: usize,
    /// Half the side of the square that is shown.
    reach: f64,
    /// h1, h2, the basis' dots, the feature's dot, and the rank of its distance to the nearest other
    /// feature in [0, 1].
    points: Vec<(f64, f64, u16, u16, u16, f64)>,
}

/// What a dot's features say about it.
#[derive(Debug, Serialize)]
struct DotFeatures {
    count: usize,
    /// Smallest and median distance of one of its features to the nearest other feature.
    nearest: f64,
    median: f64,
}

impl DesignPage {
    /// Reads a design's folder.
    ///
    /// # Errors
    /// [`Error::Read`] where there is no `report.json`; [`Error::Input`] for a file that is not what
    /// its name says, or belongs to another pattern.
    pub fn read(dir: &Path) -> Result<Self> {
        let report: ReportFile = parsed(&dir.join("report.json"))?;
        if report.format_version > MAX_VERSION {
            let problem = format!(
                "expected at most version {MAX_VERSION}, found {}",
                report.format_version
            );
            return Err(Error::input(
                dir.join("report.json"),
                "format_version",
                problem,
            ));
        }
        let sha256 = report.pattern.sha256.clone();
        let stencil = PageStencil::read(&dir.join("stencil"), &sha256)?;
        let table = read_table(dir, &sha256)?;
        let distances = table.as_ref().map(HashTable::nearest_distances);
        let shown = table.as_ref().zip(distances.as_deref());
        let protocol = report.config.protocol;
        let searched = [protocol.name];
        let standard_protocols = ProtocolName::ALL
            .into_iter()
            .filter(|name| !searched.contains(name) || protocol == Protocol::standard(*name))
            .collect();
        let size = |name: &str, or: f64| {
            let parameters = stencil
                .as_ref()
                .map_or(report.config.constraints.stencil.as_ref(), |s| {
                    Some(&s.parameters)
                });
            parameters
                .and_then(|p| p.get(name))
                .and_then(Value::as_f64)
                .unwrap_or(or)
        };
        let defaults = StencilConfig::default();
        let summary = &report.pattern.summary;
        Ok(Self {
            ball_diameter_mm: size("ball_diameter_mm", defaults.ball_diameter_mm),
            dot_diameter_mm: size("hole_diameter_mm", defaults.hole_diameter_mm),
            summary: PageSummary {
                min_separation_deg: summary.min_separation_rad.to_degrees(),
                mean_nearest_separation_deg: summary.mean_nearest_separation_rad.to_degrees(),
                min_visible: summary.min_visible,
                mean_visible: summary.mean_visible,
            },
            features: shown.map(|(table, distances)| PageFeatures::new(table, distances)),
            dot_features: shown.map(|(table, distances)| dot_features(table, distances)),
            standard_protocols,
            published: serde_json::from_str(PUBLISHED)
                .map_err(|e| Error::Internal(format!("published.json: {e}")))?,
            camera: CameraFigures::of(&protocol),
            sigma_per_noise: sigma_per_noise(&report.sensitivity),
            spindoe_version: report.spindoe_version,
            command: report.command,
            seeds: report.seeds,
            dots: report.pattern.dots,
            keep_out: report.config.constraints.keep_out,
            bound: report.orientation_bound,
            validation: report.validation,
            sensitivity: report.sensitivity,
            search: PageSearch {
                starts: report.starts,
                polished: report.polish.len(),
                stopped: report.stopped,
                protocol: protocol.name,
                objective: report.objective,
                milestones: report.timing.milestones,
                finalists: report.finalists,
            },
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
        Page {
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
    /// The camera that a search was for, where it had one.
    fn of(protocol: &Protocol) -> Self {
        match protocol.noise {
            Noise::Pixel {
                sigma_px,
                radius_px,
            } => Self {
                pixels: rounded(2.0 * radius_px),
                noise: rounded(sigma_px),
                ..Self::default()
            },
            Noise::RandomAxis { .. } => Self::default(),
        }
    }
}

/// Sigma of the sweeps for a noise of 1 per tangent axis of a dot: a rotation about a random axis by
/// N(0, sigma) moves a dot by sigma / sqrt(3) per tangent axis, pixel noise by sigma.
fn sigma_per_noise(sweep: &[Swept]) -> f64 {
    let by_pixels = sweep
        .first()
        .is_some_and(|p| p.rates.protocol == ProtocolName::Image.as_str());
    if by_pixels { 1.0 } else { 3f64.sqrt() }
}

/// A file of JSON as `T`.
fn parsed<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    let bytes = files::read_bytes(path)?;
    serde_json::from_slice(&bytes)
        .map_err(|e| Error::input(path, format!("line {}", e.line()), e.to_string()))
}

/// The folder's table, where it is there and that of the pattern.
fn read_table(dir: &Path, sha256: &str) -> Result<Option<HashTable>> {
    let path = dir.join("table.npz");
    if !path.exists() {
        return Ok(None);
    }
    let table = HashTable::from_npz(&path, &files::read_bytes(&path)?)?;
    same_pattern(&path, "meta", &table.meta().pattern_sha256, sha256)?;
    Ok(Some(table))
}

fn same_pattern(path: &Path, place: &str, found: &str, expected: &str) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    let problem = format!("expected pattern {expected:.12} as in report.json, found {found:.12}");
    Err(Error::input(path, place, problem))
}

impl PageStencil {
    /// The stencil in `dir`, where there is one.
    fn read(dir: &Path, sha256: &str) -> Result<Option<Self>> {
        let path = dir.join("stencil.json");
        if !path.exists() {
            return Ok(None);
        }
        let file: StencilFile = parsed(&path)?;
        same_pattern(&path, "pattern_sha256", &file.pattern_sha256, sha256)?;
        let mesh = |half: &HalfPart| read_stl(&dir.join(&half.file));
        let [a, b] = [mesh(&file.half_a)?, mesh(&file.half_b)?];
        let sides = |m: &Mesh| {
            let bounds = m.bounding_box();
            [0, 1, 2].map(|i| rounded(bounds.max_mm[i] - bounds.min_mm[i]))
        };
        let q = &file.rotation_pattern_to_stencil;
        Ok(Some(Self {
            boxes: [sides(&a), sides(&b)],
            halves: [PageMesh::new(&a), PageMesh::new(&b)],
            volumes_mm3: [file.half_a.check.volume_mm3, file.half_b.check.volume_mm3],
            rotation_wxyz: [q.qw, q.qx, q.qy, q.qz],
            seam_normal: file.seam.normal_pattern_frame,
            seam_margin_deg: file.seam.min_dot_latitude_deg,
            axis_mm: file.joint.axis_mm,
            lip_mm: file.joint.lip_mm,
            dots: file.dots,
            parameters: file.parameters,
        }))
    }
}

/// The mesh in a binary STL file.
fn read_stl(path: &Path) -> Result<Mesh> {
    let bytes = files::read_bytes(path)?;
    let stl = stl_io::read_stl(&mut std::io::Cursor::new(bytes))
        .map_err(|e| Error::input(path, "file", format!("expected a binary STL: {e}")))?;
    let vertex = |v: &stl_io::Vertex| Vec3::from(v.0.map(f64::from));
    Ok(Mesh {
        vertices: stl.vertices.iter().map(vertex).collect(),
        triangles: stl
            .faces
            .iter()
            .map(|f| f.vertices.map(|v| v as u32))
            .collect(),
    })
}

impl PageFeatures {
    /// The features within the range that holds most of them, thinned where there are many.
    fn new(table: &HashTable, distances: &[f64]) -> Self {
        let features = table.features();
        let mut order: Vec<usize> = (0..distances.len()).collect();
        order.sort_unstable_by(|a, b| distances[*a].total_cmp(&distances[*b]));
        let mut rank = vec![0.0; distances.len()];
        for (k, i) in order.iter().enumerate() {
            rank[*i] = k as f64 / distances.len().max(1) as f64;
        }
        let extent = |h: &[f64; 3]| h[0].abs().max(h[1].abs());
        let mut extents: Vec<f64> = features.iter().map(extent).collect();
        extents.sort_unstable_by(f64::total_cmp);
        let last = extents.len().saturating_sub(1);
        let reach = extents
            .get((SHOWN * last as f64) as usize)
            .copied()
            .unwrap_or(1.0);
        let step = features.len().div_ceil(MAX_FEATURES).max(1);
        let points: Vec<_> = (0..features.len())
            .step_by(step)
            .filter(|&i| extent(&features[i]) <= reach)
            .map(|i| {
                let basis = table.bases()[i];
                let short = |x: f64| (1e3 * x).round() / 1e3;
                (
                    short(features[i][0]),
                    short(features[i][1]),
                    basis.first,
                    basis.second,
                    table.feature_dots()[i],
                    short(rank[i]),
                )
            })
            .collect();
        Self {
            total: features.len(),
            shown: features.len() / step,
            reach,
            points,
        }
    }
}

/// For each dot how far its features are from the nearest other ones.
fn dot_features(table: &HashTable, distances: &[f64]) -> Vec<DotFeatures> {
    let mut by_dot = vec![Vec::new(); table.pattern().len()];
    for (dot, distance) in table.feature_dots().iter().zip(distances) {
        by_dot[usize::from(*dot)].push(*distance);
    }
    by_dot
        .into_iter()
        .map(|mut all| {
            all.sort_unstable_by(f64::total_cmp);
            let at = |k: usize| all.get(k).copied().unwrap_or(f64::NAN);
            DotFeatures {
                count: all.len(),
                nearest: at(0),
                median: at(all.len() / 2),
            }
        })
        .collect()
}
