//! The settings of a clip's pass: where the ball is, where the times come from, what may be spent.

use std::path::PathBuf;

use super::batch::BatchFrame;
use super::frame_table::{FrameCircles, FrameTimes};
use super::sequence::SequenceConfig;
use crate::error::{Result, require};
use crate::image::{DEFAULT_MAX_PIXELS, Roi};
use crate::vision::frame::prior::{Budget, OutlinePrior};

/// Where the times of the frames come from.
#[derive(Debug, Clone, Default)]
pub enum FrameClock {
    /// From the names of the files, or the video, or as they were stated with frames in memory.
    #[default]
    Inputs,
    /// The frames follow each other evenly, at so many a second.
    FramesPerSecond(f64),
    /// From a table.
    Table(FrameTimes),
    /// From a list, in the frames' order, seconds, with the file that has it.
    Ordered(PathBuf, Vec<f64>),
}

/// What is estimated, and how.
#[derive(Debug, Clone)]
pub struct BatchConfig {
    /// The ball's outline in all frames; by default it is found in each.
    pub outline: Option<OutlinePrior>,
    /// The outlines of single frames; it is found in those that have no row.
    pub circles: Option<FrameCircles>,
    /// The part of every frame in which the ball is looked for; by default all of it.
    pub roi: Option<Roi>,
    /// Where the times come from.
    pub clock: FrameClock,
    /// How the frames of a sequence inform each other.
    pub sequence: SequenceConfig,
    /// Whether frames stay independent of each other.
    pub independent: bool,
    /// What may be spent on a frame in the first pass.
    pub budget: Budget,
    /// Rolling shutter: time from the exposure of a picture's first row to that of its last, seconds; 0 for a global shutter. A frame's
    /// time is then that at which the ball is seen.
    pub readout_s: f64,
    /// Whether left and right are exchanged before anything else.
    pub mirrored: bool,
    /// Whether the dots are brighter than the ball: frames are then estimated as negatives.
    pub bright_dots: bool,
    /// Whether all frames together decide if the tables fit and the images are mirrored ([`Judgment`](super::judgment::Judgment)); where they
    /// do not fit, no frame keeps its pose.
    pub verdict: bool,
    /// Maximum number of pixels of a picture.
    pub max_pixels: u64,
}

impl BatchConfig {
    /// Time from row to row of the pictures, seconds; 0 for a global shutter.
    pub fn row_s<K>(&self, frames: &[BatchFrame<K>]) -> f64 {
        let rows = frames
            .iter()
            .filter_map(|f| f.size)
            .map(|[_, rows]| rows)
            .max();
        self.readout_s / rows.map_or(1, |rows| rows.max(2) - 1) as f64
    }

    /// Rejects a readout that is longer than the frames are apart.
    pub(super) fn check_readout(&self, times_s: &[f64]) -> Result<()> {
        if let [first, .., last] = times_s {
            let apart_s = (last - first) / (times_s.len() - 1) as f64;
            let expected = format!("at most {apart_s:.6}, the mean time between two frames");
            require(
                self.readout_s <= apart_s,
                "readout_s",
                &expected,
                self.readout_s,
            )?;
        }
        Ok(())
    }
}

impl Default for BatchConfig {
    /// Outlines found, times from the inputs, frames as they are, no verdict, up to 64 million pixels each.
    fn default() -> Self {
        Self {
            outline: None,
            circles: None,
            roi: None,
            clock: FrameClock::default(),
            sequence: SequenceConfig::default(),
            independent: false,
            budget: Budget::default(),
            readout_s: 0.0,
            mirrored: false,
            bright_dots: false,
            verdict: false,
            max_pixels: DEFAULT_MAX_PIXELS,
        }
    }
}
