//! Where the frames before and after a frame expect its ball.
//!
//! Center and radius of a ball follow a smooth path: over a few frames a parabola (a straight line for
//! the radius, and where frames are few). It is fitted to the outlines of the nearest frames in time
//! whose poses are trusted, by iteratively reweighted least squares with Tukey's biweight. A frame is
//! *in doubt* where it has no pose, or its outline lies off the path. It is looked at again where the
//! path says, and keeps what it had unless the dots there are evident: enough likely dots with a clear
//! pose, found without a hint.
//!
//! Guarantees: a path is made of other frames only, and only of poses found without a hint. An outline
//! that comes from it says so ([`OutlineSource::Neighbors`]). Not guaranteed: anything where the path
//! bends between two frames, as at a bounce; the dots then decide against it.

use nalgebra::{Matrix3, Vector3};

use super::search::is_evident;
use super::{
    Budget, Estimator, EstimatorWorkspace, FrameEstimate, FrameImage, OutlinePrior, OutlineSource,
    Prior, SequenceConfig,
};
use crate::vision::camera::{BallCircle, Pixel};
use crate::vision::detect::DotDetector;

/// Outlines that make a path.
const NEIGHBORS: usize = 8;
/// Minimum number of them; from the second on, the path may bend.
const MIN_NEIGHBORS: (usize, usize) = (3, 5);
/// Beyond the outermost of them the path is followed for so many of their mean steps.
const BEYOND: f64 = 2.5;
/// Outlines that scatter about the path by more than this, in radii, make none.
const MAX_SCATTER: f64 = 0.15;
/// An outline farther off the path than this, in radii, is in doubt.
const OFF_PATH: f64 = 0.1;
/// Reweighted fits, and the biweight's reach in median deviations.
const ROUNDS: usize = 6;
const REACH: f64 = 7.0;

/// A frame that its neighbors may settle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameInDoubt {
    /// Its number in the sequence.
    pub frame: usize,
    /// Where they expect the ball.
    pub expected: BallCircle,
}

/// The frames of a sequence that have no pose, or another outline than their neighbors expect.
/// `times_s` are in seconds, one a frame, each later than the one before.
pub fn frames_in_doubt(
    config: &SequenceConfig,
    times_s: &[f64],
    frames: &[FrameEstimate],
) -> Vec<FrameInDoubt> {
    let trusted: Vec<(usize, f64, BallCircle)> = times_s
        .iter()
        .zip(frames)
        .enumerate()
        .filter_map(|(k, (time_s, frame))| {
            let pose = frame.pose()?;
            let is_trusted = !pose.hinted && pose.pose_confidence >= config.trusted;
            Some((k, *time_s, frame.circle?)).filter(|_| is_trusted)
        })
        .collect();
    let mut around = Vec::with_capacity(NEIGHBORS);
    let doubt = |k: usize| {
        let frame = &frames[k];
        if frame.outline_source == OutlineSource::Given {
            return None;
        }
        nearest(&trusted, k, times_s[k], &mut around);
        let expected = expected_outline(&around)?;
        let is_off = frame.circle.is_none_or(|c| off(&c, &expected) > OFF_PATH);
        (is_off || frame.pose().is_none()).then_some(FrameInDoubt { frame: k, expected })
    };
    (0..frames.len().min(times_s.len()))
        .filter_map(doubt)
        .collect()
}

