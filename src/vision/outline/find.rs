//! A ball's outline without its dots: for balls whose marks are not known.
//!
//! ```text
//! region  -> circles of the edges, of a large image in one of a few hundred pixels   (BallFinder)
//! circles -> each near by in the image itself: edges and net together                (Locator)
//! outline    the most complete of these, unless it is a mark within another; off the axis of a known camera seen straight at the ball
//! ```
//!
//! What is expected (an outline of [`Prior`]) is looked for near by, and what is given is taken as it is. A circle of the edges is
//! worth the share of its rim that has an edge, and of the whole that lies in the image.
//!
//! Guarantees: the answer depends on image and prior alone. Not guaranteed: that the most complete circle is the ball. What is round
//! and lies behind it, or hides it, can be more complete; the frames of a clip decide that ([`clip`](crate::clip)).

use crate::error::Result;
use crate::geometry::Position;
use crate::image::{ImageView, Roi};
use crate::vision::dots::cap::CapShape;
use crate::vision::frame::config::{CameraModel, OutlineMethod};
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection};
use crate::vision::frame::outline::Outline;
use crate::vision::frame::position;
use crate::vision::frame::prior::Prior;
use crate::vision::optics::ball_pixels::BallPixels;
use crate::vision::optics::camera::{BallCircle, BallView, Camera};
use crate::vision::optics::crop::{Crop, Images};
use crate::vision::optics::intrinsics::Intrinsics;
use crate::vision::outline::circle::{BallFinder, BallFit, CircleConfig, NoBall};
use crate::vision::outline::locate::{Locator, OutlineCandidate};
use crate::vision::outline::net::OutlineNet;
use crate::vision::outline::place::{FOR_OUTLINE, Place};
use crate::vision::outline::recenter::Recentering;
use crate::vision::outline::rim::{RimFit, RimFitter, RimShape};

/// Circles are looked for in an image that is halved until its longer side has no more pixels than this.
const SIDE: usize = 320;
/// Circles that are looked at closer.
const TRIED: usize = 4;
/// A circle as complete as this is the best of its place.
const COMPLETE: f64 = 0.85;
/// A circle of less than this part of another's radius, within so many of its radii, may be a mark on it; the other is a ball's from this
/// worth on.
const MARK: f64 = 0.75;
const AROUND: f64 = 1.05;
const CLEAR: f64 = 0.55;
/// What an outline of the net alone is worth: that of edges on so much of the rim.
const BY_NET: f64 = 0.5;

/// Finds outlines: what is known of balls and camera.
#[derive(Debug, Clone)]
pub struct OutlineFinder {
    circle: CircleConfig,
    net: Option<OutlineNet>,
    intrinsics: Option<Intrinsics>,
    ball_radius_m: Option<f64>,
}

/// Working memory of an [`OutlineFinder`], one a thread.
#[derive(Debug)]
pub struct OutlineSearch {
    images: Images,
    /// At the small scale.
    finder: BallFinder,
    circles: Vec<BallCircle>,
    locator: Locator,
    recentering: Recentering,
    rim: RimFitter,
    /// What was found at the place in hand.
    there: FrameEstimate,
}

impl OutlineFinder {
    /// For balls within these bounds, seen by this camera.
    ///
    /// # Errors
    /// [`crate::Error::Internal`] where this crate was built with damaged weights.
    pub fn new(circle: CircleConfig, method: OutlineMethod, camera: &CameraModel) -> Result<Self> {
        Ok(Self {
            circle,
            net: method.net()?,
            intrinsics: match camera {
                CameraModel::Known(Camera::Perspective(intrinsics)) => Some(*intrinsics),
                _ => None,
            },
            ball_radius_m: None,
        })
    }

    /// The same for balls of this radius, m: where the intrinsics are known, frames say where the ball is.
    #[must_use]
    pub fn with_ball_radius_m(self, radius_m: f64) -> Self {
        Self {
            ball_radius_m: Some(radius_m),
            ..self
        }
    }

