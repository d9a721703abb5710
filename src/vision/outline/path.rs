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

use crate::fit::Reweighting;
use crate::vision::optics::camera::{BallCircle, Pixel};

/// Outlines that make a path.
pub(crate) const NEIGHBORS: usize = 8;
/// Minimum number of them; from the second on, the path may bend.
const MIN_NEIGHBORS: (usize, usize) = (3, 5);
/// Beyond the outermost of them the path is followed for so many of their mean steps.
const BEYOND: f64 = 2.5;
/// Outlines that scatter about the path by more than this, in radii, make none.
pub(crate) const MAX_SCATTER: f64 = 0.15;
/// Outlines are never known better than to a tenth of a pixel.
const REWEIGHTING: Reweighting = Reweighting {
    fits: 6,
    reach: 7.0,
    least: 0.1,
    starts_level: false,
};
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
    let scaled: Vec<(f64, BallCircle)> = around.iter().map(|(t, c)| (t / step, *c)).collect();
    let center = match around.len() >= MIN_NEIGHBORS.1 {
        true => Degree::Parabola,
        false => Degree::Line,
    };
    let path = OutlineAtZero::fit(&scaled, [center, Degree::Line], &REWEIGHTING)?;
    let [u, v, radius] = path.scatters;
    let is_smooth =
        path.circle.radius > 0.0 && u.hypot(v).max(radius) <= MAX_SCATTER * path.circle.radius;
    is_smooth.then_some(path.circle)
}

/// How center or radius change with time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Degree {
    /// Not at all.
    Level,
    /// Evenly.
    Line,
    /// As those of a ball that falls.
    Parabola,
}

/// The outline at time 0 by polynomials through those at other times.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OutlineAtZero {
    pub circle: BallCircle,
    /// Median deviations of the centers' u and v and the radii, pixels.
    pub scatters: [f64; 3],
    /// Variances of the center's u and v over those of the outlines.
    pub variances: [f64; 2],
}

impl OutlineAtZero {
    /// Of outlines at their times, for the degrees of center and radius; `None` where they do not fix it.
    pub fn fit(
        around: &[(f64, BallCircle)],
        [of_center, of_radius]: [Degree; 2],
        how: &Reweighting,
    ) -> Option<Self> {
        let fit = |value: fn(&BallCircle) -> f64, degree: Degree| {
            let points: Vec<(f64, f64)> = around.iter().map(|(t, c)| (*t, value(c))).collect();
            match degree {
                Degree::Level => how.value_at_zero::<1>(&points),
                Degree::Line => how.value_at_zero::<2>(&points),
                Degree::Parabola => how.value_at_zero::<3>(&points),
            }
        };
        let u = fit(|c| c.center.u, of_center)?;
        let v = fit(|c| c.center.v, of_center)?;
        let radius = fit(|c| c.radius, of_radius)?;
        let center = Pixel {
            u: u.value,
            v: v.value,
        };
        Some(Self {
            circle: BallCircle::new(center, radius.value),
            scatters: [u.scatter, v.scatter, radius.scatter],
            variances: [u.variance, v.variance],
        })
    }
}

/// The circle at a part of the straight way from one to another, or beyond.
pub(crate) fn along(from: &BallCircle, to: &BallCircle, share: f64) -> BallCircle {
    let mix = |a: f64, b: f64| a + (b - a) * share;
    let center = Pixel {
        u: mix(from.center.u, to.center.u),
        v: mix(from.center.v, to.center.v),
    };
    BallCircle::new(center, mix(from.radius, to.radius))
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
        let ahead = along(&first, &last, (time_s - first_s) / (last_s - first_s));
        let (min, max) = (1.0 - MAX_GROWTH, 1.0 + MAX_GROWTH);
        let radius = ahead.radius.clamp(min * last.radius, max * last.radius);
        Some(BallCircle { radius, ..ahead })
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
