//! A calibration in words.

use std::path::Path;

use crate::calibrate::{Calibration, DotState};
use crate::error::{counted, dots as named};
use crate::report::calibration::{CalibrationEvaluation, CalibrationReport};

/// Summarizes the calibration.
pub(super) fn say(calibration: &Calibration, evaluated: &CalibrationEvaluation, out: &Path) {
    let CalibrationReport {
        frames,
        held_out,
        motion,
        advice,
        ..
    } = &evaluated.report;
    // What is built from the clip has no places that were meant.
    let is_design = evaluated.report.nominal_sha256.is_some();
    let off = match is_design {
        true => format!(
            ", {:.2} deg rms off their nominal places",
            evaluated.report.rms_offset_deg
        ),
        false => String::new(),
    };
    outln!(
        "{}: {} of {} dots measured from {} of {} frames{off}",
        out.display(),
        calibration.measured(),
        calibration.dots.len(),
        frames.fitted,
        frames.given
    );
    for (state, words) in [
        (
            DotState::Missing,
            "never found where they should be, left out",
        ),
        (
            DotState::Unseen,
            match is_design {
                true => "not seen, left at their nominal places",
                false => "seen too seldom to be measured",
            },
        ),
        (
            DotState::Doubtful,
            "may be print or stains, taken for less certain",
        ),
    ] {
        let dots = evaluated.report.dots.iter().filter(|d| d.state == state);
        let numbers: Vec<usize> = dots.map(|d| d.nominal_number).collect();
        if !numbers.is_empty() {
            outln!("  {words}: {}", named(&numbers));
        }
    }
    for mark in &evaluated.report.marks {
        let [x, y, z] = mark.direction;
        let taken = match mark.number {
            Some(number) => format!("taken in as dot {number}"),
            None if is_design => "left out (--learn-extra takes it in)".to_owned(),
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
    if frames.with_other_balls > 0 {
        outln!(
            "  more than one ball in {}",
            counted(frames.with_other_balls, "frame")
        );
    }
    let is_judged = !held_out.frames.is_empty();
    if is_judged && !is_design {
        outln!(
            "  frames that took no part: median residual {:.2} deg; {:.1} dots a frame",
            held_out.median_deg[1],
            held_out.mean_matched[1]
        );
    } else if is_judged {
        outln!(
            "  frames that took no part: median residual {:.2} deg before, {:.2} deg after; {:.1} and {:.1} dots a frame",
            held_out.median_deg[0],
            held_out.median_deg[1],
            held_out.mean_matched[0],
            held_out.mean_matched[1]
        );
    }
    if let Some([before, after]) = motion {
        let how = if after.precessing {
            " (precessing)"
        } else {
            ""
        };
        let before = match is_design {
            true => format!("{:.2} deg before, ", before.median_deg),
            false => String::new(),
        };
        let after_deg = after.median_deg;
        let after = if is_design { " after" } else { "" };
        outln!("  off one smooth rotation{how}: median {before}{after_deg:.2} deg{after}");
    }
    for line in advice {
        outln!("  {line}");
    }
    if let Some(set) = &evaluated.report.dot_set {
        outln!("is this set of dots good? (numbers as in dots.png)");
        for line in set.words() {
            outln!("  {line}");
        }
    }
}