    /// The camera's intrinsics, where they are known.
    pub(crate) fn intrinsics(&self) -> Option<Intrinsics> {
        self.intrinsics
    }

    /// A new workspace.
    pub fn workspace(&self) -> OutlineSearch {
        OutlineSearch {
            images: Images::default(),
            finder: BallFinder::new(self.circle),
            circles: Vec::new(),
            locator: Locator::new(self.circle),
            recentering: Recentering::new(self.circle),
            rim: RimFitter::default(),
            there: FrameEstimate::default(),
        }
    }

    /// Finds the ball's outline; `out` has it, or why there is none, and neither dots nor a pose.
    pub fn find<'a>(
        &self,
        image: impl Into<ImageView<'a>>,
        prior: &Prior,
        ws: &mut OutlineSearch,
        out: &mut FrameEstimate,
    ) {
        let image = image.into();
        out.clear();
        let (width, height) = (image.width(), image.height());
        let region = prior.region.unwrap_or(Roi::whole(width, height));
        let least = (self.circle.min_radius_px as usize).max(1);
        let is_wide = |r: &Roi| r.width.min(r.height) >= least;
        let region = region.cut(width, height).filter(is_wide);
        let expected = prior.outline.map(|o| match o.believed() {
            Some(known) => Place::Known(known),
            None => Place::Near(o.circle),
        });
        let found = match (expected, region) {
            (Some(place), _) => self.best_of(image, &[place], ws, out),
            (None, Some(region)) => self.find_within(image, &region, ws, out),
            (None, None) => Err(NoBall::TooSmall { width, height }),
        };
        if let Err(why) = found {
            out.clear();
            out.outcome = Err(FrameRejection::NoBall(why));
        }
    }

    /// The same anywhere in a part of the image.
    fn find_within(
        &self,
        image: ImageView<'_>,
        region: &Roi,
        ws: &mut OutlineSearch,
        out: &mut FrameEstimate,
    ) -> std::result::Result<(), NoBall> {
        let mut level = 0;
        while region.width.max(region.height) >> level > SIDE {
            level += 1;
        }
        if level == 0 {
            return self.best_of(image, &[Place::Within(*region)], ws, out);
        }
        let (finder, circles) = (&mut ws.finder, &mut ws.circles);
        let found = ws.images.view(image, region, level, |crop| {
            let in_gray = finder.find_of_any_sign(crop.gray);
            let found = match crop.image {
                ImageView::Color(color) if in_gray.is_err() => {
                    finder.find_in_color(crop.gray, color)
                }
                _ => in_gray,
            };
            let all = found.iter().copied().chain(finder.others());
            circles.clear();
            circles.extend(all.map(|fit| crop.grid.circle_to_image(&fit.circle)));
            found
        });
        let places: Vec<Place> = ws
            .circles
            .iter()
            .take(TRIED)
            .map(|c| Place::Near(*c))
            .collect();
        match (self.best_of(image, &places, ws, out), found) {
            (Ok(()), _) => Ok(()),
            // Balls that the small scale does not show.
            (Err(_), _) => self.best_of(image, &[Place::Within(*region)], ws, out),
        }
    }

    /// The outline at these places: the most complete one, or one around it.
    fn best_of(
        &self,
        image: ImageView<'_>,
        places: &[Place],
        ws: &mut OutlineSearch,
        out: &mut FrameEstimate,
    ) -> std::result::Result<(), NoBall> {
        let mut best: Option<f64> = None;
        let mut why = NoBall::NoCircle { support: 0.0 };
        for place in places {
            let Some((part, level)) = place.part(&image, FOR_OUTLINE) else {
                continue;
            };
            let mut images = std::mem::take(&mut ws.images);
            let found = images.view(image, &part, level, |crop| self.at_place(&crop, place, ws));
            ws.images = images;
            match found {
                Ok(worth) if best.is_none_or(|best| is_better(worth, &ws.there, best, out)) => {
                    best = Some(worth);
                    std::mem::swap(&mut ws.there, out);
                }
                Ok(_) => {}
                Err(reason) => why = reason,
            }
        }
        best.map(|_| ()).ok_or(why)
    }

    /// The most complete outline at a place, written into the workspace; what it is worth.
    fn at_place(
        &self,
        crop: &Crop<'_>,
        place: &Place,
        ws: &mut OutlineSearch,
    ) -> std::result::Result<f64, NoBall> {
        let net = self.net.as_ref();
        ws.locator.begin(crop, place, net)?;
        let is_open = matches!(place, Place::Within(_));
        let mut best: Option<(f64, OutlineCandidate)> = None;
        while let Some(candidate) = ws.locator.next(crop.gray, net, is_open) {
            let worth = completeness(candidate.fit.as_ref());
            if best.is_none_or(|(known, _)| worth > known) {
                best = Some((worth, candidate));
            }
            if worth >= COMPLETE {
                break;
            }
        }
        let (worth, candidate) = best.ok_or(NoBall::NoCircle { support: 0.0 })?;
        let there = &mut ws.there;
        there.clear();
        (there.outline, there.fit) = (Some(candidate.outline), candidate.fit);
        if let Some(intrinsics) = &self.intrinsics {
            let k = crop.grid.intrinsics_to_part(intrinsics);
            let contrast = ws.locator.color_contrast();
            ws.recentering.recenter(&k, crop.gray, contrast, there);
        }
        there.circle = there.outline.map(|o: Outline| o.circle);
        there.place(&crop.grid);
        let rim = self.rim(crop, there, &mut ws.rim);
        there.oval = rim.and_then(|(circle, rim)| Some((circle, rim.oval?)));
        there.outline_position = self.position(there, rim);
        Ok(worth)
    }
}

