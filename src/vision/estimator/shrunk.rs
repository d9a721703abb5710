//! The thorough search in images that are too large for it.
//!
//! The search for a ball's outline by its edges keeps some sixty bytes a pixel. An image of 3840 x 2160
//! pixels would take half a gigabyte on every thread, for balls that the coarse searches have not found:
//! their edges are faint. Here the image is halved until it is small enough, outlines are looked for in
//! that, and each is then estimated in its surroundings at the full scale.
//!
//! Not promised: balls whose radius, so often halved, is below
//! [`min_radius_px`](crate::vision::circle::CircleConfig::min_radius_px); at 3840 x 2160 faint ones of less
//! than 64 pixels.

use std::time::Instant;

use super::frame::Standing;
use super::search::level_of;
use super::{Estimator, EstimatorWorkspace, FrameEstimate, FrameRejection};
use crate::image::{ImageView, Roi};
use crate::recognize::Hint;
use crate::vision::detect::DotDetector;

/// Images of more pixels are searched at a smaller scale.
pub(super) const MAX_THOROUGH: usize = 4_000_000;
/// They are halved until they have no more pixels than this.
const MAX_SHRUNK: f64 = 1_100_000.0;

impl<D: DotDetector> Estimator<D> {
    /// Estimates a frame with the ball somewhere in a part of it that is too large to be searched thoroughly.
    pub(super) fn estimate_shrunk(
        &self,
        image: ImageView<'_>,
        part: &Roi,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) {
        let begun = Instant::now();
        let pixels = (part.width * part.height) as f64;
        let level = level_of(pixels.sqrt(), MAX_SHRUNK.sqrt());
        let mut circles = std::mem::take(&mut ws.shrunk);
        circles.clear();
        let net = self.outline_net.as_ref();
        let mut none = None;
        self.viewed_at(image, part, level, ws, |view, ws| {
            let found = ws
                .locator
                .outlines(view.gray, view.image, net, &mut circles);
            none = found.err();
            for circle in &mut circles {
                *circle = view.grid.circle_to_image(circle);
            }
        });
        let mut best = std::mem::take(&mut ws.best);
        best.clear();
        // The first is the likeliest; the others need more evidence.
        let searches = circles.iter().enumerate().map(|(k, circle)| match k {
            0 => (circle, Standing::Likely),
            _ => (circle, Standing::Doubtful),
        });
        let searched = begun.elapsed();
        if !self.try_circles(image, searches, searched, hint, ws, &mut best, out)
            && let Some(why) = none
        {
            out.outcome = Err(FrameRejection::NoBall(why));
            out.timings.locate = searched;
        }
        ws.best = best;
        ws.shrunk = circles;
    }
}
