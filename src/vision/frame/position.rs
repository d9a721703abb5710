//! Where the ball is: its center in the camera's frame, by its outline.
//!
//! A camera whose intrinsics are known sees a sphere of the radius `R` within a cone that touches it, of the half angle `a` about the
//! ray `q` to its center:
//!
//! ```text
//! center = (R / sin a) q / |q|
//! ```
//!
//! An outline says both ([`BallView::new`]): it has the pixel in which the center is seen, and the radius `sqrt(fx fy) |q| m tan a`. So
//! the center follows from it without an approximation, off the axis and through a lens that distorts. The covariance `S` of the outline
//! becomes `J S J^T`, with the derivatives `J` of the center by the outline's center and radius.
//!
//! Where the dots are named, outline and orientation are fitted together, and so are their errors: the joint covariance of turn and
//! outline becomes that of turn and center. A shift of the outline turns the view frame, in which the orientation is fitted: that is a
//! part of the turn.
//!
//! Not in the covariance: errors of the diameter and of the intrinsics, which all frames share. A ball that is larger than stated by a
//! part of its diameter is seen nearer than it is by that part of its distance.

use nalgebra::{Matrix3, SMatrix};

use super::outline::Outline;
use crate::geometry::Position;
use crate::vision::optics::camera::{BallView, Camera};
use crate::vision::optics::intrinsics::Intrinsics;

/// Step of the finite differences by an outline, radii.
const STEP: f64 = 1e-4;

/// What an outline's center (u, v) and radius move, by columns.
struct Slopes {
    /// The ball's center, camera frame, ball radii a pixel.
    center: Matrix3<f64>,
    /// The turn of the view frame, a rotation vector in the camera's frame, radians a pixel.
    turn: Matrix3<f64>,
}

fn slopes(view: &BallView) -> Option<Slopes> {
    let step_px = STEP * view.circle().radius;
    let mut slopes = Slopes {
        center: Matrix3::zeros(),
        turn: Matrix3::zeros(),
    };
    for column in 0..3 {
        let moved = |by: f64| {
            let mut circle = *view.circle();
            match column {
                0 => circle.center.u += by,
                1 => circle.center.v += by,
                _ => circle.radius += by,
            }
            view.at(circle).ok()
        };
        let (ahead, behind) = (moved(step_px)?, moved(-step_px)?);
        let center = ahead.center()? - behind.center()?;
        let turn = ahead.to_camera() * behind.to_camera().inverse();
        let scale = 0.5 / step_px;
        slopes.center.set_column(column, &(center * scale));
        slopes
            .turn
            .set_column(column, &(turn.scaled_axis() * scale));
    }
    Some(slopes)
}

/// The center of a ball by its outline; `None` for one that no ball can have.
pub(crate) fn of_outline(
    outline: &Outline,
    intrinsics: Intrinsics,
    ball_radius_m: f64,
) -> Option<Position> {
    let view = BallView::new(&Camera::Perspective(intrinsics), outline.circle).ok()?;
    let center_m = view.center()? * ball_radius_m;
    let by_outline = slopes(&view)?.center * ball_radius_m;
    let covariance = by_outline * outline.covariance * by_outline.transpose();
    Some(Position {
        center_m,
        covariance: 0.5 * (covariance + covariance.transpose()),
        with_rotation: None,
    })
}

/// The center of a ball and the covariance of its orientation in the camera's frame, rad^2, by the joint covariance of the orientation's
/// turn (view frame) and the outline's u, v and radius; `None` where the camera's intrinsics are not known.
pub(crate) fn of_pose(
    view: &BallView,
    joint: &SMatrix<f64, 6, 6>,
    ball_radius_m: f64,
) -> Option<(Position, Matrix3<f64>)> {
    let center_m = view.center()? * ball_radius_m;
    let slopes = slopes(view)?;
    let mut by = SMatrix::<f64, 6, 6>::zeros();
    by.fixed_view_mut::<3, 3>(0, 0)
        .copy_from(view.to_camera().to_rotation_matrix().matrix());
    by.fixed_view_mut::<3, 3>(0, 3).copy_from(&slopes.turn);
    by.fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&(slopes.center * ball_radius_m));
    let all = by * joint * by.transpose();
    let all = 0.5 * (all + all.transpose());
    let block = |row, column| all.fixed_view::<3, 3>(row, column).into_owned();
    let position = Position {
        center_m,
        covariance: block(3, 3),
        with_rotation: Some(block(3, 0)),
    };
    Some((position, block(0, 0)))
}
