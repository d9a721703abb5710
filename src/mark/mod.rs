//! Marks a ball without a stencil: paper lobes, stickers, and files for plotters.
//!
//! Each function turns a pattern into flat work:
//!
//! - [`gores`]: lobes of paper or vinyl that cover the ball, with their dots and cutting lines;
//! - [`stickers`]: a sheet of numbered dots, and maps of where each goes;
//! - [`plotter_drawing`] and [`plotter_program`]: longitude and latitude of the pen's path, for
//!   machines that turn the ball under a pen.
//!
//! Drawings are written as SVG ([`svg_text`]), PDF ([`pdf_bytes`]) and DXF ([`dxf_text`]); every
//! file carries a JSON note that maps its coordinates to the ball, so that a reader needs no other
//! file.
//!
//! Frames: `mark = rotation * pattern`, poles at +z and -z. The poles are turned to where no dot
//! is: lobes end there, and plotters hold the ball there. Longitude runs from +x towards +y;
//! drawings show the ball from outside, north up, east to the right.
//!
//! A dot of diameter `d` on a ball of radius `R` is the cap within the angle `asin(d / 2R)` of its
//! center, as the stencil's hole draws it.
//!
//! Guaranteed: dots lie where the pattern has them, within 0.01 mm in the file (facets of outlines,
//! rounding). Not guaranteed: that paper stretches over a ball. A lobe is as long as the ball's
//! meridian in its middle and up to `1 / cos(pi / lobes)` too long along its edges (3.5 % for 12
//! lobes, 0.9 % for 24), more where a cut goes around a dot.
//!
//! Every sheet has a title block at its foot: the pattern, ball and dots, a bar of 50 mm, and the date
//! that [`MarkConfig::date`] states. Nothing here reads a clock, so that the same arguments give the
//! same bytes.
//!
//! Units: angles in radians; lengths are millimeters, as in the files.
//!
//! ```
//! use spindoe::geometry::spiral_directions;
//! use spindoe::mark::{GoreConfig, MarkConfig, gores, svg_text};
//! use spindoe::pattern::Pattern;
//!
//! # fn main() -> spindoe::Result<()> {
//! let pattern = Pattern::new(spiral_directions(20).collect())?;
//! let drawing = gores(&pattern, &MarkConfig::default(), &GoreConfig::default())?;
//! assert!(svg_text(&drawing)[0].contains("</svg>"));
//! # Ok(())
//! # }
//! ```

mod axis;
mod caliper;
mod cuts;
mod drawing;
mod dxf;
mod gores;
mod labels;
mod outline;
mod pdf;
mod plotter;
mod stencil_sheet;
mod stickers;
mod svg;

pub use axis::{FreeAxis, free_axis};
pub use caliper::{Caliper, references};
pub use drawing::{Anchor, Drawing, Item, Layer, Page, PageSize, Point, Shape};
pub use dxf::dxf_text;
pub use gores::{GoreConfig, gores};
pub use pdf::pdf_bytes;
pub use plotter::{PlotterConfig, PlotterPath, plotter_drawing, plotter_paths, plotter_program};
pub use stencil_sheet::stencil_sheet;
pub use stickers::{StickerConfig, stickers};
pub use svg::svg_text;

use serde_json::{Map, Value, json};

use crate::design::KeepOut;
use crate::error::{Error, Result, require};
use crate::geometry::{Rotation, Vec3, angle_between};
use crate::pattern::Pattern;
use drawing::TitleBlock;

/// The ball and what is to be marked on it.
#[derive(Debug, Clone)]
pub struct MarkConfig {
    /// Diameter of the ball, mm. Default 40.0.
    pub ball_diameter_mm: f64,
    /// Diameter of a dot, mm. Default 4.0.
    pub dot_diameter_mm: f64,
    /// Zones without dots, in the pattern's frame, whose outlines are drawn. Default none.
    pub keep_out: Vec<KeepOut>,
    /// Date for the sheets' title blocks, as it is to be written. Default none.
    pub date: Option<String>,
}

impl Default for MarkConfig {
    fn default() -> Self {
        Self {
            ball_diameter_mm: 40.0,
            dot_diameter_mm: 4.0,
            keep_out: Vec::new(),
            date: None,
        }
    }
}

impl MarkConfig {
    /// Radius of the ball, mm.
    pub fn radius_mm(&self) -> f64 {
        0.5 * self.ball_diameter_mm
    }

    /// Angle between a dot's center and its edge, radians.
    pub fn dot_angle_rad(&self) -> f64 {
        (self.dot_diameter_mm / self.ball_diameter_mm)
            .min(1.0)
            .asin()
    }

