//! The ball's pattern as an argument, alike in all commands that need one.

use std::path::PathBuf;

use clap::Args;

use crate::ball::Ball;
use crate::error::Result;

#[derive(Debug, Args)]
pub struct PatternSource {
    /// The pattern: a shipped one by its name (dots20), its CSV (unit vectors x,y,z), a table (.npz), or the folder of a
    /// design or calibration.
    pattern: PathBuf,
}

impl PatternSource {
    /// The ball that carries it.
    pub fn ball(&self) -> Result<Ball> {
        Ball::read(&self.pattern)
    }
}

/// Minimum width of a dot in the image, pixels: 3 mm on a ball of 40 mm and 50 pixels. On rendered
/// frames smaller dots cost 5 to 20 points of correct answers.
pub const MIN_DOT_PX: f64 = 3.75;
/// The usual ball in an image, pixels.
const USUAL_BALL_PX: f64 = 60.0;

/// Warns of dots that are too small for most cameras: where they are narrower than [`MIN_DOT_PX`] on a ball of 60 pixels.
/// The rates are those of `dots20` in any surroundings (docs/measurements/camera.md, "Small dots").
pub fn warn_of_small_dots(ball_mm: f64, dot_mm: f64) {
    let width_px = USUAL_BALL_PX * dot_mm / ball_mm;
    if width_px < MIN_DOT_PX {
        errln!(
            "note: dots of {dot_mm} mm are {width_px:.1} pixels wide on a ball of {USUAL_BALL_PX} pixels: of its \
             frames far fewer are answered than with the usual {:.1} mm (87 % with a tenth of the ball, 73 with 6 %, 35 with 3.5 %)",
            0.1 * ball_mm
        );
    }
}
