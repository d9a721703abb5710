//! What criterion measured, line by line, with ratios.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde_json::Value;

/// The lines, in the order in which they were measured.
pub struct Table {
    directory: PathBuf,
    begun: SystemTime,
    lines: Vec<Line>,
}

struct Line {
    /// Criterion's name of it: group, function and value, divided by `/`.
    name: String,
    /// The name of what it is compared with.
    baseline: Option<String>,
}

impl Table {
    /// An empty one of what criterion leaves in `directory` from now on.
    pub fn new(directory: PathBuf) -> Self {
        Self {
            directory,
            begun: SystemTime::now(),
            lines: Vec::new(),
        }
    }

    /// A line for a measurement.
    pub fn line(&mut self, name: impl Into<String>) {
        let name = name.into();
        self.lines.push(Line {
            name,
            baseline: None,
        });
    }

    /// A line for a measurement, and one for the faithful baseline that does the same work.
    pub fn pair(&mut self, name: impl Into<String>, baseline: impl Into<String>) {
        let (name, baseline) = (name.into(), baseline.into());
        self.lines.push(Line {
            name,
            baseline: Some(baseline.clone()),
        });
        self.line(baseline);
    }

    /// Prints what this run has measured.
    pub fn print(&self) {
        println!("\n| what | median | of the run before | of the baseline |\n|---|---|---|---|");
        for line in &self.lines {
            let Some(median) = self.median_ns(&line.name) else {
                continue;
            };
            let before = self.change(&line.name).unwrap_or_default();
            let baseline = line.baseline.as_ref().and_then(|b| self.median_ns(b));
            let ratio = baseline.map_or(String::new(), |b| format!("{:.3}", median / b));
            println!("| {} | {} | {before} | {ratio} |", line.name, time(median));
        }
    }

    fn median_ns(&self, name: &str) -> Option<f64> {
        let all = self.read(&format!("{name}/new/estimates.json"))?;
        all["median"]["point_estimate"].as_f64()
    }

    /// The time as a multiple of the earlier one, with its 95 % interval.
    fn change(&self, name: &str) -> Option<String> {
        let median = &self.read(&format!("{name}/change/estimates.json"))?["median"];
        let ratio = |value: &Value| value.as_f64().map(|change| 1.0 + change);
        let interval = &median["confidence_interval"];
        Some(format!(
            "{:.3} [{:.3}, {:.3}]",
            ratio(&median["point_estimate"])?,
            ratio(&interval["lower_bound"])?,
            ratio(&interval["upper_bound"])?
        ))
    }

    /// A file of this run; `None` where only an earlier one left it.
    fn read(&self, place: &str) -> Option<Value> {
        let path: &Path = &self.directory.join(place);
        let changed = path.metadata().ok()?.modified().ok()?;
        if changed < self.begun {
            return None;
        }
        serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()
    }
}

/// Nanoseconds in a unit that leaves few digits.
fn time(ns: f64) -> String {
    match ns {
        ns if ns < 1e3 => format!("{ns:.1} ns"),
        ns if ns < 1e6 => format!("{:.2} us", 1e-3 * ns),
        ns if ns < 1e9 => format!("{:.2} ms", 1e-6 * ns),
        ns => format!("{:.2} s", 1e-9 * ns),
    }
}
