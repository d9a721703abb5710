//! Where the ball is: the edges' circle where it is whole, else what the net for outlines makes of
//! it.
//!
//! Edges give a circle to a part of a pixel, but a shadow, a hand or a background of the ball's
//! brightness leads them astray. The net sees what is a ball and what is not, to about a hundredth of
//! the radius, and says how sure it is. Here the net judges every circle that the edges do not show
//! whole. Where the edges agree with it they give the last digits, and both are combined by their
//! inverse covariances. Where they do not, or the net is not sure of any outline, the edges' own circle
//! is another candidate, and the dots decide.

use nalgebra::{Matrix3, Vector3};

use super::Outline;
use super::config::OutlineMethod;
use crate::image::{GrayImage, ImageView};
use crate::vision::camera::{BallCircle, Pixel};
use crate::vision::circle::{BallFinder, BallFit, CircleConfig, NoBall, Polarity, WHOLE};
use crate::vision::net::outline::{NetOutline, OutlineNet, OutlineWorkspace};

/// A ball fills a crop, of up to so many pixels, from this radius on, in longer sides.
const FILLED: f64 = 0.38;
const CROP: usize = 320;
/// An outline that the net knows worse than this, in radii, is none.
const MAX_SIGMA: f64 = 0.06;
/// Edges farther from the net's outline than this many deviations are those of something else.
const AGREES: f64 = 3.0;
/// The net's systematic error, in radii.
const SYSTEMATIC: f64 = 0.006;
/// Edges that lie on fewer of the rays than this say nothing.
const MIN_SUPPORT: f64 = 0.4;
/// Outlines nearer than this to each other, in radii, are the same.
const SAME: f64 = 0.03;
/// Each circle of the edges is tried as the net sees it and as it is; then the crop's, and the rough one.
const TRIES: usize = 2 * BallFinder::MAX_OTHERS + 1;
/// Maximum number of outlines of a frame.
const MAX_CANDIDATES: usize = TRIES + 3;

/// What an outline may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    /// An ellipse where the edges show one.
    Free,
    /// The circle that was fitted.
    Circle,
}

/// An outline that may be the ball's.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub outline: Outline,
    /// The edges on it, where they show it.
    pub fit: Option<BallFit>,
    pub shape: Shape,
}

impl From<BallFit> for Candidate {
    fn from(fit: BallFit) -> Self {
        Self {
            outline: Outline::from(&fit),
            fit: Some(fit),
            shape: Shape::Free,
        }
    }
}

/// Finds the ball; keeps its memory from image to image.
#[derive(Debug)]
pub(super) struct Locator {
    finder: BallFinder,
    net: OutlineWorkspace,
    /// All that were given out.
    candidates: Vec<Candidate>,
    /// The edges' own outline, where the net contradicts it, and the circle in its place, where it is an ellipse.
    contested: [Option<Candidate>; 2],
    /// The circle that is tried after all others: that of a crop, or the rough one.
    last: BallCircle,
}

impl Locator {
    pub fn new(config: CircleConfig) -> Self {
        Self {
            finder: BallFinder::new(config),
            net: OutlineWorkspace::default(),
            candidates: Vec::with_capacity(MAX_CANDIDATES),
            contested: [None; 2],
            last: BallCircle::new(Pixel::default(), 0.0),
        }
    }

    /// The color contrast in which the last search looked for a ball, if it did.
    pub fn color_contrast(&self) -> Option<&GrayImage> {
        self.finder.color_contrast()
    }

    /// The likeliest outline; others follow by [`Locator::other`].
    pub fn find(
        &mut self,
        gray: &GrayImage,
        image: ImageView<'_>,
        net: Option<&OutlineNet>,
    ) -> Result<Candidate, NoBall> {
        self.last = inscribed(gray);
        // A crop that the ball fills has no room for another: where its edges show it whole, they are not searched for.
        let longer = gray.width().max(gray.height());
        let is_ball = |fit: &BallFit| is_whole(fit) && fit.circle.radius >= FILLED * longer as f64;
        let near = (longer <= CROP).then(|| self.finder.find_near(gray, None, &self.last));
        let found = match (near, image) {
            (Some(Ok(fit)), _) if is_ball(&fit) => Ok(fit),
            (_, ImageView::Color(color)) => self.finder.find_in_color(gray, color),
            (_, ImageView::Gray(_) | ImageView::Raw(_)) => self.finder.find(gray),
        };
        self.choose(gray, found, net)
    }

    /// The likeliest outline of a ball near a circle; others follow by [`Locator::other`].
    pub fn find_near(
        &mut self,
        gray: &GrayImage,
        image: ImageView<'_>,
        rough: &BallCircle,
        net: Option<&OutlineNet>,
    ) -> Result<Candidate, NoBall> {
        self.last = *rough;
        let color = match image {
            ImageView::Color(color) => Some(color),
            ImageView::Gray(_) | ImageView::Raw(_) => None,
        };
        let found = self.finder.find_near(gray, color, rough);
        self.choose(gray, found, net)
    }

    /// All outlines that are worth trying, the likeliest first.
    pub fn outlines(
        &mut self,
        gray: &GrayImage,
        image: ImageView<'_>,
        net: Option<&OutlineNet>,
        out: &mut Vec<BallCircle>,
    ) -> Result<(), NoBall> {
        out.reserve(MAX_CANDIDATES);
        let first = self.find(gray, image, net);
        out.extend(first.iter().map(|c| c.outline.circle));
        out.extend(std::iter::from_fn(|| self.contested()).map(|c| c.outline.circle));
        let mut start = 0;
        while let Some(candidate) = self.other(gray, net, &mut start) {
            out.push(candidate.outline.circle);
        }
        first.map(|_| ())
    }

