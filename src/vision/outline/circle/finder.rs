//! The search for the circles of an image, and what of them is kept.

pub(crate) mod all;
mod kept;

use nalgebra::Vector3;

use self::kept::{score, sort_by_completeness};
use super::edges::Unrolled;
use super::vote::{self, Ballot, Center, Votes};
use super::{BallFit, CircleConfig, NoBall, Polarity};
use crate::image::{GrayImage, RgbImage};
use crate::vision::optics::camera::{BallCircle, Pixel};
use crate::vision::optics::grid::Grid;

/// Centers examined at each size and for each sign of the contrast: in crops, and in large images, where much
/// else has edges.
const CENTERS: (usize, usize) = (3, 16);
/// The smallest radius that is voted for where no larger ball is found, pixels, and the smallest of a ball there over the minimum
/// radius.
const SMALLEST: usize = 5;
const SMALLER: f64 = 0.625;
/// Images with a longer side beyond this, pixels, are large.
const LARGE: f64 = 320.0;
/// A complete outline of this support ends the search where smaller images are left for balls below this part of
/// its radius only.
const SETTLED: (f64, f64) = (0.7, 0.8);
/// An outline with this support of the edges, and this part of it in the image, is a ball's: it needs no judge, and no
/// others are looked for.
pub(crate) const WHOLE: f64 = 0.9;
/// The outline is fitted where the radius is at most this many pixels, which is fine enough: there a pixel is the mean of
/// several, and its noise less.
const FITTED_RADIUS: f64 = 44.0;

/// Circles that are tried as ellipses, at most.
const STRETCHED: usize = 12;

/// What the edges of a ball that is known roughly may be.
const NEAR_POLARITIES: [Polarity; 2] = [Polarity::Brighter, Polarity::Darker];

/// Finds balls; keeps its memory from image to image.
#[derive(Debug, Default)]
pub struct BallFinder {
    config: CircleConfig,
    /// Half size, quarter size, ...; the first `levels` of them are the present image's.
    halves: Vec<GrayImage>,
    levels: usize,
    /// What stands out in color, and whether the last search looked at it.
    contrast: GrayImage,
    has_contrast: bool,
    votes: Votes,
    /// Votes of either sign, of each size of the image in hand; none where a size was not voted on.
    ballots: Vec<Ballot>,
    centers: Vec<Center>,
    unrolled: Unrolled,
    found: Vec<BallFit>,
    /// The smallest radius of the search in hand, pixels.
    min_radius: f64,
}

/// The ball in an image; see [`BallFinder::find`].
///
/// # Errors
/// A [`NoBall`] that says why there is none.
pub fn find_ball(image: &GrayImage, config: &CircleConfig) -> Result<BallFit, NoBall> {
    BallFinder::new(*config).find(image)
}

impl BallFinder {
    /// Other circles that are worth trying, at most: see [`BallFinder::others`].
    pub const MAX_OTHERS: usize = 4;

    /// A finder with these settings.
    pub fn new(config: CircleConfig) -> Self {
        Self {
            min_radius: config.min_radius_px,
            config,
            ..Self::default()
        }
    }

    /// The ball in an image: the largest of the circles that are complete enough, where they are about as good.
    ///
    /// # Errors
    /// A [`NoBall`] that says why there is none.
    pub fn find(&mut self, image: &GrayImage) -> Result<BallFit, NoBall> {
        self.found.clear();
        self.has_contrast = false;
        self.min_radius = self.config.min_radius_px;
        self.search(image, false)
    }

    /// As [`BallFinder::find`], where a whole circle is no reason not to look for those that are brighter here and darker there: it may
    /// be a mark on the ball.
    ///
    /// # Errors
    /// A [`NoBall`] that says why there is none.
    pub(crate) fn find_of_any_sign(&mut self, image: &GrayImage) -> Result<BallFit, NoBall> {
        self.found.clear();
        self.has_contrast = false;
        self.min_radius = self.config.min_radius_px;
        self.search(image, true)
    }

