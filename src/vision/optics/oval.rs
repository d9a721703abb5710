//! By how much a ball's outline is drawn out.
//!
//! In the direction `a` in the image, from u to v, an outline has the radius `r + p cos 2a + q sin 2a`, with `(p, q)` along twice the
//! direction of its longer axis: of an ellipse with the eccentricity `e` it is `r e^2 / 4` long. A pinhole with the focal length `f`
//! sees a ball `d` pixels off its principal point with `e = d / f`, to first order, so that it is `(g / f)^2` times that of a camera
//! with the focal length `g`.
//!
//! A circle that stands for such an outline is that of the same center and area.

use nalgebra::{Matrix2, Matrix2x3, SVector, Vector2};

use super::camera::{BallCircle, BallView, Camera, Intrinsics, Pixel};
use crate::fit::Sums;

/// Points of an outline.
const POINTS: usize = 24;
/// Steps of the fit to them: the center of the first is off by less than the ball is drawn out.
const STEPS: usize = 3;
/// Steps from the circle that an image shows to the ball's, each of which gains a digit at 25 degrees and 8 radii.
const INVERSE_STEPS: usize = 12;

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
    let rim = rim(view);
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

impl Intrinsics {
    /// The circle that the image shows of a ball: of the same center and area as its outline there. `ball` is that of [`BallView::new`],
    /// whose center is where the ball's center is seen.
    pub fn shown_of_ball(&self, ball: &BallCircle) -> BallCircle {
        let shown = || {
            let view = BallView::new(&Camera::Perspective(*self), *ball).ok()?;
            let rim = rim(&view);
            // What chords leave out goes with the square of their length.
            let [(coarse, about_coarse), (fine, about_fine)] =
                [2, 1].map(|step| polygon(&rim, step));
            let area = (4.0 * fine - coarse) / 3.0;
            let off = (about_fine * 4.0 - about_coarse) / (3.0 * area);
            let radius = (area.abs() / std::f64::consts::PI).sqrt();
            let center = Pixel {
                u: ball.center.u + off.x,
                v: ball.center.v + off.y,
            };
            (radius > 0.0 && off.norm() < radius).then(|| BallCircle::new(center, radius))
        };
        shown().unwrap_or(*ball)
    }

    /// The circle of [`BallView::new`] for a ball that the image shows as this circle. The inverse of [`Intrinsics::shown_of_ball`].
    pub fn ball_of_shown(&self, shown: &BallCircle) -> BallCircle {
        let mut ball = BallCircle::new(shown.center, shown.radius);
        for _ in 0..INVERSE_STEPS {
            let now = self.shown_of_ball(&ball);
            ball.center.u += shown.center.u - now.center.u;
            ball.center.v += shown.center.v - now.center.v;
            ball.radius *= shown.radius / now.radius;
        }
        ball
    }
}

/// Area and first moment of the polygon of every point, or every second one.
fn polygon(rim: &[Vector2<f64>; POINTS], step: usize) -> (f64, Vector2<f64>) {
    let (mut area, mut moment) = (0.0, Vector2::zeros());
    for k in (0..POINTS).step_by(step) {
        let [from, to] = [rim[k], rim[(k + step) % POINTS]];
        let twice = from.perp(&to);
        area += 0.5 * twice;
        moment += (from + to) * (twice / 6.0);
    }
    (area, moment)
}

/// The points of an outline, pixels from where the ball's center is seen.
fn rim(view: &BallView) -> [Vector2<f64>; POINTS] {
    let center = view.circle().center;
    std::array::from_fn(|k| {
        let at = view.limb(std::f64::consts::TAU * k as f64 / POINTS as f64);
        Vector2::new(at.u - center.u, at.v - center.v)
    })
}

/// By how much an ellipse is drawn out, pixels, and its derivatives by the shorter half axis and by the eccentricity: half the difference
/// of its half axes, along twice the direction of the longer one.
pub(crate) fn drawn_out(ellipse: &BallCircle) -> (Vector2<f64>, Matrix2x3<f64>) {
    let e = ellipse.eccentricity;
    let square = e.norm_squared();
    let longer = (1.0 - square).powf(-0.5);
    // Half the difference over the square of the eccentricity, and its derivative by that.
    let (part, slope) = if square > 1e-4 {
        let part = 0.5 * (longer - 1.0) / square;
        (part, (0.25 * longer.powi(3) - part) / square)
    } else {
        (0.25 + 0.1875 * square, 0.1875)
    };
    let twice = Vector2::new(e.x * e.x - e.y * e.y, 2.0 * e.x * e.y);
    let by_twice = Matrix2::new(2.0 * e.x, -2.0 * e.y, 2.0 * e.y, 2.0 * e.x);
    let by_eccentricity = by_twice * part + twice * (e * (2.0 * slope)).transpose();
    let by_radius = twice * part;
    let by = Matrix2x3::from_columns(&[
        by_radius,
        (by_eccentricity * ellipse.radius).column(0).into_owned(),
        (by_eccentricity * ellipse.radius).column(1).into_owned(),
    ]);
    (by_radius * ellipse.radius, by)
}

