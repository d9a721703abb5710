//! Where the ball is expected by its outlines in other frames.
//!
//! Center and radius of a ball follow a smooth path. *Within* a sequence ([`expected_outline`]) it is a parabola over a few frames (a
//! straight line for the radius, and where frames are few), fitted to the outlines of the nearest frames in time by iteratively
//! reweighted least squares with Tukey's biweight. *Ahead* of the last frame ([`OutlineMotion`]) it is straight, by the last two
//! outlines: a longer memory would lag behind a ball that falls.
//!
//! An expectation says where to look, and is no measurement. Not guaranteed: anything where the path bends between two
//! frames, as at a bounce.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};

use crate::stats::biweight;
use crate::vision::optics::camera::{BallCircle, Pixel};

/// Outlines that make a path.
pub(crate) const NEIGHBORS: usize = 8;
/// Minimum number of them; from the second on, the path may bend.
const MIN_NEIGHBORS: (usize, usize) = (3, 5);
/// Beyond the outermost of them the path is followed for so many of their mean steps.
const BEYOND: f64 = 2.5;
/// Outlines that scatter about the path by more than this, in radii, make none.
pub(crate) const MAX_SCATTER: f64 = 0.15;
/// Reweighted fits, and the biweight's reach in median deviations.
const ROUNDS: usize = 6;
const REACH: f64 = 7.0;
/// Outlines that are remembered.
const SEEN: usize = 2;
/// The radius changes by at most this part from the last outline to the predicted one.
const MAX_GROWTH: f64 = 0.15;

/// The outline at time 0 by those of other times; `None` where they make no path, or it ends before.
pub(crate) fn expected_outline(around: &[(f64, BallCircle)]) -> Option<BallCircle> {
    if around.len() < MIN_NEIGHBORS.0 {
        return None;
    }
    let ends = |f: fn(f64, f64) -> f64, start| around.iter().map(|a| a.0).fold(start, f);
    let (first, last) = (
        ends(f64::min, f64::INFINITY),
        ends(f64::max, f64::NEG_INFINITY),
    );
    let step = (last - first) / (around.len() - 1) as f64;
    if step.is_nan() || step <= 0.0 || first > BEYOND * step || last < -BEYOND * step {
        return None;
    }
    let values = |f: fn(&BallCircle) -> f64| -> Vec<(f64, f64)> {
        around.iter().map(|(t, c)| (t / step, f(c))).collect()
    };
    let is_curved = around.len() >= MIN_NEIGHBORS.1;
    let u = at_zero(&values(|c| c.center.u), is_curved)?;
    let v = at_zero(&values(|c| c.center.v), is_curved)?;
    let radius = at_zero(&values(|c| c.radius), false)?;
    let scatter = u.scatter.hypot(v.scatter).max(radius.scatter);
    let is_smooth = radius.value > 0.0 && scatter <= MAX_SCATTER * radius.value;
    is_smooth.then_some(BallCircle::new(
        Pixel {
            u: u.value,
            v: v.value,
        },
        radius.value,
    ))
}

/// A polynomial's value at 0, and the median deviation of what it was fitted to.
struct Smooth {
    value: f64,
    scatter: f64,
}

/// Fits a line or a parabola to `(t, y)`.
fn at_zero(points: &[(f64, f64)], is_curved: bool) -> Option<Smooth> {
    let mut weights = vec![1.0; points.len()];
    let mut deviations = Vec::with_capacity(points.len());
    let mut fitted = None;
    for _ in 0..ROUNDS {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for ((t, y), weight) in points.iter().zip(&weights) {
            let row = Vector3::new(1.0, *t, if is_curved { t * t } else { 0.0 });
            normal += row * row.transpose() * *weight;
            right += row * (*weight * y);
        }
        if !is_curved {
            normal[(2, 2)] = 1.0;
        }
        let found = normal.cholesky()?.solve(&right);
        let residual = |(t, y): &(f64, f64)| y - found.x - found.y * t - found.z * t * t;
        deviations.clear();
        deviations.extend(points.iter().map(|p| residual(p).abs()));
        deviations.sort_unstable_by(f64::total_cmp);
        let median = deviations[deviations.len() / 2];
        // Outlines are never known better than to a tenth of a pixel.
        let reach = REACH * median.max(0.1);
        for (point, weight) in points.iter().zip(&mut weights) {
            *weight = biweight(residual(point) / reach);
        }
        fitted = Some(Smooth {
            value: found.x,
            scatter: median,
        });
    }
    fitted
}

