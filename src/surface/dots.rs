//! Dots whose places on the ball are known, by the pixels of one frame.
//!
//! A detector finds what looks like a dot to it; where a dot must be seen, its cap ([`cap`](crate::vision::dots::cap)) is fitted whether it was detected
//! or not.

use nalgebra::Matrix2;

use super::frame::PaintedFrame;
use crate::geometry::{Vec3, tangent_frame};
use crate::stats::quantile;
use crate::vision::dots::cap::{CapFitter, CapShape};
use crate::vision::optics::ball_pixels::BallPixels;
use crate::vision::optics::camera::{BallView, Pixel};

/// A dot that a frame should show.
#[derive(Debug, Clone, Copy)]
pub struct ExpectedDot {
    /// Where it should be, view frame.
    pub direction: Vec3,
    /// Its angular radius, radians.
    pub radius: f64,
    /// Whether the radius is what other frames show: then this one's hardly differs.
    pub is_sized: bool,
}

/// Where a frame shows a dot.
#[derive(Debug, Clone, Copy)]
pub struct FoundDot {
    /// Its middle.
    pub pixel: Pixel,
    /// Covariance of that (u, v), px^2.
    pub covariance: Matrix2<f64>,
    /// Its angular radius, radians.
    pub radius: f64,
}

/// A place is read within so many radii of its middle, and about it at so many radii; so many pixels each.
const WITHIN: f64 = 0.6;
const ABOUT: f64 = 2.0;
const READ: [usize; 2] = [12, 24];
/// The bare ball about a place: this share of what is read there is no brighter.
const BARE: f64 = 0.6;
/// The bare ball is no darker.
const DARKEST: f64 = 0.01;
/// From one place to the next about a middle, radians: no two are on one ray.
const GOLDEN: f64 = 2.399_963;

/// By how much each of these dots is darker in a frame than the ball about it, over that; 0 where nothing is there. `None` where the frame shows no
/// ball.
pub fn contrasts(frame: &PaintedFrame, view: &BallView, dots: &[ExpectedDot]) -> Option<Vec<f64>> {
    let (image, grid) = frame.image()?;
    let of_dot = |dot: &ExpectedDot| {
        let [a, b] = tangent_frame(&dot.direction);
        let read = |radius: f64, i: usize| {
            let (sin, cos) = (GOLDEN * i as f64).sin_cos();
            let place = dot.direction + (a * cos + b * sin) * (radius * dot.radius);
            let at = grid.pixel_to_part(view.project(&place.normalize()));
            f64::from(image.sample(at.u, at.v))
        };
        let [within, about] = READ;
        let evenly = |i: usize| WITHIN * ((i as f64 + 0.5) / within as f64).sqrt();
        let dark = (0..within).map(|i| read(evenly(i), i)).sum::<f64>() / within as f64;
        let mut around: Vec<f64> = (0..about).map(|i| read(ABOUT, i)).collect();
        around.sort_unstable_by(f64::total_cmp);
        let bare = quantile(&around, BARE).max(DARKEST);
        (bare - dark) / bare
    };
    Some(dots.iter().map(of_dot).collect())
}

/// Where a frame shows these dots under a view of the ball, `None` for those that it does not.
pub fn find_dots(
    frame: &PaintedFrame,
    view: &BallView,
    dots: &[ExpectedDot],
) -> Vec<Option<FoundDot>> {
    let mut found = vec![None; dots.len()];
    let Some((image, grid)) = frame.image() else {
        return found;
    };
    let pixels = BallPixels {
        gray: &image,
        grid,
        view,
    };
    let mut caps = CapFitter::default();
    // What the dots that face the camera say of blur and tone curve, those near the rim need most.
    let mut order: Vec<usize> = (0..dots.len()).collect();
    order.sort_by(|a, b| dots[*b].direction.z.total_cmp(&dots[*a].direction.z));
    let mut shape = None;
    for i in order {
        let dot = &dots[i];
        let near = view.project(&dot.direction);
        let expected = match shape {
            Some(shape) => CapShape {
                radius: dot.radius,
                is_known: dot.is_sized,
                ..shape
            },
            None => CapShape::first(dot.radius, view),
        };
        if let Some(cap) = caps.fit(&pixels, near, Some(expected)) {
            shape = Some(cap.shape);
            found[i] = Some(FoundDot {
                pixel: cap.pixel,
                covariance: cap.covariance,
                radius: cap.shape.radius,
            });
        }
    }
    found
}
