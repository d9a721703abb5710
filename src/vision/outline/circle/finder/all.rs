//! All circles of an image that balls may have: also those that overlap, touch or are cut.
//!
//! Edges vote as for one ball ([`super::BallFinder::find`]), at each size at which radii within the bounds are voted for: first all, then
//! those that are not about the rim of a circle that was found, so that what it outshone has its turn. Circles of which one lies
//! within another, as dots and logos do, are left out.

use super::{BallFinder, WHOLE, score, sort_by_completeness};
use crate::image::GrayImage;
use crate::vision::optics::camera::{BallCircle, Pixel};
use crate::vision::optics::grid::Grid;
use crate::vision::outline::circle::{BallFit, Polarity, vote};

/// Centers examined at each size and for each sign of the contrast.
const CENTERS: usize = 12;
/// Minimum share of the rays with an edge: less than for a single ball, since other balls hide a part of the rim. Dots decide.
const MIN_SUPPORT: f64 = 0.45;
/// Rims of this support do not vote again.
const OUTSHINES: f64 = 0.55;
/// Circles nearer to each other than this, in radii of the larger one, are at one place: images of a ball that share 60 % of their
/// diameter are 0.8 apart.
const ONE_PLACE: f64 = 0.4;
/// A circle that reaches less than this part of its radius beyond another lies within it.
const BEYOND: f64 = 0.35;

impl BallFinder {
    /// The circles with radii within these bounds, pixels, the best first; `known` ones, which are not among them, do not vote. What is
    /// outshone is looked for among edges of the given polarity alone.
    pub(crate) fn find_all(
        &mut self,
        image: &GrayImage,
        radii: (f64, f64),
        polarity: Polarity,
        known: &[BallCircle],
    ) -> &[BallFit] {
        self.found.clear();
        self.has_contrast = false;
        self.min_radius = self.config.min_radius_px.max(radii.0);
        self.halve(image, radii.1);
        self.reserve(image);
        let passes = [
            (polarity, false),
            (polarity, true),
            (polarity.opposite(), false),
        ];
        for (polarity, beyond) in passes {
            for level in (0..=self.levels).rev() {
                self.vote_all(image, level, radii, polarity, known, beyond);
            }
        }
        // Balls off the axis.
        self.stretch(image);
        let is_new = |f: &BallFit| !known.iter().any(|k| is_one_place(k, &f.circle));
        self.found
            .retain(|f| f.support >= MIN_SUPPORT && f.contrast.abs() > 0.0 && is_new(f));
        sort_by_completeness(&mut self.found);
        self.found.sort_by(|a, b| score(b).total_cmp(&score(a)));
        // Of two at one place, and of one within another, the better stays.
        let mut kept = 0;
        for k in 0..self.found.len() {
            let fit = self.found[k];
            let clashes = |other: &BallFit| {
                is_one_place(&other.circle, &fit.circle) || is_within(&fit, other)
            };
            if !self.found[..kept].iter().any(clashes) {
                self.found[kept] = fit;
                kept += 1;
            }
        }
        self.found.truncate(kept);
        &self.found
    }

    /// Remembers the circles of one size; those beyond what outshines them without the edges about the rims of these.
    fn vote_all(
        &mut self,
        image: &GrayImage,
        level: usize,
        radii: (f64, f64),
        polarity: Polarity,
        known: &[BallCircle],
        beyond: bool,
    ) {
        let scale = (1u64 << level) as f64;
        let (smallest, largest) = (vote::MIN as f64 * scale, vote::MAX as f64 * scale);
        let small = self.level(image, level);
        if largest < radii.0 || smallest > radii.1 || small.width().min(small.height()) < vote::MIN
        {
            return;
        }
        let grid = Grid::halved(level as u32);
        let found = self.found.iter();
        let outshining = found
            .filter(|f| beyond && f.support >= OUTSHINES)
            .map(|f| f.circle);
        let rims = known.iter().copied().chain(outshining);
        let halves = &self.halves;
        let small = level.checked_sub(1).map_or(image, |k| &halves[k]);
        self.votes
            .look(small, rims.map(|circle| grid.circle_to_part(&circle)));
        self.votes.cast(vote::MIN..=vote::MAX, polarity.sign());
        self.votes.strongest(CENTERS, &mut self.centers);
        for k in 0..self.centers.len() {
            let center = self.centers[k];
            let (u, v) = (center.u, center.v);
            let place = grid.pixel_to_image(Pixel { u, v });
            if self.is_taken(place, (0.8 * smallest, 1.2 * largest), known) {
                continue;
            }
            let halves = &self.halves;
            let small = level.checked_sub(1).map_or(image, |k| &halves[k]);
            let voted = vote::MIN..=vote::MAX;
            let rough = self.unrolled.radius(small, &center, voted, polarity.sign());
            let Some((radius, _)) = rough.filter(|(_, worth)| *worth >= MIN_SUPPORT) else {
                continue;
            };
            let rough = grid.circle_to_image(&BallCircle::new(Pixel { u, v }, radius));
            let outside = rough.radius < 0.9 * radii.0 || rough.radius > 1.1 * radii.1;
            if outside {
                continue;
            }
            let fit = self.refine(image, &rough, polarity);
            let fits = |f: &BallFit| {
                let radius = f.circle.radius;
                radius >= radii.0 && radius <= radii.1 && f.support >= MIN_SUPPORT
            };
            if let Some(fit) = fit.filter(fits)
                && fit.visible >= self.config.min_visible
            {
                self.remember(fit);
            }
        }
    }

    /// Whether the center of a ball that is known, or of a whole one that was found, with a radius of these is at a place.
    fn is_taken(&self, place: Pixel, radii: (f64, f64), known: &[BallCircle]) -> bool {
        let is_there = |circle: &BallCircle| {
            let apart = (circle.center.u - place.u).hypot(circle.center.v - place.v);
            apart < ONE_PLACE * circle.radius && (radii.0..radii.1).contains(&circle.radius)
        };
        let whole = self.found.iter().filter(|f| f.support >= WHOLE);
        known.iter().any(is_there) || whole.map(|f| &f.circle).any(is_there)
    }
}

/// Whether two circles are too near to each other for two images of balls.
pub(crate) fn is_one_place(a: &BallCircle, b: &BallCircle) -> bool {
    let apart = (a.center.u - b.center.u).hypot(a.center.v - b.center.v);
    apart < ONE_PLACE * a.radius.max(b.radius)
}

/// Whether a circle lies within another.
fn is_within(inner: &BallFit, outer: &BallFit) -> bool {
    let (a, b) = (&inner.circle, &outer.circle);
    let apart = (a.center.u - b.center.u).hypot(a.center.v - b.center.v);
    apart + (1.0 - BEYOND) * a.radius < b.radius
}
