//! By how much a ball's outline is drawn out.
//!
//! In the direction `a` in the image, from u to v, an outline has the radius `r + p cos 2a + q sin 2a`, with `(p, q)` along twice the
//! direction of its longer axis: of an ellipse with the eccentricity `e` it is `r e^2 / 4` long. A pinhole with the focal length `f`
//! sees a ball `d` pixels off its principal point with `e = d / f`, to first order, so that it is `(g / f)^2` times that of a camera
//! with the focal length `g`.

use nalgebra::{Matrix2, SVector, Vector2};

use super::camera::BallView;
use crate::fit::Sums;
use crate::geometry::Vec3;

/// Points of an outline.
const POINTS: usize = 24;
/// Steps of the fit to them: the center of the first is off by less than the ball is drawn out.
const STEPS: usize = 3;

/// By how much an outline is drawn out beyond that of its view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Oval {
    /// What the cosine and the sine of twice the direction in the image, from u to v, add to the radius, pixels.
    pub stretch_px: Vector2<f64>,
    /// Its covariance, px^2, by the scatter of the rim alone.
    pub covariance: Matrix2<f64>,
}

/// By how much the outline that a view has is drawn out, pixels.
pub(crate) fn stretch_px(view: &BallView) -> Option<Vector2<f64>> {
    let depth = view.horizon();
    let aside = (1.0 - depth * depth).sqrt();
    let rim = std::array::from_fn::<_, POINTS, _>(|k| {
        let (s, c) = (std::f64::consts::TAU * k as f64 / POINTS as f64).sin_cos();
        let at = view.project(&Vec3::new(aside * c, aside * s, depth));
        Vector2::new(at.u, at.v)
    });
    let mut center = rim.iter().sum::<Vector2<f64>>() / POINTS as f64;
    let mut fitted = [0.0; 5];
    for _ in 0..STEPS {
        let mut sums = Sums::<5>::default();
        for at in rim {
            let off = at - center;
            let radius = off.norm();
            let (c, s) = (off.x / radius, off.y / radius);
            sums.add(&[1.0, c, s, c * c - s * s, 2.0 * s * c], radius, 1.0);
        }
        let gradient = SVector::from(sums.gradient);
        fitted = sums.symmetric().cholesky()?.solve(&gradient).into();
        center += Vector2::new(fitted[1], fitted[2]);
    }
    fitted
        .iter()
        .all(|x| x.is_finite())
        .then(|| Vector2::new(fitted[3], fitted[4]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::optics::camera::{BallCircle, Camera, Pixel};
    use crate::vision::optics::intrinsics::Intrinsics;

    /// By the half axes of the ellipse that a pinhole sees: those of the cone's cut.
    #[test]
    fn an_outline_is_drawn_out_as_the_cut_of_its_cone() {
        for (focal, u, v, radius) in [(600.0, 200.0, 0.0, 40.0), (400.0, 120.0, -160.0, 60.0)] {
            let k = Intrinsics::pinhole(focal, focal, 0.0, 0.0);
            let circle = BallCircle::new(Pixel { u, v }, radius);
            let view = BallView::new(&Camera::Perspective(k), circle).expect("a view");
            let off_axis = (u.hypot(v) / focal).atan();
            let half = view.horizon().asin();
            let q = off_axis.cos().powi(2) - half.sin().powi(2);
            let longer = focal * half.sin() * half.cos() / q;
            let shorter = focal * half.sin() / q.sqrt();
            let found = stretch_px(&view).expect("an outline");
            let (twice, expected) = (2.0 * v.atan2(u), 0.5 * (longer - shorter));
            let along = Vector2::new(twice.cos(), twice.sin());
            assert!((found.dot(&along) / expected - 1.0).abs() < 0.03, "{found}");
            assert!(found.norm() - found.dot(&along).abs() < 1e-6, "{found}");
        }
    }
}