/// The larger of the center's and the radius' difference, in radii.
pub(crate) fn off(a: &BallCircle, b: &BallCircle) -> f64 {
    let apart = (a.center.u - b.center.u).hypot(a.center.v - b.center.v);
    apart.max((a.radius - b.radius).abs()) / b.radius
}

/// The straight path of a ball's outline, up to the last frame.
#[derive(Debug, Clone)]
pub(crate) struct OutlineMotion {
    seen: VecDeque<(f64, BallCircle)>,
}

impl Default for OutlineMotion {
    fn default() -> Self {
        Self {
            seen: VecDeque::with_capacity(SEEN + 1),
        }
    }
}

impl OutlineMotion {
    /// Nothing is known.
    pub fn clear(&mut self) {
        self.seen.clear();
    }

    /// Forgets outlines from before a time.
    pub fn forget(&mut self, oldest_s: f64) {
        while self.seen.front().is_some_and(|s| s.0 < oldest_s) {
            self.seen.pop_front();
        }
    }

    /// The outline at a time, later than all before.
    pub fn push(&mut self, time_s: f64, circle: BallCircle) {
        if self.seen.len() == SEEN {
            self.seen.pop_front();
        }
        self.seen.push_back((time_s, circle));
    }

    /// The outline as expected at a time.
    pub fn predict(&self, time_s: f64) -> Option<BallCircle> {
        let (last_s, last) = *self.seen.back()?;
        let &(first_s, first) = self.seen.front()?;
        if last_s <= first_s {
            return Some(last);
        }
        let steps = (time_s - last_s) / (last_s - first_s);
        let ahead = |from: f64, to: f64| to + steps * (to - from);
        let radius = ahead(first.radius, last.radius);
        let (min, max) = (1.0 - MAX_GROWTH, 1.0 + MAX_GROWTH);
        Some(BallCircle::new(
            Pixel {
                u: ahead(first.center.u, last.center.u),
                v: ahead(first.center.v, last.center.v),
            },
            radius.clamp(min * last.radius, max * last.radius),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outline(t: f64) -> BallCircle {
        BallCircle::new(
            Pixel {
                u: 100.0 + 40.0 * t,
                v: 300.0 - 20.0 * t + 3.0 * t * t,
            },
            30.0 + 0.2 * t,
        )
    }

    #[test]
    fn the_path_is_that_of_a_falling_ball_and_leaves_out_what_is_off_it() {
        let times = [-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0];
        let mut around: Vec<_> = times.iter().map(|t| (*t, outline(*t))).collect();
        let expected = expected_outline(&around).expect("a path");
        assert!(off(&expected, &outline(0.0)) < 1e-9, "{expected:?}");
        around[5].1.center.u += 150.0;
        let expected = expected_outline(&around).expect("a path");
        assert!(off(&expected, &outline(0.0)) < 0.02, "{expected:?}");
    }

    #[test]
    fn there_is_no_path_far_from_its_frames_or_by_two_of_them() {
        let at = |times: &[f64]| -> Vec<_> { times.iter().map(|t| (*t, outline(*t))).collect() };
        assert!(expected_outline(&at(&[-3.0, -2.0, -1.0])).is_some());
        assert!(expected_outline(&at(&[-9.0, -8.0, -7.0])).is_none());
        assert!(expected_outline(&at(&[-1.0, 1.0])).is_none());
    }
}
