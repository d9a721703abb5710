//! Where the ball is: the edges' circle where it is whole, else what the net for outlines makes of
//! it.
//!
//! Edges give a circle to a part of a pixel, but a shadow, a hand or a background of the ball's
//! brightness leads them astray. The net sees what is a ball and what is not, to about a hundredth of
//! the radius, and says how sure it is. Here the net judges every circle that the edges do not show
//! whole. Where the edges agree with it they give the last digits, and both are combined by their
//! inverse covariances. Where they do not, or the net is not sure of any outline, the edges' own circle
//! is another candidate, and the dots decide.

use nalgebra::Vector3;

use super::circle::{BallFinder, BallFit, CircleConfig, NoBall, Polarity, WHOLE};
use super::net::{OutlineNet, OutlineWorkspace};
use super::place::Place;
use crate::image::{GrayImage, ImageView, RgbImage};
use crate::vision::frame::config::OutlineMethod;
use crate::vision::frame::outline::Outline;
use crate::vision::optics::camera::{BallCircle, Pixel};
use crate::vision::optics::crop::Crop;
use crate::vision::optics::grid::Grid;

/// A ball fills a crop, of up to so many pixels, from this radius on, in longer sides.
const FILLED: f64 = 0.38;
const CROP: usize = 320;
/// Balls below the minimum radius are looked for in crops of up to so many pixels: in large images too much else has small edges.
const SMALL_CROP: usize = 100;
/// An outline that the net knows worse than this, in radii, is none.
const MAX_SIGMA: f64 = 0.06;
/// Edges farther from the net's outline than this many deviations are those of something else.
const AGREES: f64 = 3.0;
/// Edges that lie on fewer of the rays than this say nothing.
const MIN_SUPPORT: f64 = 0.4;
/// Outlines nearer than this to each other, in radii, are the same.
const SAME: f64 = 0.03;
/// Each circle of the edges is tried as the net sees it and as it is; then the crop's, and the rough one.
const TRIES: usize = 2 * BallFinder::MAX_OTHERS + 1;
/// Maximum number of outlines of a place: the dots of each may ask for another.
const MAX_CANDIDATES: usize = 2 * (TRIES + 3);

/// What an outline may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum OutlineShape {
    /// An ellipse where the edges show one.
    Free,
    /// The circle that was fitted.
    Circle,
    /// What the dots of another outline ask for.
    ByDots,
}

/// An outline that may be the ball's.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OutlineCandidate {
    pub outline: Outline,
    /// The edges on it, where they show it.
    pub fit: Option<BallFit>,
    pub shape: OutlineShape,
}

impl OutlineCandidate {
    /// An outline of the frame's pixels, as it is.
    pub fn given(outline: &Outline, grid: &Grid) -> Self {
        Self {
            outline: Outline {
                circle: grid.circle_to_part(&outline.circle),
                covariance: outline.covariance / (grid.side * grid.side),
                ..*outline
            },
            fit: None,
            shape: OutlineShape::Free,
        }
    }
}

impl From<BallFit> for OutlineCandidate {
    fn from(fit: BallFit) -> Self {
        Self {
            outline: Outline::from(&fit),
            fit: Some(fit),
            shape: OutlineShape::Free,
        }
    }
}

/// Finds the ball's outline at a place, and others that it may be; keeps its memory from image to image.
#[derive(Debug)]
pub(crate) struct Locator {
    finder: BallFinder,
    net: OutlineWorkspace,
    /// All that were given out.
    candidates: Vec<OutlineCandidate>,
    /// Those that come next whatever the dots show: the likeliest, or another in the place of the last one; the edges' own
    /// outline, where the net contradicts it; the circle, where that is an ellipse; one more in the place of the last.
    waiting: [Option<OutlineCandidate>; 4],
    /// Circles of the edges that were looked at, once as the net sees them and once as they are.
    tried: usize,
    /// The circle that is tried after all others: that of a crop, or the rough one.
    last: BallCircle,
}

impl Locator {
    pub fn new(config: CircleConfig) -> Self {
        Self {
            finder: BallFinder::new(config),
            net: OutlineWorkspace::default(),
            candidates: Vec::with_capacity(MAX_CANDIDATES),
            waiting: [None; 4],
            tried: 0,
            last: BallCircle::new(Pixel::default(), 0.0),
        }
    }

    /// The color contrast in which the last search looked for a ball, if it did.
    pub fn color_contrast(&self) -> Option<&GrayImage> {
        self.finder.color_contrast()
    }

