//! The page of a comparison.

use std::path::Path;

use serde::Serialize;

use super::{PAGE, PageData};
use crate::error::Result;
use crate::files;
use crate::report::compare::{Comparison, Contest, Entry, PatternMeasures};
use crate::stencil::StencilConfig;

/// What the page of a comparison shows.
#[derive(Serialize)]
struct ComparisonPage<'a> {
    samples: u64,
    seed: u64,
    patterns: Vec<ComparedPattern<'a>>,
    contests: &'a [Contest],
    /// Angle between a drawn dot's middle and its rim.
    dot_angle_rad: f64,
    command: &'a str,
}

/// A pattern with its dots.
#[derive(Serialize)]
struct ComparedPattern<'a> {
    #[serde(flatten)]
    measures: &'a PatternMeasures,
    dots: Vec<[f64; 3]>,
}

impl Comparison {
    /// The comparison as a page of HTML; `command` repeats it.
    ///
    /// # Errors
    /// [`crate::Error::Internal`] where the data are no JSON.
    pub fn html(&self, entries: &[Entry], command: &str) -> Result<String> {
        let names: Vec<&str> = self.patterns.iter().map(|p| p.name.as_str()).collect();
        let patterns = self.patterns.iter().zip(entries);
        let size = StencilConfig::default();
        let page = ComparisonPage {
            samples: self.samples,
            seed: self.seed,
            patterns: patterns
                .map(|(measures, entry)| ComparedPattern {
                    measures,
                    dots: entry
                        .ball
                        .pattern()
                        .dots()
                        .iter()
                        .map(|d| (*d).into())
                        .collect(),
                })
                .collect(),
            contests: &self.contests,
            dot_angle_rad: (size.hole_diameter_mm / size.ball_diameter_mm).asin(),
            command,
        };
        PageData {
            kind: "compare",
            title: &format!("Patterns compared: {}", names.join(", ")),
            subtitle: &format!(
                "{} trials per protocol, seed {}, spindoe {}",
                self.samples,
                self.seed,
                env!("CARGO_PKG_VERSION")
            ),
            content: &page,
        }
        .html()
    }

    /// Writes [`Self::html`] as `report.html` to `dir`.
    ///
    /// # Errors
    /// As [`Self::html`]; [`crate::Error::Write`] where the system refuses.
    pub fn write_page(&self, dir: &Path, entries: &[Entry], command: &str) -> Result<()> {
        files::write_bytes(&dir.join(PAGE), self.html(entries, command)?.as_bytes())
    }
}
