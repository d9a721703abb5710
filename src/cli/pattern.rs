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
