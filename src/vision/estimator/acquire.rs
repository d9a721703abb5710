//! The ball in a large image: rough circles from a [coarse search](crate::vision::circle::coarse), looked at one after
//! the other until one is a ball by its dots.
//!
//! Circles whose rim is nearly whole, and moving ones, come first. Where none of them is the ball, what they outshone is
//! searched for, and all other circles follow, the likeliest first: beside a lamp or a white disc, most of the
//! others are made of its edges, and to refuse one of these takes as long as to find the ball. Last come the circles of the
//! image without nets, cords and other thin things.
//!
//! Guarantees: a circle is taken for the ball only by its dots, or where they are those of the mirrored pattern.

use std::time::{Duration, Instant};

use super::frame::Standing;
use super::search::{is_evident, promise};
use super::{Estimator, EstimatorWorkspace, FrameEstimate, FrameRejection, PROMISING, is_mirrored};
use crate::image::{ImageView, Roi};
use crate::recognize::Hint;
use crate::vision::camera::BallCircle;
use crate::vision::circle::NoBall;
use crate::vision::circle::coarse::{self, MAX_CIRCLES};
use crate::vision::detect::DotDetector;
use crate::vision::grid::Grid;

/// Largest radius of the coarse search, as a part of the longer side.
const MAX_COARSE: f64 = 0.4;
/// Smallest radius that the coarse search is sure to see, values of the first size that it searches.
const MIN_COARSE: f64 = 5.0;
/// A strip that is thinner than this at the first size shows no arc of a ball.
const MIN_STRIP: usize = 4;

/// The circles that are tried one after the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Those that stand out.
    First,
    /// What these outshone, and the others.
    Beyond,
    /// Those of the image without what is thin.
    Plain,
}

/// A part of a frame and the sizes of balls that are looked for in it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hunt {
    part: Roi,
    /// The first size that is searched: so often halved.
    level: u32,
    /// Radii, pixels.
    radii: (f64, f64),
    /// Whether it goes on where a coarser one has found nothing.
    is_fine: bool,
}

impl Hunt {
    /// For balls of any size from 5 pixels of radius at the coarse scale on.
    pub fn everywhere(part: Roi) -> Self {
        let level = coarse::level(part.width, part.height);
        Self {
            part,
            level,
            radii: (
                smallest(level),
                MAX_COARSE * part.width.max(part.height) as f64,
            ),
            is_fine: false,
        }
    }

    /// For balls up to `halvings` times half as large as the smallest of [`Hunt::everywhere`], and not those of fewer.
    pub fn finer(part: Roi, halvings: u32) -> Self {
        let level = coarse::level(part.width, part.height).saturating_sub(halvings);
        Self {
            part,
            level,
            radii: (smallest(level), 1.2 * smallest(level + 1)),
            is_fine: true,
        }
    }

    /// For a ball that was seen with this outline, within so many radii; `None` outside the image.
    pub fn nearby(circle: &BallCircle, reach: f64, image: &ImageView<'_>) -> Option<Self> {
        let part = circle.region(reach, image.width(), image.height())?;
        let mut level = 0;
        while circle.radius / f64::from(2u32 << level) >= 1.4 * MIN_COARSE {
            level += 1;
        }
        Some(Self {
            part,
            level,
            radii: (0.7 * circle.radius, 1.4 * circle.radius),
            is_fine: false,
        })
    }
}

/// The smallest radius, pixels, that is seen in an image that was halved so often.
fn smallest(level: u32) -> f64 {
    MIN_COARSE * f64::from(1u32 << level)
}

