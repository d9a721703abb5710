//! The page of a calibration's folder: the dots as drawn and as designed, and what they are worth.
//!
//! It reads `report.json` and `table.npz`, so that `spindoe calibrate` and `spindoe report` make the
//! same page.

use std::path::Path;

use serde::Serialize;

use super::{PAGE, PageData};
use crate::calibrate::DotState;
use crate::error::{Error, Result};
use crate::files;
use crate::pattern::KeepOut;
use crate::report::calibration::{
    CALIBRATION_REPORT_VERSION, CalibrationReport, DotReport, WELL_MEASURED_DEG,
};
use crate::report::dot_set::DotSetReport;
use crate::report::folder::{parsed, read_ball, report};
use crate::stencil::StencilConfig;

/// The page of a calibration.
#[derive(Debug, Serialize)]
pub struct CalibrationPage {
    #[serde(flatten)]
    report: CalibrationReport,
    /// For each dot its offset to the north and to the east, degrees.
    compass_deg: Vec<[f64; 2]>,
    keep_out: Vec<KeepOut>,
    /// Angle between a drawn dot's middle and its rim.
    dot_angle_rad: f64,
    /// How good the dots are as a set, in words.
    dot_set_words: Vec<String>,
    /// A dot whose standard deviation is larger needs more views, degrees.
    well_measured_deg: f64,
}

impl CalibrationPage {
    /// Reads a calibration's folder.
    ///
    /// # Errors
    /// [`Error::Read`] where there is no `report.json`; [`Error::Input`] for a file that is not what
    /// its name says, or belongs to another pattern.
    pub fn read(dir: &Path) -> Result<Self> {
        let path = dir.join("report.json");
        let report: CalibrationReport = report(&path, CALIBRATION_REPORT_VERSION)?;
        for dot in &report.dots {
            let unit = |v: &[f64; 3]| (v.iter().map(|c| c * c).sum::<f64>() - 1.0).abs() < 1e-3;
            if !unit(&dot.nominal) || !unit(&dot.drawn) {
                let field = format!("dots[{}]", dot.nominal_number);
                return Err(Error::input(&path, field, "expected unit vectors"));
            }
        }
        let ball = read_ball(dir, &report.pattern_sha256)?;
        let size = StencilConfig::default();
        Ok(Self {
            compass_deg: report.dots.iter().map(DotReport::compass_deg).collect(),
            keep_out: ball.map_or(Vec::new(), |b| b.pattern().keep_out().to_vec()),
            dot_angle_rad: (0.5 * size.hole_diameter_mm / (0.5 * size.ball_diameter_mm)).asin(),
            dot_set_words: report
                .dot_set
                .as_ref()
                .map_or(Vec::new(), DotSetReport::words),
            well_measured_deg: WELL_MEASURED_DEG,
            report,
        })
    }

    /// Whether a folder's `report.json` is that of a calibration.
    ///
    /// # Errors
    /// [`Error::Read`] where there is none; [`Error::Input`] where it is no JSON object.
    pub fn is_in(dir: &Path) -> Result<bool> {
        let report: serde_json::Map<String, serde_json::Value> = parsed(&dir.join("report.json"))?;
        Ok(report.contains_key("held_out"))
    }

    /// The page as HTML.
    ///
    /// # Errors
    /// [`Error::Internal`] where the data are no JSON.
    pub fn html(&self) -> Result<String> {
        let report = &self.report;
        let measured = report.dots.iter().filter(|d| d.state == DotState::Measured);
        PageData {
            kind: "calibrate",
            title: &format!("Calibrated ball {:.12}", report.pattern_sha256),
            subtitle: &format!(
                "{} of {} dots measured in {} frames, spindoe {}",
                measured.count(),
                report.dots.len(),
                report.frames.fitted,
                report.spindoe_version
            ),
            content: self,
        }
        .html()
    }

    /// Writes `report.html` to `dir`.
    ///
    /// # Errors
    /// As [`CalibrationPage::html`]; [`Error::Write`] where the system refuses.
    pub fn write(&self, dir: &Path) -> Result<()> {
        files::write_bytes(&dir.join(PAGE), self.html()?.as_bytes())
    }
}