    /// Looks for outlines at a place in a crop of the frame: [`Locator::next`] has them.
    pub fn begin(
        &mut self,
        crop: &Crop<'_>,
        place: &Place,
        net: Option<&OutlineNet>,
    ) -> Result<(), NoBall> {
        self.candidates.clear();
        self.waiting = [None; 4];
        self.tried = 0;
        let gray = crop.gray;
        let color = match crop.image {
            ImageView::Color(color) => Some(color),
            ImageView::Gray(_) | ImageView::Raw(_) => None,
        };
        let found = match place {
            Place::Known(outline) => {
                self.waiting[0] = Some(OutlineCandidate::given(outline, &crop.grid));
                self.tried = TRIES;
                return Ok(());
            }
            Place::Near(circle) => {
                self.last = crop.grid.circle_to_part(circle);
                self.finder.find_near(gray, color, &self.last)
            }
            Place::Within(_) => {
                self.last = inscribed(gray);
                self.find(gray, color)
            }
        };
        self.waiting[0] = Some(self.choose(gray, found, net)?);
        Ok(())
    }

    /// In a small crop where there is no outline, that of a ball below the minimum radius.
    pub fn smaller(&mut self, gray: &GrayImage) -> Option<OutlineCandidate> {
        let is_small = gray.width().max(gray.height()) <= SMALL_CROP;
        let fit = is_small.then(|| self.finder.find_small(gray).ok())?;
        fit.map(OutlineCandidate::from)
    }

    /// The edges' outline of a ball anywhere.
    fn find(&mut self, gray: &GrayImage, color: Option<&RgbImage>) -> Result<BallFit, NoBall> {
        // A crop that the ball fills has no room for another: where its edges show it whole, they are not searched for.
        let longer = gray.width().max(gray.height());
        let is_ball = |fit: &BallFit| is_whole(fit) && fit.circle.radius >= FILLED * longer as f64;
        let near = (longer <= CROP).then(|| self.finder.find_near(gray, None, &self.last));
        match (near, color) {
            (Some(Ok(fit)), _) if is_ball(&fit) => Ok(fit),
            (_, Some(color)) => self.finder.find_in_color(gray, color),
            (_, None) => self.finder.find(gray),
        }
    }

    /// The first outline to try: the edges' where they show it whole, else the net's.
    fn choose(
        &mut self,
        gray: &GrayImage,
        found: Result<BallFit, NoBall>,
        net: Option<&OutlineNet>,
    ) -> Result<OutlineCandidate, NoBall> {
        if let Ok(fit) = found
            && fit.circle.is_ellipse()
        {
            let circle = self.finder.circle_at(&fit.circle);
            self.waiting[2] = circle.map(|fit| OutlineCandidate {
                shape: OutlineShape::Circle,
                ..OutlineCandidate::from(fit)
            });
        }
        let candidate = match (found, net) {
            (Ok(fit), Some(net)) if !is_whole(&fit) => self.judge(gray, &fit, net),
            (Ok(fit), _) => Some(fit.into()),
            (Err(_), _) => None,
        };
        // A crop shows the ball in its middle.
        let last = self.last;
        let candidate = candidate.or_else(|| self.see(gray, &last, net?));
        candidate.ok_or(match found {
            Err(why) => why,
            Ok(fit) => NoBall::NoCircle {
                support: fit.support,
            },
        })
    }

    /// Another outline in the place of the last one: the circle of an ellipse, or what the dots ask for. It comes next, or after those that
    /// wait already.
    pub fn add(&mut self, other: OutlineCandidate) {
        if let Some(free) = self.waiting.iter_mut().find(|place| place.is_none()) {
            *free = Some(other);
        }
    }

    /// The next outline to try. Those that are worth it only where all before show no dots that can be identified come
    /// where `is_open`.
    pub fn next(
        &mut self,
        gray: &GrayImage,
        net: Option<&OutlineNet>,
        is_open: bool,
    ) -> Option<OutlineCandidate> {
        let waiting = self.waiting.iter_mut().find_map(Option::take);
        let candidate = match waiting {
            None if is_open => self.other(gray, net),
            waiting => waiting,
        };
        self.candidates.extend(candidate);
        candidate
    }