/// The radius of the circle that was fitted to an ellipse, the geometric mean of the half axes, over the shorter one; and
/// its derivative by the eccentricity.
pub(crate) fn of_circle(eccentricity: &Vector2<f64>) -> (f64, Vector2<f64>) {
    let rest = 1.0 - eccentricity.norm_squared();
    let growth = rest.powf(-0.25);
    (growth, eccentricity * (0.5 * growth / rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::optics::lens::Lens;

    /// By the ellipse's ends along the axis and across it, and back, also through a lens.
    #[test]
    fn the_circle_of_an_image_leads_to_the_cone_and_back() {
        let k = Intrinsics::pinhole(300.0, 300.0, 0.0, 0.0);
        for (off_axis, half) in [
            (0.44f64, 0.125f64),
            (0.17, 0.125),
            (0.44, 0.033),
            (0.0, 0.1),
        ] {
            let (near, far) = ((off_axis - half).tan(), (off_axis + half).tan());
            let along = 0.5 * (far - near);
            let across = half.sin() / (half.cos().powi(2) - off_axis.sin().powi(2)).sqrt();
            let center = Pixel {
                u: 150.0 * (near + far),
                v: 0.0,
            };
            let shown = BallCircle::new(center, 300.0 * (along * across).sqrt());
            let found = k.ball_of_shown(&shown);
            assert!((found.center.u - 300.0 * off_axis.tan()).abs() < 0.01);
            let expected = 300.0 * half.tan() / off_axis.cos();
            assert!((found.radius - expected).abs() < 0.01, "{found:?}");
        }
        let lens = Lens::polynomial(&[-0.28, 0.08, 0.001, -0.002]).expect("a lens");
        let k = Intrinsics { lens, ..k };
        let ball = BallCircle::new(Pixel { u: 110.0, v: -60.0 }, 38.0);
        let shown = k.shown_of_ball(&ball);
        let back = k.ball_of_shown(&shown);
        assert!((back.center.u - ball.center.u).hypot(back.center.v - ball.center.v) < 1e-6);
        assert!((back.radius - ball.radius).abs() < 1e-6);
    }

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

    #[test]
    fn an_ellipse_is_drawn_out_by_half_the_difference_of_its_half_axes() {
        let center = Pixel { u: 3.0, v: 5.0 };
        for (length, angle) in [(0.3f64, 0.7f64), (0.005, 2.0), (0.6, -1.1)] {
            let eccentricity = Vector2::new(angle.cos(), angle.sin()) * length;
            let ellipse = BallCircle {
                eccentricity,
                ..BallCircle::new(center, 40.0)
            };
            let longer = 40.0 / (1.0 - length * length).sqrt();
            let (found, by) = drawn_out(&ellipse);
            let along = Vector2::new((2.0 * angle).cos(), (2.0 * angle).sin());
            let expected = along * (0.5 * (longer - 40.0));
            assert!((found - expected).norm() < 1e-9, "{found} {expected}");
            let step = 1e-6;
            for k in 0..3 {
                let [less, more] = [-step, step].map(|step| {
                    let mut moved = ellipse;
                    match k {
                        0 => moved.radius += step,
                        _ => moved.eccentricity[k - 1] += step,
                    }
                    drawn_out(&moved).0
                });
                let slope = (more - less) / (2.0 * step);
                assert!((slope - by.column(k)).norm() < 1e-5, "{k}: {slope} {by}");
            }
        }
    }

    /// A circle about an ellipse of half axes `radius / sqrt(1 - e^2)` and `radius`.
    #[test]
    fn the_circle_of_an_ellipse_has_the_mean_of_its_half_axes() {
        let e = Vector2::new(0.3, 0.2);
        let (growth, by) = of_circle(&e);
        let long = 1.0 / (1.0 - e.norm_squared()).sqrt();
        assert!((growth - (long * 1.0).sqrt()).abs() < 1e-12);
        let step = Vector2::new(1e-6, 0.0);
        let slope = (of_circle(&(e + step)).0 - of_circle(&(e - step)).0) / 2e-6;
        assert!((slope - by.x).abs() < 1e-8);
    }
}