    /// As [`BallFinder::find`] in the image's gray, and where that gives no complete outline, also in the color in which the ball differs most
    /// from what is behind it.
    ///
    /// # Errors
    /// A [`NoBall`] that says why there is none.
    pub fn find_in_color(&mut self, gray: &GrayImage, color: &RgbImage) -> Result<BallFit, NoBall> {
        // Before it is known whether it is needed: a later frame of this size finds its memory.
        self.contrast.reserve(gray.values().len());
        let in_gray = self.find(gray);
        if in_gray.is_ok_and(|b| b.support >= WHOLE && b.visible >= WHOLE) {
            return in_gray;
        }
        let mut contrast = std::mem::take(&mut self.contrast);
        self.has_contrast = color.to_contrast_into(&mut contrast);
        let found = if self.has_contrast {
            let in_color = self.search(&contrast, false);
            self.best().ok_or(()).or(in_color).or(in_gray)
        } else {
            in_gray
        };
        self.contrast = contrast;
        found
    }

    /// Fits the outline of a ball that is known roughly; circles of the last search stay. `None`
    /// where no circle fits.
    pub(crate) fn fit_near(
        &mut self,
        image: &GrayImage,
        rough: &BallCircle,
        polarity: Polarity,
    ) -> Option<BallFit> {
        self.halve(image, rough.radius);
        self.refine(image, rough, polarity)
    }

    /// The ellipse near a circle, where the edges show one beyond doubt: its eccentricity points along the longer axis, to
    /// either side.
    pub(crate) fn fit_ellipse_near(
        &mut self,
        image: &GrayImage,
        rough: &BallCircle,
        polarity: Polarity,
    ) -> Option<BallFit> {
        self.halve(image, rough.radius);
        self.refine_with(image, rough, |unrolled, image, start| {
            unrolled.fit_ellipse(image, start, polarity)
        })
    }

    /// The ball near a circle, whose edges may be of either sign; in gray, and where that does not show it whole, in the
    /// color that sets it off. [`BallFinder::others`] are its other circles.
    ///
    /// # Errors
    /// A [`NoBall`] that says why there is none.
    pub(crate) fn find_near(
        &mut self,
        gray: &GrayImage,
        color: Option<&RgbImage>,
        rough: &BallCircle,
    ) -> Result<BallFit, NoBall> {
        self.found.clear();
        self.found.reserve(2 * 2 * NEAR_POLARITIES.len());
        self.min_radius = self.config.min_radius_px;
        self.has_contrast = false;
        let mut support = self.fit_polarities(gray, rough);
        let is_whole = |b: &BallFit| b.support >= WHOLE && b.visible >= WHOLE;
        if self.best().is_none_or(|b| b.support < WHOLE) {
            self.stretch(gray);
        }
        if let Some(color) = color.filter(|_| !self.best().as_ref().is_some_and(is_whole)) {
            let mut contrast = std::mem::take(&mut self.contrast);
            contrast.reserve(gray.values().len());
            self.has_contrast = color.to_contrast_into(&mut contrast);
            if self.has_contrast {
                support = support.max(self.fit_polarities(&contrast, rough));
                self.stretch(&contrast);
            }
            self.contrast = contrast;
        }
        sort_by_completeness(&mut self.found);
        self.best().ok_or(NoBall::NoCircle { support })
    }

    /// Remembers the circles that fit near a rough one; the best support of any.
    fn fit_polarities(&mut self, image: &GrayImage, rough: &BallCircle) -> f64 {
        self.halve(image, rough.radius);
        let mut best = 0.0f64;
        for polarity in NEAR_POLARITIES {
            if let Some(fit) = self.refine(image, rough, polarity) {
                best = best.max(fit.support);
                if fit.visible >= self.config.min_visible {
                    self.remember(fit);
                }
            }
        }
        best
    }

    /// The color contrast in which the last search looked for a ball, if it did.
    pub(crate) fn color_contrast(&self) -> Option<&GrayImage> {
        self.has_contrast.then_some(&self.contrast)
    }

    /// Makes room for [`BallFinder::fit_near`] in images of so many pixels.
    pub(crate) fn reserve_near(&mut self, pixels: usize) {
        let mut left = pixels;
        while left > (vote::MIN * vote::MIN) {
            left /= 2;
            let mut half = GrayImage::default();
            half.reserve(left);
            self.halves.push(half);
        }
    }

