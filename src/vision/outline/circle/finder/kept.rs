//! The circles of a search: each once, and the best that may be a ball.

use super::{BallFinder, FITTED_RADIUS};
use crate::vision::optics::camera::BallCircle;
use crate::vision::outline::circle::{BallFit, Polarity};

/// A circle whose center is nearer to an ellipse's than this part of its shorter half axis is in the same place.
const SAME_PLACE: f64 = 0.3;
/// More support asked for where the whole circle lies outside the image; in proportion for parts.
const HIDDEN: f64 = 0.2;
/// Minimum width of an edge, pixels of the image in which it is fitted: the smoothing alone makes it 2.
const MIN_WIDTH: f64 = 1.2;

impl BallFinder {
    /// Other circles of the last search, the best first: what the ball may be where the one found shows no dots that can be identified.
    pub fn others(&self) -> impl Iterator<Item = BallFit> + '_ {
        let best = self.best();
        let tried = self.found.iter().take(Self::MAX_OTHERS + 1);
        tried
            .filter(move |f| best.is_none_or(|b| b.circle != f.circle))
            .take(Self::MAX_OTHERS)
            .copied()
    }

    /// The most complete circle in the place of an ellipse.
    pub(crate) fn circle_at(&self, ellipse: &BallCircle) -> Option<BallFit> {
        let is_there = |f: &&BallFit| {
            let (a, b) = (f.circle.center, ellipse.center);
            let apart = (a.u - b.u).hypot(a.v - b.v);
            !f.circle.is_ellipse() && apart < SAME_PLACE * ellipse.radius
        };
        self.found.iter().find(is_there).copied()
    }

    pub(super) fn is_ball(&self, fit: &BallFit) -> bool {
        let c = &self.config;
        // Of less there is less to be lucky with.
        let support = c.min_support + HIDDEN * (1.0 - fit.visible);
        // Noise has slopes without a step.
        let finest = (fit.circle.radius / FITTED_RADIUS).max(1.0);
        fit.polarity != Polarity::Mixed
            && fit.support >= support
            && fit.edge_width >= MIN_WIDTH * finest
            && fit.visible >= c.min_visible
            && fit.contrast.abs() >= c.min_contrast
            && fit.circle.radius >= self.min_radius
    }

    /// Keeps a circle, once.
    pub(super) fn remember(&mut self, fit: BallFit) {
        let same = |other: &BallFit| {
            let (a, b) = (&other.circle, &fit.circle);
            let apart = (a.center.u - b.center.u).hypot(a.center.v - b.center.v);
            let mixed = [other, &fit].map(|f| f.polarity == Polarity::Mixed);
            mixed[0] == mixed[1]
                && apart < 0.2 * a.radius.min(b.radius)
                && (a.radius / b.radius).ln().abs() < 0.2
        };
        match self.found.iter_mut().find(|other| same(other)) {
            Some(known) if score(known) < score(&fit) => *known = fit,
            Some(_) => {}
            None => self.found.push(fit),
        }
    }

    /// The best circle, and how many others beside it are nearly as good.
    pub(super) fn best(&self) -> Option<BallFit> {
        let balls = || self.found.iter().filter(|f| self.is_ball(f));
        let mut best = *balls().max_by(|a, b| score(a).total_cmp(&score(b)))?;
        let least = self.config.rival_score * score(&best);
        let beside = |other: &&BallFit| {
            let (a, b) = (&other.circle, &best.circle);
            let apart = (a.center.u - b.center.u).hypot(a.center.v - b.center.v);
            // Of a like size and not within the best: dots and logos have outlines too.
            apart > 0.8 * b.radius && a.radius > 0.5 * b.radius && score(other) > least
        };
        best.rivals = balls().filter(beside).count();
        Some(best)
    }
}

/// A circle's worth: complete outlines first, then clear ones, then large ones. Dots and logos are smaller and fainter than
/// the ball that bears them.
pub(super) fn score(fit: &BallFit) -> f64 {
    completeness(fit) * (fit.contrast.abs() * fit.circle.radius).sqrt()
}

/// Sorts circles, the most complete first; equal ones keep their order. Insertion needs no memory, which a
/// library's stable sort would, and the circles are few.
pub(super) fn sort_by_completeness(found: &mut [BallFit]) {
    for i in 1..found.len() {
        let this = completeness(&found[i]);
        let at = found[..i].partition_point(|f| completeness(f) >= this);
        found[at..=i].rotate_right(1);
    }
}

/// How much of a circle is there to be seen.
fn completeness(fit: &BallFit) -> f64 {
    fit.support.powi(4) * fit.visible.powi(2)
}