impl<D: DotDetector> Estimator<D> {
    /// Looks for the ball in a large image at a coarse scale; whether one was found, by its dots. Without one, `out` has
    /// the best of the circles, if there is any; a fine hunt keeps that of the coarser one before.
    pub(super) fn acquire(
        &self,
        image: ImageView<'_>,
        hunt: &Hunt,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        out: &mut FrameEstimate,
    ) -> bool {
        let Hunt {
            part,
            level,
            radii,
            is_fine,
        } = *hunt;
        let (width, height) = (part.width, part.height);
        if width.min(height) >> level < MIN_STRIP {
            out.clear();
            out.outcome = Err(FrameRejection::NoBall(NoBall::TooSmall { width, height }));
            return false;
        }
        let radii = (radii.0.max(self.config.circle.min_radius_px), radii.1);
        let mut circles = std::mem::take(&mut ws.rough);
        let mut best = std::mem::take(&mut ws.best);
        best.clear();
        // What a coarser hunt leaves was looked at closely there.
        let known = if is_fine { promise(out) } else { 0.0 };
        let (mut is_found, mut tried, mut searched) = (false, 0, Duration::ZERO);
        // What stands out, then what that outshone and all the rest.
        for stage in [Stage::First, Stage::Beyond, Stage::Plain] {
            let begun = Instant::now();
            let scan = if is_fine {
                &mut ws.fine
            } else {
                &mut ws.coarse
            };
            let found = match stage {
                Stage::First => {
                    let shrink = |out: &mut _| image.shrink_into(&part, level, out);
                    let found = scan.search(level, radii, shrink);
                    tried = coarse::standing_out(found);
                    &found[..tried]
                }
                Stage::Beyond => scan.search_beyond(tried, level, radii),
                Stage::Plain => scan.search_plain(level, radii),
            };
            circles.clear();
            circles.reserve(2 * MAX_CIRCLES);
            circles.extend_from_slice(found);
            searched += begun.elapsed();
            if stage != Stage::First && circles.is_empty() {
                continue;
            }
            let place = Grid::of(&part, 0);
            for rough in &mut circles {
                rough.circle = place.circle_to_image(&rough.circle);
            }
            if is_fine || stage != Stage::First {
                // What the search before leaves.
                std::mem::swap(&mut best, out);
            }
            let scans = circles.iter();
            let scans = scans.map(|rough| (&rough.circle, Standing::Doubtful));
            is_found = self.try_circles(image, scans, searched, hint, ws, &mut best, out);
            if is_found {
                break;
            }
        }
        if !is_found && promise(out) > known {
            is_found = self.look_closer(image, hint, ws, &mut best, out);
        }
        if !is_found {
            if out.outline.is_none() {
                out.outcome = Err(FrameRejection::NoBall(NoBall::NoCircle { support: 0.0 }));
                out.timings.locate = searched;
            }
            // A pose that the dots do not make evident is no answer here.
            out.reject_pose();
        }
        ws.best = best;
        ws.rough = circles;
        is_found
    }

    /// Tries other outlines about the circle whose dots were nearest to an answer, that of `out`; whether one is the ball's.
    /// Else `out` is what it was.
    fn look_closer(
        &self,
        image: ImageView<'_>,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        before: &mut FrameEstimate,
        out: &mut FrameEstimate,
    ) -> bool {
        let Some(outline) = out.outline.filter(|_| promise(out) >= PROMISING) else {
            return false;
        };
        std::mem::swap(before, out);
        let circle = &outline.circle;
        self.search_near(image, circle, Standing::Likely, hint, ws, out);
        let spent = &before.timings;
        out.timings.locate += spent.locate + spent.detect + spent.identify;
        if is_evident(out) || is_mirrored(out) {
            return true;
        }
        std::mem::swap(before, out);
        false
    }

    /// Estimates a frame by the surroundings of one circle after the other until one is the ball; without one, `out` has
    /// `best`, or the one of the others whose dots were nearer to an answer.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn try_circles<'a>(
        &self,
        image: ImageView<'_>,
        circles: impl Iterator<Item = (&'a BallCircle, Standing)>,
        mut searched: Duration,
        hint: Option<&Hint>,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        best: &mut FrameEstimate,
        out: &mut FrameEstimate,
    ) -> bool {
        for (circle, standing) in circles {
            if ws.spending.is_over() {
                break;
            }
            self.search_near(image, circle, standing, hint, ws, out);
            let is_likely = standing == Standing::Likely;
            out.timings.locate += std::mem::take(&mut searched);
            if is_evident(out) || is_mirrored(out) || (is_likely && out.pose().is_some()) {
                return true;
            }
            searched += out.timings.locate + out.timings.detect + out.timings.identify;
            if best.outline.is_none() || promise(out) > promise(best) {
                std::mem::swap(best, out);
            }
        }
        std::mem::swap(best, out);
        false
    }
}