    /// One of the other circles of the edges, as the net sees it or as it is; after all circles the one that a crop suggests.
    fn other(&mut self, gray: &GrayImage, net: Option<&OutlineNet>) -> Option<OutlineCandidate> {
        while self.tried < TRIES {
            let (k, is_judged) = (self.tried / 2, self.tried.is_multiple_of(2));
            self.tried += 1;
            let fit = match k < BallFinder::MAX_OTHERS {
                true => self.finder.others().nth(k),
                false => None,
            };
            let candidate = match (fit, net) {
                (Some(fit), Some(net)) if is_judged => self.see(gray, &fit.circle, net),
                (Some(fit), _) => Some(fit.into()),
                (None, Some(net)) => {
                    self.tried = TRIES;
                    let last = self.last;
                    self.see(gray, &last, net)
                }
                (None, None) => None,
            };
            let is_new =
                |c: &OutlineCandidate| self.candidates.iter().all(|known| !is_same(known, c));
            if let Some(candidate) = candidate.filter(is_new) {
                return Some(candidate);
            }
        }
        None
    }

    /// What the net makes of a circle of the edges.
    fn judge(
        &mut self,
        gray: &GrayImage,
        fit: &BallFit,
        net: &OutlineNet,
    ) -> Option<OutlineCandidate> {
        let own = OutlineCandidate::from(*fit);
        let seen = self.see(gray, &fit.circle, net);
        if seen.is_none_or(|seen| !is_same(&own, &seen)) {
            self.waiting[1] = Some(own);
        }
        seen
    }

    /// The net's outline near a circle, made precise by the edges that agree with it.
    fn see(
        &mut self,
        gray: &GrayImage,
        rough: &BallCircle,
        net: &OutlineNet,
    ) -> Option<OutlineCandidate> {
        let seen = net.find_near(gray, rough, &mut self.net)?;
        let radius = seen.circle.radius;
        let sigma = seen.covariance.diagonal().max().sqrt();
        let is_sure = sigma < MAX_SIGMA * radius;
        if !is_sure {
            return None;
        }
        let edges = [Polarity::Brighter, Polarity::Darker]
            .into_iter()
            .filter_map(|p| self.finder.fit_near(gray, &seen.circle, p))
            .filter(|fit| fit.support >= MIN_SUPPORT)
            .max_by(|a, b| a.support.total_cmp(&b.support));
        let combined = edges.and_then(|fit| Some((combine(&seen, &fit)?, fit)));
        Some(OutlineCandidate {
            outline: combined.map_or(seen, |(outline, _)| outline),
            fit: combined.map(|(_, fit)| fit),
            shape: OutlineShape::Free,
        })
    }
}

/// The net's outline and that of edges which agree with it.
fn combine(seen: &Outline, fit: &BallFit) -> Option<Outline> {
    let vector = |c: &BallCircle| Vector3::new(c.center.u, c.center.v, c.radius);
    let (a, b) = (vector(&seen.circle), vector(&fit.circle));
    let between = (seen.covariance + fit.covariance).try_inverse()?;
    let off = a - b;
    if off.dot(&(between * off)) > AGREES * AGREES {
        return None;
    }
    // Of edges that are not seen all around, as many as are missing may be another thing's.
    let doubt = (1.0 / fit.support).powi(4);
    let (of_net, of_edges) = (
        seen.covariance.try_inverse()?,
        (fit.covariance * doubt).try_inverse()?,
    );
    let covariance = (of_net + of_edges).try_inverse()?;
    let mean = covariance * (of_net * a + of_edges * b);
    let center = Pixel {
        u: mean.x,
        v: mean.y,
    };
    Some(Outline {
        circle: BallCircle::new(center, mean.z),
        covariance,
        ..*seen
    })
}

/// Whether the edges leave no doubt.
fn is_whole(fit: &BallFit) -> bool {
    fit.support >= WHOLE && fit.visible >= WHOLE && fit.polarity != Polarity::Mixed
}

fn is_same(a: &OutlineCandidate, b: &OutlineCandidate) -> bool {
    let (a, b) = (&a.outline.circle, &b.outline.circle);
    let apart = (a.center.u - b.center.u).hypot(a.center.v - b.center.v);
    apart.max((a.radius - b.radius).abs()) < SAME * a.radius
}

/// The circle in the middle of an image that fills most of it.
fn inscribed(image: &GrayImage) -> BallCircle {
    let (width, height) = (image.width() as f64, image.height() as f64);
    BallCircle::new(
        Pixel {
            u: 0.5 * (width - 1.0),
            v: 0.5 * (height - 1.0),
        },
        0.4 * width.min(height),
    )
}

impl OutlineMethod {
    /// The net, where the method uses it.
    ///
    /// # Errors
    /// [`crate::Error::Internal`] where this crate was built with damaged weights.
    pub(crate) fn net(self) -> crate::error::Result<Option<OutlineNet>> {
        match self {
            Self::Edges => Ok(None),
            Self::Net => OutlineNet::built_in().map(Some),
        }
    }
}
