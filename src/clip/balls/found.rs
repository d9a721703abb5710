//! The balls of a frame as they are found, no two at one place.

use super::{BallEstimate, MIN_LIKELY_DOTS, RIM};
use crate::vision::estimator::search::is_evident;
use crate::vision::optics::camera::BallCircle;
use crate::vision::outline::circle::{BallFit, WHOLE, is_one_place};

/// What was found so far.
pub(crate) struct FoundBalls {
    /// Balls with a pose.
    pub balls: Vec<BallEstimate>,
    /// Those without.
    pub rejected: Vec<BallEstimate>,
    /// How many there are at most.
    pub limit: usize,
}

impl FoundBalls {
    pub fn is_full(&self) -> bool {
        self.balls.len() >= self.limit
    }

    /// Whether no ball with a pose is at a place.
    pub fn is_free(&self, circle: &BallCircle) -> bool {
        let there = |b: &BallEstimate| b.circle().is_some_and(|c| is_one_place(&c, circle));
        !self.balls.iter().any(there)
    }

    /// Takes a ball up, where it is one; a circle without a pose by its rim and dots, or by its rim alone.
    pub fn add(&mut self, ball: BallEstimate, fit: Option<&BallFit>, by_rim: bool) {
        let Some(circle) = ball.circle().filter(|c| self.is_free(c)) else {
            return;
        };
        let rim = fit.map_or(0.0, |f| f.support.min(f.visible));
        let is_pose = ball.frame.pose().is_some() && (rim >= RIM || is_evident(&ball.frame));
        if is_pose {
            let moved = |b: &BallEstimate| b.circle().is_none_or(|c| !is_one_place(&c, &circle));
            self.rejected.retain(moved);
            self.balls.push(ball);
            return;
        }
        let has_dots = ball.likely_dots() >= MIN_LIKELY_DOTS;
        let is_ball = rim >= WHOLE || (rim >= RIM && (by_rim || has_dots));
        let there = |b: &BallEstimate| b.circle().is_some_and(|c| is_one_place(&c, &circle));
        if is_ball && !self.rejected.iter().any(there) {
            self.rejected.push(ball);
        }
    }

    /// The balls with a pose, then those without.
    pub fn all(mut self) -> Vec<BallEstimate> {
        let left = self.limit.saturating_sub(self.balls.len());
        let nothing = self.balls.is_empty();
        for mut ball in self.rejected.into_iter().take(left) {
            ball.frame.reject_pose();
            let has_outline = ball.frame.outline.is_some();
            if has_outline || (nothing && self.balls.is_empty()) {
                self.balls.push(ball);
            }
        }
        self.balls
    }
}

/// The place of the largest.
pub(crate) fn largest(shares: &[f64]) -> usize {
    let all = shares.iter().enumerate();
    all.max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(k, _)| k)
}

/// Shares in proportion to the exponentials.
pub(crate) fn shares(ln_weights: &[f64]) -> Vec<f64> {
    let most = ln_weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = ln_weights.iter().map(|w| (w - most).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}