    /// Adds an image's circles to those found, those of any sign also where another is whole; the best of all.
    fn search(&mut self, image: &GrayImage, of_any_sign: bool) -> Result<BallFit, NoBall> {
        let longer = image.width().max(image.height()) as f64;
        if image.width().min(image.height()) < self.config.min_radius_px as usize {
            return Err(NoBall::TooSmall {
                width: image.width(),
                height: image.height(),
            });
        }
        let most = self.config.max_radius * longer;
        self.halve(image, most);
        self.reserve(image);
        self.ballots.iter_mut().for_each(Ballot::clear);
        let mut support = self.vote(image, most, &[Polarity::Brighter, Polarity::Darker]);
        // Against a background of middling brightness, a ball in slanting light is brighter here and darker there.
        if of_any_sign || self.best().is_none_or(|b| b.support < WHOLE) {
            let either = self.vote(image, most, &[Polarity::Mixed]);
            support = match (support, either) {
                (Some(a), Some(b)) => Some(a.max(b)),
                (a, b) => a.or(b),
            };
        }
        if self.best().is_none_or(|b| b.support < WHOLE) {
            self.stretch(image);
        }
        sort_by_completeness(&mut self.found);
        self.best().ok_or(match support {
            Some(support) => NoBall::NoCircle { support },
            None => NoBall::NoContrast,
        })
    }

    /// Ellipses of the best circles that are not whole: balls off the optical axis. The circles stay.
    fn stretch(&mut self, image: &GrayImage) {
        self.found
            .sort_unstable_by(|a, b| score(b).total_cmp(&score(a)));
        self.found.reserve(STRETCHED);
        let mut tries = 0;
        for k in 0..self.found.len() {
            let BallFit {
                circle,
                polarity,
                support,
                ..
            } = self.found[k];
            if support >= WHOLE || tries == STRETCHED {
                continue;
            }
            tries += 1;
            let ellipse = self.refine_with(image, &circle, |unrolled, image, start| {
                unrolled.fit_ellipse(image, start, polarity)
            });
            self.found.extend(ellipse.filter(|e| e.support > support));
        }
    }

    /// Remembers all circles with edges of these polarities; gives the best support of any circle.
    fn vote(&mut self, image: &GrayImage, most: f64, polarities: &[Polarity]) -> Option<f64> {
        let longer = image.width().max(image.height()) as f64;
        let count = if longer > LARGE { CENTERS.1 } else { CENTERS.0 };
        let mut best_support: Option<f64> = None;
        // Large balls first: what is found spares the finer images.
        for level in (0..=self.levels).rev() {
            let largest = vote::MAX as f64 * (1u64 << level) as f64;
            let smallest = self.level(image, level);
            let side = smallest.width().min(smallest.height());
            if largest < self.config.min_radius_px || side < 3 {
                continue;
            }
            let settled =
                |f: &BallFit| f.support > SETTLED.0 && largest < SETTLED.1 * f.circle.radius;
            // In a large image a large circle may be anything.
            if longer <= LARGE && self.found.iter().any(settled) {
                break;
            }
            let halves = &self.halves;
            let small = level.checked_sub(1).map_or(image, |k| &halves[k]);
            let width = small.width();
            if polarities != [Polarity::Mixed] {
                self.votes.look(small, std::iter::empty());
            }
            for &polarity in polarities {
                let (votes, ballot) = (&mut self.votes, &mut self.ballots[level]);
                match polarity {
                    Polarity::Mixed => votes.take_up(ballot, width),
                    Polarity::Brighter | Polarity::Darker => {
                        votes.cast(vote::MIN..=vote::MAX, polarity.sign());
                        ballot.add(votes);
                    }
                }
                votes.strongest(count, &mut self.centers);
                for k in 0..self.centers.len() {
                    let center = self.centers[k];
                    let Some(fit) = self.fit(image, level, &center, polarity, most) else {
                        continue;
                    };
                    best_support = Some(best_support.unwrap_or(0.0).max(fit.support));
                    if fit.visible >= self.config.min_visible {
                        self.remember(fit);
                    }
                }
            }
        }
        best_support
    }

    /// Fills `halves` until a circle of the radius `most` is small enough for the votes.
    fn halve(&mut self, image: &GrayImage, most: f64) {
        let mut levels = 0;
        while ((vote::MAX as f64) * (1u64 << levels) as f64) < most {
            levels += 1;
        }
        self.levels = levels;
        if self.halves.len() < levels {
            self.halves.resize_with(levels, GrayImage::default);
        }
        for level in 0..levels {
            let (done, rest) = self.halves.split_at_mut(level);
            done.last().unwrap_or(image).halve_into(&mut rest[0]);
        }
    }