impl OutlineFinder {
    /// The ball's center by its rim, or where that is not clear by the outline.
    fn position(
        &self,
        there: &FrameEstimate,
        rim: Option<(BallCircle, RimFit)>,
    ) -> Option<Position> {
        let outline = there.outline?;
        let seen = match rim {
            Some((circle, rim)) => rim.correct(&circle, &outline),
            None => outline.with_model_error(),
        };
        position::of_outline(
            &seen.with_size_error(),
            self.intrinsics?,
            self.ball_radius_m?,
        )
    }

    /// The rim of an outline that was found by its edges, by known intrinsics, and the circle about which it was fitted.
    fn rim(
        &self,
        crop: &Crop<'_>,
        there: &FrameEstimate,
        rim: &mut RimFitter,
    ) -> Option<(BallCircle, RimFit)> {
        let (circle, fit) = (there.circle?, there.fit?);
        let view = BallView::new(&Camera::Perspective(self.intrinsics?), circle).ok()?;
        let pixels = BallPixels {
            gray: crop.gray,
            grid: crop.grid,
            view: &view,
        };
        let shape = CapShape::of_edge(fit.edge_width, crop.grid.side);
        Some((
            circle,
            rim.fit(&pixels, (RimShape::AsViewed, &shape), std::iter::empty())?,
        ))
    }
}

/// Whether a circle is rather the ball's than the best so far. What lies within a circle that is clear is a mark on it, however whole.
fn is_better(worth: f64, there: &FrameEstimate, best: f64, so_far: &FrameEstimate) -> bool {
    let (Some(new), Some(old)) = (there.circle, so_far.circle) else {
        return worth > best;
    };
    let within = |small: &BallCircle, large: &BallCircle| {
        let apart = (small.center.u - large.center.u).hypot(small.center.v - large.center.v);
        small.radius < MARK * large.radius && apart + small.radius < AROUND * large.radius
    };
    match (within(&old, &new), within(&new, &old)) {
        (true, _) => worth >= CLEAR,
        (_, true) => best < CLEAR && worth > best,
        _ => worth > best,
    }
}

/// How much of an outline is seen, 0 to 1.
fn completeness(fit: Option<&BallFit>) -> f64 {
    fit.map_or(BY_NET, |fit| fit.support * fit.visible.sqrt())
}
