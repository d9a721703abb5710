//! A ball off the optical axis, seen by a camera that looks straight at it.
//!
//! A sphere of the half angle `a`, whose center is seen under the angle `t` to the axis of a pinhole
//! with the focal length `f`, has an ellipse for its outline, from `f tan(t - a)` to `f tan(t + a)` off
//! the principal point, with the half-axis `f sin a / sqrt(cos^2 a - sin^2 t)` across. A fit of a
//! circle to it gets center and radius wrong: at 25 degrees the radius by 5 %. A camera at the same
//! place that looks at the ball's center sees a circle. Both images are related by the homography
//! `K R K'^-1` of the rotation `R` between the cameras (R. Hartley, A. Zisserman, "Multiple View
//! Geometry in Computer Vision", 2nd ed., Sec. 8.4).
//!
//! The surroundings of the ball are resampled for that camera; its focal length is
//! `sqrt(fx fy) |q| m`, with `q` the ray to the center at unit depth and `m` the lens' magnification there, so that the ball keeps its size
//! up to a radius of [`MAX_RADIUS`]. There the outline is fitted and the dots are detected; both are
//! mapped back with their covariances. Outlines of the image are then as
//! [`BallView`](crate::vision::optics::camera::BallView) has them: the center is where the ball's
//! center is seen, the radius `sqrt(fx fy) |q| m tan a`. Distortion is undone here, and nowhere else.
//!
//! Without intrinsics an outline that is an ellipse beyond doubt gives the angle, and for a ball at a usual distance
//! everything else ([`Intrinsics::of_ellipse`]): the ball is seen by such a camera, and a circle fitted there. Dots and
//! outline are those of the ellipse when they are mapped back; the distance stays open, and to which side the ball stands
//! follows from the dots when they are fitted.
//!
//! What lies beyond the image's border is continued from there: where the ball is cut, so is its
//! outline.

use nalgebra::{Matrix2, Matrix3, Vector2};

use crate::geometry::{Rotation, Vec3};
use crate::image::GrayImage;
use crate::vision::dots::detector::DotDetection;
use crate::vision::frame::estimate::FrameEstimate;
use crate::vision::frame::outline::Outline;
use crate::vision::optics::camera::{BallCircle, Pixel};
use crate::vision::optics::intrinsics::Intrinsics;
use crate::vision::outline::circle::{BallFinder, BallFit, CircleConfig, Polarity};

/// Balls farther off the optical axis than this are recentered: one degree, where the axes of the
/// outline differ by 1 part in 6000.
const MIN_OFF_AXIS_RAD: f64 = 0.0175;
/// Half the side of the virtual image, ball radii.
const REACH: f64 = 1.4;
/// The distance for which a ball that is seen as an ellipse is recentered, one over radii: what differs is of second order.
const USUAL_INVERSE_DISTANCE: f64 = 0.07;
/// Larger balls are shrunk to this radius, pixels: finer than both the fit and the patch.
const MAX_RADIUS: f64 = 88.0;
/// Pixels of the largest virtual image.
const MAX_PIXELS: usize = {
    let side = 2.0 * REACH * MAX_RADIUS + 2.0;
    (side * side) as usize
};
/// An outline that loses more of its support than this in the virtual image is not the ball's.
const LESS_SUPPORT: f64 = 0.1;
/// Step of the finite differences that map an outline's covariance, pixels.
const DIFFERENCE: f64 = 1e-3;

/// A camera that looks at the ball's center.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VirtualCamera {
    intrinsics: Intrinsics,
    /// Virtual camera frame to camera frame.
    to_camera: Matrix3<f64>,
    focal: f64,
    side: usize,
    /// The ball's radius in the virtual image.
    radius: f64,
}

