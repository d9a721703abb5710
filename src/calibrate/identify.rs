//! Identification of frames whose dots are already detected, with another pattern than before.

use crate::ball::Ball;
use crate::concurrency;
use crate::error::Result;
use crate::vision::dots::detector::DotDetector;
use crate::vision::frame::config::EstimatorConfig;
use crate::vision::{Estimator, FrameEstimate};

/// Frames handled by one task: a workspace serves them all.
const CHUNK: usize = 32;

/// The frames, identified anew and independently from their detections with this ball.
///
/// # Errors
/// As [`Estimator::for_ball`].
pub fn identify_frames(
    ball: &Ball,
    config: &EstimatorConfig,
    frames: &[FrameEstimate],
) -> Result<Vec<FrameEstimate>> {
    let estimator = Estimator::for_ball(ball, *config, DotDetector::Given)?;
    let chunks: Vec<&[FrameEstimate]> = frames.chunks(CHUNK).collect();
    let done = concurrency::map(&chunks, |chunk| {
        let mut workspace = estimator.workspace();
        let identified = chunk.iter().map(|frame| {
            let mut frame = frame.clone();
            estimator.identify_detections(&mut workspace, &mut frame);
            frame
        });
        identified.collect::<Vec<_>>()
    });
    Ok(done.into_iter().flatten().collect())
}
