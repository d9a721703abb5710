//! Outlines made steady over the frames of a clip.
//!
//! Blotches at the rim draw outlines found in single frames aside, and an outline's shift feigns a turn. A ball in a cup stays in place,
//! and one that flies or is turned by hand moves evenly for some frames: its center and radius are fitted by lines over the frames
//! about each, with Tukey's biweight against outlines that are far off.

use crate::stats::{SIGMA_PER_MAD, median};
use crate::vision::camera::BallCircle;

/// Frames before and after one that take part.
const WINDOW: usize = 12;
/// Frames with an outline that it takes.
const MIN_FRAMES: usize = 6;
/// Reweighted fits, and standard deviations beyond which an outline does not count.
const FITS: usize = 4;
const REACH: f64 = 3.0;
/// Outlines that scatter by more of their radius about the line are of a ball that moves otherwise.
const SCATTER: f64 = 0.08;

/// The outline of each frame that has one, steadied, with the standard deviation of its center, pixels.
pub(super) fn steady(circles: &[Option<(BallCircle, f64)>]) -> Vec<Option<(BallCircle, f64)>> {
    let one = |k: usize| {
        let own = circles[k]?;
        Some(about(circles, k).unwrap_or(own))
    };
    (0..circles.len()).map(one).collect()
}

/// The outline at a frame by those about it.
fn about(circles: &[Option<(BallCircle, f64)>], k: usize) -> Option<(BallCircle, f64)> {
    let range = k.saturating_sub(WINDOW)..(k + WINDOW + 1).min(circles.len());
    let near: Vec<(f64, BallCircle)> = range
        .filter_map(|j| Some((j as f64 - k as f64, circles[j]?.0)))
        .collect();
    if near.len() < MIN_FRAMES {
        return None;
    }
    let along = |value: fn(&BallCircle) -> f64| {
        let points: Vec<(f64, f64)> = near.iter().map(|(t, c)| (*t, value(c))).collect();
        line(&points)
    };
    let (u, off_u, sigma_u) = along(|c| c.center.u)?;
    let (v, off_v, sigma_v) = along(|c| c.center.v)?;
    let (radius, off_radius, _) = along(|c| c.radius)?;
    let scatter = off_u.max(off_v).max(off_radius);
    if scatter > SCATTER * radius {
        return None;
    }
    let mut circle = circles[k]?.0;
    (circle.center.u, circle.center.v, circle.radius) = (u, v, radius);
    Some((circle, sigma_u.max(sigma_v)))
}

/// The value of a line through points at 0, how far they scatter, and the standard deviation of the value.
fn line(points: &[(f64, f64)]) -> Option<(f64, f64, f64)> {
    let mut values: Vec<f64> = points.iter().map(|p| p.1).collect();
    let (mut at, mut slope) = (median(&mut values), 0.0);
    let (mut scatter, mut sigma) = (0.0, 0.0);
    for _ in 0..FITS {
        let off = |p: &(f64, f64)| p.1 - at - slope * p.0;
        let mut offs: Vec<f64> = points.iter().map(|p| off(p).abs()).collect();
        scatter = SIGMA_PER_MAD * median(&mut offs);
        let limit = REACH * scatter.max(1e-3);
        let (mut n, mut t, mut tt, mut x, mut tx) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for point in points {
            let part = off(point) / limit;
            let weight = (1.0 - part * part).max(0.0).powi(2);
            n += weight;
            t += weight * point.0;
            tt += weight * point.0 * point.0;
            x += weight * point.1;
            tx += weight * point.0 * point.1;
        }
        let determinant = n * tt - t * t;
        if determinant < 1e-9 {
            return None;
        }
        at = (tt * x - t * tx) / determinant;
        slope = (n * tx - t * x) / determinant;
        sigma = scatter * (tt / determinant).sqrt();
    }
    Some((at, scatter, sigma))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::Pixel;

    #[test]
    fn a_ball_on_a_straight_path_is_found_in_spite_of_outlines_that_are_far_off() {
        let truth = |k: usize| (100.0 + 1.5 * k as f64, 60.0 - 0.5 * k as f64);
        let circles: Vec<Option<(BallCircle, f64)>> = (0..40)
            .map(|k| {
                let (mut u, mut v) = truth(k);
                // A scatter of 1 px that is not even, and every seventh outline elsewhere.
                u += (k as f64 * 2.4).sin();
                v += (k as f64 * 1.7).cos();
                if k % 7 == 3 {
                    u += 15.0;
                }
                (k % 11 != 5).then(|| (BallCircle::new(Pixel { u, v }, 50.0), 0.1))
            })
            .collect();
        for (k, found) in steady(&circles).into_iter().enumerate() {
            assert_eq!(found.is_some(), circles[k].is_some(), "{k}");
            if let Some((circle, sigma)) = found {
                let (u, v) = truth(k);
                let off = (circle.center.u - u).hypot(circle.center.v - v);
                assert!(off < 0.9, "frame {k}: {off:.2} px off");
                assert!(sigma < 0.9, "frame {k}: {sigma:.2} px");
            }
        }
    }
}