impl VirtualCamera {
    /// The camera for a ball with this outline; `None` where it is on the axis or not before the camera.
    pub fn new(intrinsics: &Intrinsics, circle: &BallCircle) -> Option<Self> {
        let towards = intrinsics.ray(circle.center)?;
        let off_axis = towards.xy().norm().atan();
        if !(off_axis > MIN_OFF_AXIS_RAD && circle.radius > 0.0) {
            return None;
        }
        let to_camera = Rotation::rotation_between(&-Vec3::z(), &towards)?;
        let scale = (MAX_RADIUS / circle.radius).min(1.0);
        let radius = scale * circle.radius;
        Some(Self {
            intrinsics: *intrinsics,
            to_camera: *to_camera.to_rotation_matrix().matrix(),
            focal: scale * intrinsics.scale_at(&towards),
            side: (2.0 * REACH * radius).ceil() as usize + 1,
            radius,
        })
    }

    fn middle(&self) -> f64 {
        0.5 * (self.side as f64 - 1.0)
    }

    /// The ball as expected: in the middle.
    pub fn circle(&self) -> BallCircle {
        BallCircle::new(
            Pixel {
                u: self.middle(),
                v: self.middle(),
            },
            self.radius,
        )
    }

    /// Resamples the surroundings of the ball.
    pub fn look(&self, image: &GrayImage, into: &mut GrayImage) {
        // Samples a side of a pixel's square, so that none of the image's pixels is passed over.
        let shrunk = self.intrinsics.focal() / self.focal;
        let fine = (shrunk.ceil() as usize).clamp(1, 64);
        let weight = 1.0 / (fine * fine) as f32;
        let sub = |k: usize| (k as f64 + 0.5) / fine as f64 - 0.5;
        let step = self.to_camera.column(0) / self.focal;
        into.fill_rows(self.side, self.side, |v, values| {
            let first = values.len();
            values.resize(first + self.side, 0.0);
            let row = &mut values[first..];
            for k in 0..fine * fine {
                let from = self.ray(Pixel {
                    u: sub(k % fine),
                    v: v as f64 + sub(k / fine),
                });
                self.intrinsics
                    .project_along(&from, &step, self.side, |u, at| {
                        row[u] += weight * image.sample(at.u, at.v);
                    });
            }
        });
    }

    /// The ray through a pixel of the virtual image, camera frame.
    fn ray(&self, pixel: Pixel) -> Vec3 {
        let x = (pixel.u - self.middle()) / self.focal;
        let y = (self.middle() - pixel.v) / self.focal;
        self.to_camera * Vec3::new(x, y, -1.0)
    }

    /// Where a pixel of the virtual image lies in the image.
    pub fn image_of(&self, pixel: Pixel) -> Pixel {
        self.intrinsics.project(&self.ray(pixel))
    }

    /// d(pixel of the image)/d(pixel of the virtual image).
    fn jacobian(&self, pixel: Pixel) -> Matrix2<f64> {
        let by_ray = self.intrinsics.jacobian(&self.ray(pixel));
        let turn = self.to_camera.fixed_columns::<2>(0);
        by_ray * turn * Matrix2::new(1.0, 0.0, 0.0, -1.0) / self.focal
    }

    /// The circle of the virtual image as an outline of the image.
    fn circle_to_image(&self, circle: &BallCircle) -> BallCircle {
        let (du, dv) = (
            circle.center.u - self.middle(),
            circle.center.v - self.middle(),
        );
        let tan = circle.radius / Vector2::new(du, dv).norm().hypot(self.focal);
        let ray = self.ray(circle.center);
        let scale = self.intrinsics.scale_at(&(ray / -ray.z));
        BallCircle::new(self.intrinsics.project(&ray), tan * scale)
    }