impl<D: DotDetector> Estimator<D> {
    /// Looks at a frame again where its neighbors expect the ball; whether that changed the estimate.
    ///
    /// A pose found there replaces the frame's where it is evident. Where the frame has no pose and its
    /// outline is another, dots and outline of the expected place take its place without a pose:
    /// [`track_sequence`](super::track_sequence) may identify them with a hint.
    pub fn estimate_again<'a>(
        &self,
        image: impl Into<FrameImage<'a>>,
        expected: &BallCircle,
        ws: &mut EstimatorWorkspace<D::Workspace>,
        frame: &mut FrameEstimate,
    ) -> bool {
        let mut again = FrameEstimate::default();
        let prior = Prior {
            outline: Some(OutlinePrior {
                circle: *expected,
                sigma_px: MAX_SCATTER * expected.radius,
            }),
            ..Prior::default()
        };
        let budget = Budget {
            spent: frame.attempts,
            ..Budget::default()
        };
        self.estimate(image, &prior, &budget, ws, &mut again);
        let is_off = |f: &FrameEstimate| {
            f.outline
                .is_none_or(|o| off(&o.circle, expected) > OFF_PATH)
        };
        if is_off(&again) {
            return false;
        }
        let is_clear = is_evident(&again);
        let replaces = match frame.pose() {
            // Both poses are of dots alone; the path speaks for one of them.
            Some(_) => is_clear && is_off(frame),
            None => is_clear || is_off(frame),
        };
        if !replaces {
            return false;
        }
        if !is_clear {
            again.reject_pose();
        }
        again.outline_source = OutlineSource::Neighbors;
        *frame = again;
        true
    }
}

/// The trusted outlines nearest in time to frame `k`, without its own, times relative to its own.
fn nearest(
    trusted: &[(usize, f64, BallCircle)],
    k: usize,
    time_s: f64,
    into: &mut Vec<(f64, BallCircle)>,
) {
    into.clear();
    let split = trusted.partition_point(|t| t.0 < k);
    let mut before = trusted[..split].iter().rev().peekable();
    let mut after = trusted[split..].iter().filter(|t| t.0 != k).peekable();
    while into.len() < NEIGHBORS {
        let left = before.peek().map(|t| time_s - t.1);
        let right = after.peek().map(|t| t.1 - time_s);
        let next = match (left, right) {
            (Some(l), Some(r)) if l <= r => before.next(),
            (Some(_), None) => before.next(),
            (_, Some(_)) => after.next(),
            (None, None) => None,
        };
        let Some((_, t, circle)) = next else { break };
        into.push((t - time_s, *circle));
    }
}

/// The outline at time 0 by those of other times; `None` where they make no path, or it ends before.
fn expected_outline(around: &[(f64, BallCircle)]) -> Option<BallCircle> {
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
    is_smooth.then_some(BallCircle {
        center: Pixel {
            u: u.value,
            v: v.value,
        },
        radius: radius.value,
    })
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
            let t = residual(point) / reach;
            *weight = if t.abs() < 1.0 {
                (1.0 - t * t).powi(2)
            } else {
                0.0
            };
        }
        fitted = Some(Smooth {
            value: found.x,
            scatter: median,
        });
    }
    fitted
}

/// The larger of the center's and the radius' difference, in radii.
fn off(a: &BallCircle, b: &BallCircle) -> f64 {
    let apart = (a.center.u - b.center.u).hypot(a.center.v - b.center.v);
    apart.max((a.radius - b.radius).abs()) / b.radius
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outline(t: f64) -> BallCircle {
        BallCircle {
            center: Pixel {
                u: 100.0 + 40.0 * t,
                v: 300.0 - 20.0 * t + 3.0 * t * t,
            },
            radius: 30.0 + 0.2 * t,
        }
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

    #[test]
    fn neighbors_are_the_nearest_on_both_sides_without_the_frame_itself() {
        let trusted: Vec<_> = (0..20).map(|k| (k, k as f64, outline(k as f64))).collect();
        let mut around = Vec::new();
        nearest(&trusted, 10, 10.0, &mut around);
        let mut times: Vec<f64> = around.iter().map(|a| a.0).collect();
        times.sort_by(f64::total_cmp);
        assert_eq!(times, [-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0]);
        nearest(&trusted, 0, 0.0, &mut around);
        assert_eq!(around.len(), 8);
        assert!(around.iter().all(|a| a.0 > 0.0));
    }
}