    /// Checks the sizes, that the pattern's dots do not run into each other, and that they stay out of
    /// the zones.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the parameter, and the largest dot that fits.
    pub fn validate(&self, pattern: &Pattern) -> Result<()> {
        let ball = self.ball_diameter_mm;
        let inside = (10.0..=1000.0).contains(&ball);
        require(inside, "ball_diameter_mm", "10 to 1000 mm", ball)?;
        let dot = self.dot_diameter_mm;
        require(dot >= 0.2, "dot_diameter_mm", "0.2 mm or more", dot)?;
        let dots = pattern.dots();
        let pairs = (0..dots.len()).flat_map(|i| (0..i).map(move |j| (j, i)));
        let apart = pairs.map(|(j, i)| (angle_between(&dots[j], &dots[i]), j, i));
        let nearest = apart.min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((angle, j, i)) = nearest
            && angle <= 2.0 * self.dot_angle_rad()
        {
            let fits = (10.0 * ball * (0.5 * angle).sin()).floor() / 10.0;
            let problem = format!(
                "dots {j} and {i}, the nearest pair ({:.1} degrees apart), would touch, found {dot}; at \
                 most {fits} mm fit",
                angle.to_degrees()
            );
            return Err(Error::argument("dot_diameter_mm", problem));
        }
        let zones = self.keep_out.clone();
        pattern.clone().with_keep_out(zones).map(|_| ())
    }

    /// The rejection of dots that lie over the ends of every axis, `axis` being the freest.
    fn no_free_axis(&self, axis: &FreeAxis) -> Error {
        let fits = self.ball_diameter_mm * axis.clearance_rad.sin();
        let problem = format!(
            "no axis keeps its ends free of dots, found {}; at most {:.1} mm fit",
            self.dot_diameter_mm,
            (10.0 * fits).floor() / 10.0
        );
        Error::argument("dot_diameter_mm", problem)
    }

    /// A drawing's title.
    fn title(&self, what: &str, pattern: &Pattern) -> String {
        format!(
            "{what} of pattern {:.8} for a ball of {} mm",
            pattern.sha256(),
            self.ball_diameter_mm
        )
    }

    /// What the foot of every sheet of a drawing says.
    fn title_block<'a>(&'a self, what: &'a str, pattern: &Pattern) -> TitleBlock<'a> {
        TitleBlock {
            title: what,
            facts: format!(
                "pattern {:.12}; ball {} mm; {} dots of {} mm",
                pattern.sha256(),
                written(self.ball_diameter_mm),
                pattern.len(),
                written(self.dot_diameter_mm)
            ),
            date: self.date.as_deref(),
            legend: (!self.keep_out.is_empty()).then_some("orange: a zone kept free of dots"),
        }
    }
}

/// Directions of a pattern turned into the frame of the marks.
struct TurnedDirections {
    rotation: Rotation,
    dots: Vec<Vec3>,
    keep_out: Vec<KeepOut>,
}

impl TurnedDirections {
    fn new(pattern: &Pattern, config: &MarkConfig, rotation: Rotation) -> Self {
        Self {
            rotation,
            dots: pattern.dots().iter().map(|d| rotation * d).collect(),
            keep_out: config
                .keep_out
                .iter()
                .map(|zone| KeepOut {
                    axis: rotation * zone.axis,
                    ..*zone
                })
                .collect(),
        }
    }

    /// The note that every file carries: what it is, and how the ball lies.
    fn note(&self, kind: &str, pattern: &Pattern, config: &MarkConfig) -> Map<String, Value> {
        let q = self.rotation.quaternion();
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        let note = json!({
            "kind": kind,
            "spindoe_version": env!("CARGO_PKG_VERSION"),
            "pattern_sha256": pattern.sha256(),
            "dots": pattern.len(),
            "ball_diameter_mm": config.ball_diameter_mm,
            "dot_diameter_mm": config.dot_diameter_mm,
            "rotation_pattern_to_mark": {
                "qw": sign * q.w, "qx": sign * q.i, "qy": sign * q.j, "qz": sign * q.k,
            },
        });
        match note {
            Value::Object(map) => map,
            _ => Map::new(),
        }
    }
}

/// A length as a person wrote it, mm: a product such as 0.1 * 38 has digits that nobody did.
fn written(mm: f64) -> f64 {
    (1e6 * mm).round() / 1e6
}

/// Longitude and latitude of a direction, radians.
fn longitude_latitude(v: &Vec3) -> (f64, f64) {
    (v.y.atan2(v.x), v.z.atan2(v.x.hypot(v.y)))
}