    /// The first outline to try: the edges' where they show it whole, else the net's.
    fn choose(
        &mut self,
        gray: &GrayImage,
        found: Result<BallFit, NoBall>,
        net: Option<&OutlineNet>,
    ) -> Result<Candidate, NoBall> {
        self.candidates.clear();
        self.contested = [None; 2];
        if let Ok(fit) = found
            && fit.circle.is_ellipse()
        {
            let circle = self.finder.circle_at(&fit.circle);
            self.contested[1] = circle.map(|fit| Candidate {
                shape: Shape::Circle,
                ..Candidate::from(fit)
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
        let candidate = candidate.ok_or(match found {
            Err(why) => why,
            Ok(fit) => NoBall::NoCircle {
                support: fit.support,
            },
        })?;
        self.candidates.push(candidate);
        Ok(candidate)
    }

    /// The edges' own outline, where the net contradicts it or sees nothing, then the circle in the place of an ellipse: the
    /// dots tell whether it is the ball's.
    pub fn contested(&mut self) -> Option<Candidate> {
        let candidate = self.contested.iter_mut().find_map(Option::take)?;
        self.candidates.push(candidate);
        Some(candidate)
    }

    /// The next outline that is worth trying where those before show no dots that can be identified;
    /// `start` counts the circles that were looked at and moves on.
    pub fn other(
        &mut self,
        gray: &GrayImage,
        net: Option<&OutlineNet>,
        start: &mut usize,
    ) -> Option<Candidate> {
        while *start < TRIES {
            let (k, is_judged) = (*start / 2, start.is_multiple_of(2));
            *start += 1;
            // After all circles comes the one that a crop suggests.
            let fit = match k < BallFinder::MAX_OTHERS {
                true => self.finder.others().nth(k),
                false => None,
            };
            let candidate = match (fit, net) {
                (Some(fit), Some(net)) if is_judged => self.see(gray, &fit.circle, net),
                (Some(fit), _) => Some(fit.into()),
                (None, Some(net)) => {
                    *start = TRIES;
                    let last = self.last;
                    self.see(gray, &last, net)
                }
                (None, None) => None,
            };
            let is_new = |c: &Candidate| self.candidates.iter().all(|known| !is_same(known, c));
            if let Some(candidate) = candidate.filter(is_new) {
                self.candidates.push(candidate);
                return Some(candidate);
            }
        }
        None
    }

    /// What the net makes of a circle of the edges.
    fn judge(&mut self, gray: &GrayImage, fit: &BallFit, net: &OutlineNet) -> Option<Candidate> {
        let own = Candidate::from(*fit);
        let seen = self.see(gray, &fit.circle, net);
        if seen.is_none_or(|seen| !is_same(&own, &seen)) {
            self.contested[0] = Some(own);
        }
        seen
    }

    /// The net's outline near a circle, made precise by the edges that agree with it.
    fn see(&mut self, gray: &GrayImage, rough: &BallCircle, net: &OutlineNet) -> Option<Candidate> {
        let seen = net.find_near(gray, rough, &mut self.net)?;
        let radius = seen.circle.radius;
        let floor = Matrix3::from_diagonal_element((SYSTEMATIC * radius).powi(2));
        let covariance = seen.covariance + floor;
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
        let alone = Candidate {
            outline: Outline {
                circle: seen.circle,
                covariance,
            },
            fit: None,
            shape: Shape::Free,
        };
        Some(
            edges
                .and_then(|fit| combine(&seen, &covariance, &fit))
                .unwrap_or(alone),
        )
    }
}

/// The net's outline and that of edges which agree with it.
fn combine(seen: &NetOutline, covariance: &Matrix3<f64>, fit: &BallFit) -> Option<Candidate> {
    let vector = |c: &BallCircle| Vector3::new(c.center.u, c.center.v, c.radius);
    let (a, b) = (vector(&seen.circle), vector(&fit.circle));
    let between = (covariance + fit.covariance).try_inverse()?;
    let off = a - b;
    if off.dot(&(between * off)) > AGREES * AGREES {
        return None;
    }
    // Of edges that are not seen all around, as many as are missing may be another thing's.
    let doubt = (1.0 / fit.support).powi(4);
    let (of_net, of_edges) = (
        covariance.try_inverse()?,
        (fit.covariance * doubt).try_inverse()?,
    );
    let together = (of_net + of_edges).try_inverse()?;
    let mean = together * (of_net * a + of_edges * b);
    Some(Candidate {
        outline: Outline {
            circle: BallCircle::new(
                Pixel {
                    u: mean.x,
                    v: mean.y,
                },
                mean.z,
            ),
            covariance: together,
        },
        fit: Some(*fit),
        shape: Shape::Free,
    })
}

/// Whether the edges leave no doubt.
fn is_whole(fit: &BallFit) -> bool {
    fit.support >= WHOLE && fit.visible >= WHOLE && fit.polarity != Polarity::Mixed
}

fn is_same(a: &Candidate, b: &Candidate) -> bool {
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
    pub(super) fn net(self) -> crate::error::Result<Option<OutlineNet>> {
        match self {
            Self::Edges => Ok(None),
            Self::Net => OutlineNet::built_in().map(Some),
        }
    }
}