    /// A fit in the virtual image as one in the image.
    pub fn fit_to_image(&self, fit: &BallFit) -> BallFit {
        let circle = self.circle_to_image(&fit.circle);
        let mut jacobian = Matrix3::zeros();
        for column in 0..3 {
            let mut moved = fit.circle;
            match column {
                0 => moved.center.u += DIFFERENCE,
                1 => moved.center.v += DIFFERENCE,
                _ => moved.radius += DIFFERENCE,
            }
            let moved = self.circle_to_image(&moved);
            let change = Vec3::new(
                moved.center.u - circle.center.u,
                moved.center.v - circle.center.v,
                moved.radius - circle.radius,
            );
            jacobian.set_column(column, &(change / DIFFERENCE));
        }
        BallFit {
            circle,
            covariance: jacobian * fit.covariance * jacobian.transpose(),
            edge_width: fit.edge_width * circle.radius / fit.circle.radius,
            ..*fit
        }
    }

    /// Detections in the virtual image as detections in the image.
    pub fn dots_to_image(&self, dots: &mut [DotDetection]) {
        for dot in dots {
            let jacobian = self.jacobian(dot.pixel);
            let covariance = jacobian * dot.covariance * jacobian.transpose();
            dot.covariance = 0.5 * (covariance + covariance.transpose());
            dot.pixel = self.image_of(dot.pixel);
        }
    }
}

/// Recenters balls; keeps its memory from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Recentering {
    finder: BallFinder,
    image: GrayImage,
}

/// A ball that was recentered.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Recentered {
    pub camera: VirtualCamera,
    /// Its outline in the virtual image.
    pub circle: BallCircle,
}

impl Recentering {
    /// Memory for balls of any size.
    pub fn new(config: CircleConfig) -> Self {
        let mut this = Self {
            finder: BallFinder::new(config),
            image: GrayImage::default(),
        };
        this.finder.reserve_near(MAX_PIXELS);
        this.image.reserve(MAX_PIXELS);
        this
    }

    /// The virtual image of the last ball.
    pub fn image(&self) -> &GrayImage {
        &self.image
    }

    /// The same where the intrinsics are unknown, for an outline that was found and is an ellipse. `middle` is where the
    /// principal point is expected: the ellipse may be that of a ball to either side.
    pub fn recenter_ellipse(
        &mut self,
        middle: Pixel,
        gray: &GrayImage,
        contrast: Option<&GrayImage>,
        frame: &mut FrameEstimate,
    ) -> Option<Recentered> {
        let outline = frame.outline?;
        if outline.is_given() {
            return None;
        }
        let polarity = frame.fit.map_or(Polarity::Mixed, |f| f.polarity);
        let mut ellipse = outline.circle;
        if !ellipse.is_ellipse() {
            let mut fit = |image| {
                self.finder
                    .fit_ellipse_near(image, &outline.circle, polarity)
            };
            ellipse = fit(gray).or_else(|| fit(contrast?))?.circle;
        }
        let from_middle = Vector2::new(ellipse.center.u - middle.u, ellipse.center.v - middle.v);
        if from_middle.dot(&ellipse.eccentricity) < 0.0 {
            ellipse.eccentricity = -ellipse.eccentricity;
        }
        let intrinsics = Intrinsics::of_ellipse(&ellipse, USUAL_INVERSE_DISTANCE)?;
        let seen = Intrinsics::from_ellipse(&ellipse, USUAL_INVERSE_DISTANCE);
        let camera = VirtualCamera::new(&intrinsics, &seen)?;
        let found = frame.fit.map_or(0.0, |f| f.support);
        let mut fit = |image: &GrayImage| {
            camera.look(image, &mut self.image);
            let fit = self
                .finder
                .fit_near(&self.image, &camera.circle(), polarity)?;
            (fit.support >= found).then_some(fit)
        };
        let in_contrast = contrast.and_then(&mut fit);
        let fitted = fit(gray).into_iter().chain(in_contrast);
        let fitted = fitted.max_by(|a, b| a.support.total_cmp(&b.support))?;
        let mut mapped = camera.fit_to_image(&fitted);
        mapped.circle =
            Intrinsics::to_ellipse(&mapped.circle, ellipse.eccentricity, USUAL_INVERSE_DISTANCE);
        (mapped.visible, mapped.rivals) = frame.fit.map_or((1.0, 0), |f| (f.visible, f.rivals));
        frame.outline = Some(Outline::from(&mapped));
        if frame.fit.is_some() {
            frame.fit = Some(mapped);
        }
        let circle = fitted.circle;
        Some(Recentered { camera, circle })
    }

