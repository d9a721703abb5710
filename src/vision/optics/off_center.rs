//! What an unknown camera costs: the angle of the ray through the ball.
//!
//! Without intrinsics orientations are in the view frame, whose z points from the ball to the camera. The camera's frame is turned
//! from it by the angle between the optical axis and the ray through the ball's center. A pinhole camera with square pixels, the
//! field of view `f` along the longer side of `s` pixels and its principal point in the image's center sees a ball `d` pixels off
//! that center under the angle
//!
//! ```text
//! atan(2 d tan(f / 2) / s)
//! ```
//!
//! A cut-out of an image does not say where the center of the whole was.

use super::camera::BallCircle;

/// A ball off the center of its image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffCenter {
    /// Distance of the ball's center from that of the image, pixels.
    pub offset_px: f64,
    /// Columns and rows of the image.
    pub size: [usize; 2],
}

impl OffCenter {
    /// That of the ball farthest off the center, in shares of its image; `None` where all cover the centers of theirs, as
    /// crops do.
    pub fn farthest(seen: impl Iterator<Item = (BallCircle, [usize; 2])>) -> Option<Self> {
        let off = seen.filter_map(|(circle, size)| {
            let [u, v] = size.map(|side| 0.5 * (side as f64 - 1.0));
            let offset_px = (circle.center.u - u).hypot(circle.center.v - v);
            (offset_px > circle.radius).then_some(Self { offset_px, size })
        });
        off.max_by(|a, b| a.share().total_cmp(&b.share()))
    }

    /// The angle of the ray, radians, for a field of view along the image's longer side, radians below pi.
    pub fn angle_rad(&self, field_of_view_rad: f64) -> f64 {
        (self.share() * (0.5 * field_of_view_rad).tan()).atan()
    }

    /// The distance over half the longer side.
    fn share(&self) -> f64 {
        let [columns, rows] = self.size;
        2.0 * self.offset_px / columns.max(rows).max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec3;
    use crate::vision::optics::camera::{BallView, Camera, Intrinsics, Pixel};

    #[test]
    fn the_angle_is_the_turn_from_the_view_frame_to_that_of_a_camera() {
        let size = [1280, 960];
        for field in [0.2, 0.6, 1.2f64] {
            let focal = 640.0 / (0.5 * field).tan();
            let k = Intrinsics::pinhole(focal, focal, 639.5, 479.5);
            for (u, v) in [(1200.0, 500.0), (100.0, 30.0), (639.5, 900.0)] {
                let circle = BallCircle::new(Pixel { u, v }, 40.0);
                let view = BallView::new(&Camera::Perspective(k), circle).expect("a view");
                let off =
                    OffCenter::farthest([(circle, size)].into_iter()).expect("off the center");
                let turn = (view.to_camera() * Vec3::z()).angle(&Vec3::z());
                assert!(
                    (off.angle_rad(field) - turn).abs() < 1e-12,
                    "{u} {v}: {turn}"
                );
            }
        }
    }

    #[test]
    fn crops_are_not_off_the_center() {
        let center = Pixel { u: 31.0, v: 35.0 };
        let crop = (BallCircle::new(center, 28.0), [66, 66]);
        assert_eq!(OffCenter::farthest([crop].into_iter()), None);
        let far = (BallCircle::new(center, 28.0), [640, 480]);
        let near = (
            BallCircle::new(Pixel { u: 300.0, v: 200.0 }, 5.0),
            [640, 480],
        );
        let off = OffCenter::farthest([crop, near, far].into_iter()).expect("one");
        assert_eq!(off.offset_px, 288.5f64.hypot(204.5));
    }
}
