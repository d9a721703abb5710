//! Which design a built pattern is.

use super::PLACED;
use crate::error::Result;
use crate::pattern::Pattern;
use crate::recognize::Recognizer;
use crate::recognize::robust::RobustRecognizer;
use crate::view::{DotUncertainty, ObservedDot, ViewModel};

/// Error of a hand-drawn dot, per tangent axis, radians, and the share of a design's dots that must be
/// on the ball.
const DRAWN_SIGMA_RAD: f64 = 0.03;
const MIN_AGREEING: f64 = 0.8;
/// A visibility limit under which all dots are visible.
const EVERYWHERE: f64 = -0.99;

/// Which of these designs a built pattern is: its position, where all but a few of the dots of both agree.
///
/// # Errors
/// As [`RobustRecognizer::new`].
pub fn matching_design(built: &Pattern, designs: &[Pattern]) -> Result<Option<usize>> {
    let observed: Vec<ObservedDot> = built
        .dots()
        .iter()
        .map(|direction| ObservedDot {
            direction: *direction,
            uncertainty: DotUncertainty::Isotropic {
                sigma_rad: DRAWN_SIGMA_RAD,
            },
        })
        .collect();
    let view = ViewModel {
        // The pattern is known from all sides.
        visibility_limit: EVERYWHERE,
        false_dot_limit: EVERYWHERE,
        ..ViewModel::default()
    };
    let mut best = (0, None);
    for (k, design) in designs.iter().enumerate() {
        let recognizer = RobustRecognizer::new(design, view.into())?;
        let Ok(found) = recognizer.identify(&observed, &mut recognizer.workspace()) else {
            continue;
        };
        let larger = design.len().max(built.len());
        let agrees =
            found.confidence >= PLACED && found.matched() as f64 >= MIN_AGREEING * larger as f64;
        if agrees && found.matched() > best.0 {
            best = (found.matched(), Some(k));
        }
    }
    Ok(best.1)
}