    /// Makes the virtual image of a ball off the axis, and corrects its outline, by its edges where these were found. `contrast` is the color
    /// contrast, where the outline was looked for in it as well.
    /// `None` where the ball is on the axis: then only a given circle becomes the ball's.
    pub fn recenter(
        &mut self,
        intrinsics: &Intrinsics,
        gray: &GrayImage,
        contrast: Option<&GrayImage>,
        frame: &mut FrameEstimate,
    ) -> Option<Recentered> {
        let outline = frame.outline?;
        let rough = outline_of_fit(intrinsics, &outline);
        let Some(camera) = VirtualCamera::new(intrinsics, &rough.circle) else {
            if outline.is_given() {
                frame.outline = Some(rough);
            }
            return None;
        };
        let Some(fit) = frame.fit else {
            camera.look(gray, &mut self.image);
            frame.outline = Some(rough);
            let circle = camera.circle();
            return Some(Recentered { camera, circle });
        };
        let in_contrast = contrast.and_then(|contrast| self.fit(&camera, contrast, &fit));
        // The last look is the one that dots are detected in.
        let in_gray = self.fit(&camera, gray, &fit);
        let fits = in_gray.into_iter().chain(in_contrast);
        let fitted = fits.max_by(|a, b| a.support.total_cmp(&b.support));
        let circle = match fitted {
            Some(fitted) => {
                let mapped = camera.fit_to_image(&fitted);
                frame.outline = Some(Outline::from(&mapped));
                frame.fit = Some(mapped);
                fitted.circle
            }
            None => {
                frame.outline = Some(rough);
                camera.circle()
            }
        };
        Some(Recentered { camera, circle })
    }

    /// The outline in the virtual image, if it is there as clear as it was in the image.
    fn fit(
        &mut self,
        camera: &VirtualCamera,
        image: &GrayImage,
        found: &BallFit,
    ) -> Option<BallFit> {
        camera.look(image, &mut self.image);
        let near = camera.circle();
        let fit = self.finder.fit_near(&self.image, &near, found.polarity)?;
        (fit.support + LESS_SUPPORT >= found.support).then_some(BallFit {
            visible: found.visible,
            rivals: found.rivals,
            ..fit
        })
    }
}

