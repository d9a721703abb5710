//! A calibration in words.

use std::path::Path;

use crate::calibrate::{Calibration, DotState};
use crate::error::{counted, dots as named};
use crate::report::calibration::{CalibrationEvaluation, CalibrationReport};

/// Summarizes the calibration.
pub(super) fn say(calibration: &Calibration, evaluated: &CalibrationEvaluation, out: &Path) {
    let report = &evaluated.report;
    let off = match is_design(report) {
        true => format!(
            ", {:.2} deg rms off their nominal places",
            report.rms_offset_deg
        ),
        false => String::new(),
    };
    outln!(
        "{}: {} of {} dots measured from {} of {} frames{off}",
        out.display(),
        calibration.measured(),
        calibration.dots.len(),
        report.frames.fitted,
        report.frames.given
    );
    say_states(report);
    say_marks(report);
    if report.frames.with_other_balls > 0 {
        outln!(
            "  more than one ball in {}",
            counted(report.frames.with_other_balls, "frame")
        );
    }
    say_gain(report);
    for line in &report.advice {
        outln!("  {line}");
    }
    if let Some(set) = &report.dot_set {
        outln!("is this set of dots good? (numbers as in dots.png)");
        for line in set.words() {
            outln!("  {line}");
        }
    }
}

/// Whether the dots have places that were meant; what is built from the clip has none.
fn is_design(report: &CalibrationReport) -> bool {
    report.nominal_sha256.is_some()
}

/// Dots that are not measured well.
fn say_states(report: &CalibrationReport) {
    let unseen = match is_design(report) {
        true => "not seen, left at their nominal places",
        false => "seen too seldom to be measured",
    };
    for (state, words) in [
        (
            DotState::Missing,
            "never found where they should be, left out",
        ),
        (DotState::Unseen, unseen),
        (
            DotState::Doubtful,
            "may be print or stains, taken for less certain",
        ),
    ] {
        let dots = report.dots.iter().filter(|d| d.state == state);
        let numbers: Vec<usize> = dots.map(|d| d.nominal_number).collect();
        if !numbers.is_empty() {
            outln!("  {words}: {}", named(&numbers));
        }
    }
}

/// Marks that are none of the dots.
fn say_marks(report: &CalibrationReport) {
    for mark in &report.marks {
        let [x, y, z] = mark.direction;
        let taken = match mark.number {
            Some(number) => format!("taken in as dot {number}"),
            None if is_design(report) => "left out (--learn-extra takes it in)".to_owned(),
            None => "left out".to_owned(),
        };
        let which = match mark.mark {
            Some(number) => format!("mark {number} of {}", super::marks::PICTURE),
            None => format!("a mark at ({x:.3}, {y:.3}, {z:.3})"),
        };
        outln!(
            "  {which}, found in {} of {}: {taken}",
            mark.found,
            counted(mark.views, "view")
        );
    }
}

/// What frames that took no part, and the motion, say of it.
fn say_gain(report: &CalibrationReport) {
    let held_out = &report.held_out;
    if !held_out.frames.is_empty() {
        let [before_deg, after_deg] = held_out.median_deg;
        let [before, after] = held_out.mean_matched;
        match is_design(report) {
            false => outln!(
                "  frames that took no part: median residual {after_deg:.2} deg; {after:.1} dots a frame"
            ),
            true => outln!(
                "  frames that took no part: median residual {before_deg:.2} deg before, {after_deg:.2} deg after; \
                 {before:.1} and {after:.1} dots a frame"
            ),
        }
    }
    if let Some([before, after]) = &report.motion {
        let how = if after.precessing {
            " (precessing)"
        } else {
            ""
        };
        let (before_deg, after_deg) = (before.median_deg, after.median_deg);
        let off = match is_design(report) {
            true => format!("{before_deg:.2} deg before, {after_deg:.2} deg after"),
            false => format!("{after_deg:.2} deg"),
        };
        outln!("  off one smooth rotation{how}: median {off}");
    }
}
