//! Keeps what a clip shows of a ball's surface.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::balls::BallEstimate;
use super::batch::BatchObserver;
use super::config::BatchConfig;
use crate::error::{Error, Result};
use crate::geometry::spiral_directions;
use crate::image::RgbImage;
use crate::pattern::Pattern;
use crate::surface::PaintedFrame;
use crate::vision::Budget;

/// What is kept of a clip's frames takes no more, bytes; as much again is made of it.
const MOST_BYTES: usize = 2 << 30;

/// Directions of a pattern that stands in for the ball's.
const STAND_IN_DOTS: usize = 20;

/// Keeps what frames show of the ball, up to 2 GiB.
#[derive(Debug)]
pub struct SurfaceObserver {
    bytes: AtomicUsize,
    most_bytes: usize,
}

impl Default for SurfaceObserver {
    fn default() -> Self {
        Self {
            bytes: AtomicUsize::new(0),
            most_bytes: MOST_BYTES,
        }
    }
}

impl SurfaceObserver {
    /// Settings under which outlines and detections are found and no pose is looked for, which is all that is needed.
    pub fn settings(batch: BatchConfig) -> BatchConfig {
        BatchConfig {
            independent: true,
            budget: Self::budget(),
            ..batch
        }
    }

    /// The pattern of an estimator that finds no more: it stands in for the ball's.
    ///
    /// # Errors
    /// As [`Pattern::new`]; none in fact.
    pub fn stand_in() -> Result<Pattern> {
        Pattern::new(spiral_directions(STAND_IN_DOTS).collect())
    }

    /// What finding them in a frame may cost.
    pub fn budget() -> Budget {
        Budget {
            runs: 1,
            ..Budget::default()
        }
    }
}

impl BatchObserver for SurfaceObserver {
    type Kept = PaintedFrame;

    fn keep(&self, image: &RgbImage, balls: &[BallEstimate]) -> Result<PaintedFrame> {
        let take = |outline| PaintedFrame::take(&image.to_gray(), outline);
        let outline = balls.first().and_then(|ball| ball.frame.outline.as_ref());
        let taken = outline.map(take).unwrap_or_default();
        let before = self.bytes.fetch_add(taken.bytes(), Ordering::Relaxed);
        if before + taken.bytes() > self.most_bytes {
            let problem = format!(
                "expected balls of {} MiB at most in a clip: give fewer frames, or smaller images",
                self.most_bytes >> 20
            );
            return Err(Error::argument("images", problem));
        }
        Ok(taken)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;
    use crate::vision::optics::camera::{BallCircle, Pixel};
    use crate::vision::{FrameEstimate, Outline};

    #[test]
    fn a_clip_that_takes_too_much_memory_is_refused() {
        let image = RgbImage::new(80, 80, vec![[0.5; 3]; 6_400]).expect("an image");
        let circle = BallCircle::new(Pixel { u: 40.0, v: 40.0 }, 30.0);
        let outline = Outline::given(circle, Matrix3::zeros());
        let ball = BallEstimate::of(FrameEstimate::from_detections(outline, Vec::new()), 0);
        let observer = SurfaceObserver {
            bytes: AtomicUsize::new(0),
            most_bytes: 20_000,
        };
        let kept: Vec<bool> = (0..5)
            .map(|_| observer.keep(&image, std::slice::from_ref(&ball)).is_ok())
            .collect();
        assert_eq!(kept, [true, true, true, false, false]);
    }
}
