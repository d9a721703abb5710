//! The plots of a comparison of patterns.

use std::path::Path;

use super::compare::{Comparison, Contest, Entry};
use super::plots::{in_each_format, point, success, success_name};
use crate::design::OrientationBound;
use crate::error::Result;
use crate::plot::{BarChart, BarGroup, LinePlot, LineSeries, RateScale, bar_comparison, line_plot};
use crate::recognize::RecognizerName;
use crate::view::ProtocolName;

/// Viewing directions in the plot of the orientation bound.
const VIEWS: usize = 4_000;

impl Comparison {
    /// Draws the failures of each recognizer (`compare_robust`, `compare_paper`) and the
    /// orientation bound by viewing direction (`compare_bound`) into `dir`, as PNG and SVG.
    ///
    /// # Errors
    /// [`crate::Error::Write`] on an I/O failure.
    pub fn write_plots(&self, dir: &Path, entries: &[Entry]) -> Result<()> {
        for recognizer in RecognizerName::ALL {
            let of: Vec<&Contest> = self
                .contests
                .iter()
                .filter(|c| c.recognizer == recognizer)
                .collect();
            if !of.is_empty() {
                in_each_format(dir, &format!("compare_{recognizer}"), |path| {
                    self.draw_rates(path, recognizer, &of)
                })?;
            }
        }
        let series = entries
            .iter()
            .map(|c| {
                let mut all =
                    OrientationBound::default().by_direction(c.ball.pattern().dots(), VIEWS);
                all.retain(|b| b.is_finite());
                all.sort_unstable_by(f64::total_cmp);
                let points = all
                    .iter()
                    .enumerate()
                    .map(|(i, b)| (100.0 * (i as f64 + 0.5) / all.len() as f64, *b))
                    .collect();
                LineSeries {
                    name: c.name.clone(),
                    points,
                }
            })
            // Patterns with few dots may have no finite bound in any direction.
            .filter(|series| !series.points.is_empty())
            .collect::<Vec<_>>();
        if series.is_empty() {
            return Ok(());
        }
        let plot = LinePlot {
            title: "Orientation error that the dots in view allow (Cramér-Rao)".into(),
            x_label: "viewing directions, best first [%]".into(),
            y_label: "bound [multiples of a dot's noise]".into(),
            log_y: false,
            series,
        };
        in_each_format(dir, "compare_bound", |path| line_plot(path, &plot))
    }

    fn draw_rates(&self, path: &Path, recognizer: RecognizerName, of: &[&Contest]) -> Result<()> {
        let groups = ProtocolName::ALL
            .map(|name| {
                let rates = of
                    .iter()
                    .filter(|c| c.validation.protocol == name)
                    .map(|c| Some(point(0.0, success(name, &c.validation))))
                    .collect();
                BarGroup {
                    name: format!("{name}: {}", success_name(name)),
                    rates,
                }
            })
            .to_vec();
        bar_comparison(
            path,
            &BarChart {
                title: format!(
                    "Views not identified by the recognizer `{recognizer}`: {} trials per protocol, 95 % intervals",
                    self.samples
                ),
                y_label: "views not identified".into(),
                scale: RateScale::Failure,
                series: self.patterns.iter().map(|p| p.name.clone()).collect(),
                groups,
            },
        )
    }
}