    /// Reserves capacity for whatever a search of an image of this size may meet.
    fn reserve(&mut self, image: &GrayImage) {
        self.votes.reserve(image.values().len());
        if self.ballots.len() <= self.levels {
            self.ballots.resize_with(self.levels + 1, Ballot::default);
        }
        for (level, ballot) in self.ballots.iter_mut().enumerate() {
            ballot.reserve(((image.width() >> level) + 1) * ((image.height() >> level) + 1));
        }
        // Every center of every size and polarity may give a circle, in gray and in color.
        let circles = 2 * 3 * CENTERS.1 * (self.levels + 1);
        let circles = circles.saturating_sub(self.found.len());
        self.found.reserve(circles);
        self.centers
            .reserve(CENTERS.1.saturating_sub(self.centers.len()));
    }

    fn level<'a>(&'a self, image: &'a GrayImage, level: usize) -> &'a GrayImage {
        level.checked_sub(1).map_or(image, |k| &self.halves[k])
    }

    /// The ball in an image where there is none from the minimum radius on: one down to [`SMALLER`] times that.
    ///
    /// # Errors
    /// A [`NoBall`] that says why there is none.
    pub(crate) fn find_small(&mut self, image: &GrayImage) -> Result<BallFit, NoBall> {
        self.found.clear();
        self.has_contrast = false;
        self.min_radius = SMALLER * self.config.min_radius_px;
        self.found.reserve(2 * CENTERS.1);
        let voted = SMALLEST..=vote::MIN;
        let mut support = 0.0f64;
        self.votes.look(image, std::iter::empty());
        for polarity in NEAR_POLARITIES {
            self.votes.cast(voted.clone(), polarity.sign());
            self.votes.strongest(CENTERS.1, &mut self.centers);
            for k in 0..self.centers.len() {
                let (center, sign) = (self.centers[k], polarity.sign());
                let rough = self.unrolled.radius(image, &center, voted.clone(), sign);
                let Some((radius, _)) = rough else {
                    continue;
                };
                let (u, v) = (center.u, center.v);
                let rough = BallCircle::new(Pixel { u, v }, radius);
                if let Some(fit) = self.refine(image, &rough, polarity) {
                    support = support.max(fit.support);
                    if fit.visible >= self.config.min_visible {
                        self.remember(fit);
                    }
                }
            }
        }
        sort_by_completeness(&mut self.found);
        self.best().ok_or(NoBall::NoCircle { support })
    }

    /// The circle around a center of a small image, fitted in a finer one; full-size pixels.
    fn fit(
        &mut self,
        image: &GrayImage,
        level: usize,
        center: &Center,
        polarity: Polarity,
        most: f64,
    ) -> Option<BallFit> {
        let halves = &self.halves;
        let small = level.checked_sub(1).map_or(image, |k| &halves[k]);
        let voted = vote::MIN..=vote::MAX;
        let (radius, _) = self
            .unrolled
            .radius(small, center, voted, polarity.sign())?;
        let scale = (1u64 << level) as f64;
        let shift = 0.5 * (scale - 1.0);
        let rough = BallCircle::new(
            Pixel {
                u: scale * center.u + shift,
                v: scale * center.v + shift,
            },
            scale * radius,
        );
        let fits = rough.radius >= self.config.min_radius_px && rough.radius <= most;
        if !fits {
            return None;
        }
        self.refine(image, &rough, polarity)
    }

    fn refine(
        &mut self,
        image: &GrayImage,
        rough: &BallCircle,
        polarity: Polarity,
    ) -> Option<BallFit> {
        self.refine_with(image, rough, |unrolled, image, start| {
            unrolled.fit(image, start, polarity)
        })
    }

    /// Fits near a circle (u, v, r) in the size that is fine enough.
    fn refine_with(
        &mut self,
        image: &GrayImage,
        rough: &BallCircle,
        fit: impl FnOnce(&mut Unrolled, &GrayImage, Vector3<f64>) -> Option<BallFit>,
    ) -> Option<BallFit> {
        let mut level = 0;
        while level < self.levels && rough.radius / (1u64 << level) as f64 > FITTED_RADIUS {
            level += 1;
        }
        let grid = Grid::halved(level as u32);
        let start = grid.circle_to_part(rough);
        let start = Vector3::new(start.center.u, start.center.v, start.radius);
        let small = level.checked_sub(1).map_or(image, |k| &self.halves[k]);
        let mut fit = fit(&mut self.unrolled, small, start)?;
        fit.circle = grid.circle_to_image(&fit.circle);
        fit.covariance *= grid.side * grid.side;
        fit.edge_width *= grid.side;
        Some(fit)
    }
}