/// The outline of the ball to whose elliptic image `fitted` was fitted as a circle. The covariance of one that was found grows by what a fit
/// to a part of the ellipse may be off.
fn outline_of_fit(k: &Intrinsics, fitted: &Outline) -> Outline {
    let circle = k.ball_of_shown(&fitted.circle);
    let stretch = match fitted.is_given() {
        true => 0.0,
        false => 0.5 * (fitted.circle.radius - circle.radius),
    };
    Outline {
        circle,
        covariance: fitted.covariance + Matrix3::from_diagonal_element(stretch * stretch),
        ..*fitted
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::outline::OutlineSource;
    use crate::vision::optics::camera::{BallView, Camera};

    const INTRINSICS: Intrinsics = Intrinsics::pinhole(420.0, 400.0, -140.0, 90.0);
    const CIRCLE: BallCircle = BallCircle::new(Pixel { u: 41.0, v: 37.0 }, 28.0);

    #[test]
    fn the_virtual_camera_sees_the_ball_in_the_middle() {
        let camera = VirtualCamera::new(&INTRINSICS, &CIRCLE).expect("off the axis");
        let back = camera.circle_to_image(&camera.circle());
        assert!((back.center.u - CIRCLE.center.u).abs() < 1e-9);
        assert!((back.center.v - CIRCLE.center.v).abs() < 1e-9);
        assert!((back.radius - CIRCLE.radius).abs() < 1e-9);
        // Directions are those that a view of the circle has there.
        let view = BallView::new(&Camera::Perspective(INTRINSICS), CIRCLE).expect("a ball");
        let middle = view.project(&Vec3::z());
        assert!((middle.u - CIRCLE.center.u).hypot(middle.v - CIRCLE.center.v) < 1e-9);
    }

    #[test]
    fn the_jacobian_is_that_of_the_map() {
        let camera = VirtualCamera::new(&INTRINSICS, &CIRCLE).expect("off the axis");
        let at = Pixel { u: 20.0, v: 55.0 };
        let jacobian = camera.jacobian(at);
        for (column, (du, dv)) in [(1e-5, 0.0), (0.0, 1e-5)].into_iter().enumerate() {
            let a = camera.image_of(Pixel {
                u: at.u + du,
                v: at.v + dv,
            });
            let b = camera.image_of(Pixel {
                u: at.u - du,
                v: at.v - dv,
            });
            assert!((jacobian[(0, column)] - (a.u - b.u) / 2e-5).abs() < 1e-6);
            assert!((jacobian[(1, column)] - (a.v - b.v) / 2e-5).abs() < 1e-6);
        }
    }

    /// Where no edges show it, whether it was found or given.
    #[test]
    fn an_outline_without_edges_is_that_of_the_cone() {
        let k = Intrinsics::pinhole(300.0, 300.0, 0.0, 0.0);
        let circle = BallCircle::new(Pixel { u: 140.0, v: 20.0 }, 40.0);
        for source in [OutlineSource::Detected, OutlineSource::Given] {
            let shown = Outline {
                circle: k.shown_of_ball(&circle),
                covariance: Matrix3::identity(),
                source,
            };
            let mut frame = FrameEstimate {
                outline: Some(shown),
                ..FrameEstimate::default()
            };
            let mut gray = GrayImage::default();
            gray.fill_with(300, 60, |_, _| 0.5);
            let mut recentering = Recentering::new(CircleConfig::default());
            let seen = recentering.recenter(&k, &gray, None, &mut frame);
            assert!(seen.is_some());
            let found = frame.outline.expect("one");
            assert_eq!(found.source, source);
            let off = found.circle.center.u - circle.center.u;
            let off = off.hypot(found.circle.center.v - circle.center.v);
            assert!(off < 1e-4 && (found.circle.radius - circle.radius).abs() < 1e-4);
        }
    }

    /// Less than a degree from the axis a ball's center is seen beside the middle of its outline, too, by a tenth of a pixel here.
    #[test]
    fn a_given_circle_near_the_axis_becomes_the_balls() {
        let k = Intrinsics::pinhole(800.0, 800.0, 150.0, 30.0);
        let circle = BallCircle::new(Pixel { u: 162.0, v: 27.0 }, 90.0);
        let shown = k.shown_of_ball(&circle);
        assert!((shown.center.u - circle.center.u).abs() > 0.1);
        for source in [OutlineSource::Detected, OutlineSource::Given] {
            let outline = Outline {
                circle: shown,
                covariance: Matrix3::identity(),
                source,
            };
            let mut frame = FrameEstimate {
                outline: Some(outline),
                ..FrameEstimate::default()
            };
            let gray = GrayImage::default();
            let mut recentering = Recentering::new(CircleConfig::default());
            assert!(recentering.recenter(&k, &gray, None, &mut frame).is_none());
            let found = frame.outline.expect("one").circle;
            let expected = match source {
                OutlineSource::Given => circle,
                _ => shown,
            };
            let off = found.center.u - expected.center.u;
            assert!(off.hypot(found.center.v - expected.center.v) < 1e-4);
            assert!((found.radius - expected.radius).abs() < 1e-4);
        }
    }
}
