//! A rolling shutter: the rows of an image are exposed one after another.
//!
//! With the time `s` from row to row, the row `v` is exposed `v s` after the frame's time, that of its first row. A ball whose center is
//! seen at `v_c` is seen at the frame's time plus `v_c s`. Its dot at the pixel `p_j`, row `v_j`, is seen by `t_j = (v_j - v_c) s` later,
//! when the ball has turned by `w t_j` and moved by `x t_j` (`w` its spin, `x` its velocity in the image):
//!
//! ```text
//! p_j = project(exp([w t_j]x) R d_j) + x t_j,     q_j = project(exp(-[w t_j]x) direction(p_j - x t_j))
//! ```
//!
//! `q_j` is where the dot is seen at the time of the center. The pose is fitted to these once the spin is known. Without that the ball
//! is sheared: its pose is turned by about a fifth of what the ball turns from its upper rim to its lower one (`bench rolling`), much
//! alike in all frames, which leaves the rate of the spin as it is and tilts its axis.
//!
//! Spins that differ by whole turns between two frames shear the ball differently: how well the `q_j` fit weighs them
//! ([`SequenceRows`]). Where the ball turns by so much that no pose is found in the sheared dots, nothing is corrected.

use nalgebra::Vector2;

use super::orientations;
use super::orientations::NamedFrame;
use super::sequence::SequenceConfig;
use super::sequence_view::SequenceView;
use super::smears::{independent, velocity};
use crate::geometry::{CameraFrame, Rotation, Vec3};
use crate::spin::alias::SpinEvidence;
use crate::spin::estimate::SpinEstimate;
use crate::vision::estimator::Estimator;
use crate::vision::frame::estimate::FrameEstimate;
use crate::vision::optics::camera::{BallCircle, Pixel};
use crate::vision::outline::path::{NEIGHBORS, expected_outline};
use crate::vision::pose::refine::{self, Drawn, RefinedFrame};

/// Rounds of [`correct_rows`]: names that the sheared dots lost are back in the second, and the spin that they leave open is settled: of
/// twelve clips at 60 frames per second that of one more (`bench rolling --clips 12 --seed 1001 --cameras 60:16`).
const ROUNDS: usize = 2;

/// When the ball is seen in each frame of a sequence, seconds: `times_s` are those of the first rows, `row_s` the time from row to
/// row. Frames without a pose are seen where the path of the others leads.
pub fn seen_times(row_s: f64, times_s: &[f64], frames: &[FrameEstimate]) -> Vec<f64> {
    if row_s == 0.0 {
        return times_s.to_vec();
    }
    let numbered = || times_s.iter().zip(frames);
    let posed = numbered().filter_map(|(time_s, frame)| {
        frame.pose()?;
        Some((*time_s, frame.circle?))
    });
    let posed: Vec<(f64, BallCircle)> = posed.collect();
    let row = |(time_s, frame): (&f64, &FrameEstimate)| {
        let own = frame.circle.filter(|_| frame.pose().is_some());
        let circle = own.or_else(|| nearby(&posed, *time_s)).or(frame.circle);
        circle.map_or(0.0, |circle| circle.center.v)
    };
    numbered()
        .map(|(time_s, frame)| time_s + row_s * row((time_s, frame)))
        .collect()
}

/// Where the path leads at a time, or where the ball is seen next to it.
fn nearby(posed: &[(f64, BallCircle)], time_s: f64) -> Option<BallCircle> {
    let mut around: Vec<_> = posed
        .iter()
        .map(|(t, circle)| (t - time_s, *circle))
        .collect();
    around.sort_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    around.truncate(NEIGHBORS);
    let nearest = around.first().map(|(_, circle)| *circle);
    around.sort_by(|a, b| a.0.total_cmp(&b.0));
    expected_outline(&around).or(nearest)
}

/// A frame with a pose, and how its ball moves.
struct Moving<'a> {
    number: usize,
    frame: &'a FrameEstimate,
    /// Pixels a second.
    velocity: Vector2<f64>,
    /// Frame of the spin to the view frame.
    to_view: Rotation,
}

/// The rows of a sequence's frames as evidence for its spin.
pub struct SequenceRows<'a> {
    estimator: &'a Estimator,
    row_s: f64,
    frames: Vec<Moving<'a>>,
}

impl<'a> SequenceRows<'a> {
    /// Of frames with the times at which their balls are seen ([`seen_times`]); spins are in `axes`, as those of
    /// [`orientations`]. `None` for a global shutter.
    pub fn new(
        estimator: &'a Estimator,
        row_s: f64,
        named: &[NamedFrame<'a>],
        axes: CameraFrame,
    ) -> Option<Self> {
        let common = SequenceView::of_frames(named.iter().map(|f| f.estimate));
        let moving = |k: usize| {
            let frame = named[k].estimate;
            let (view, center) = (estimator.view(frame)?, frame.circle?.center);
            frame.pose()?;
            let turn = common.map(|common| common.turn(center));
            let to_common = turn.unwrap_or_default() * view.to_camera();
            Some(Moving {
                number: k,
                frame,
                velocity: velocity(named, k),
                to_view: (axes.turn() * to_common).inverse(),
            })
        };
        (row_s > 0.0).then(|| Self {
            estimator,
            row_s,
            frames: (0..named.len()).filter_map(moving).collect(),
        })
    }
}

impl SpinEvidence for SequenceRows<'_> {
    fn ln_likelihood(&self, spin: &Vec3) -> f64 {
        let one = |moving: &Moving<'_>| {
            let cost = self.estimator.misfit_at_once(moving, spin, self.row_s);
            -0.5 * cost
        };
        independent(self.frames.len()) * self.frames.iter().map(one).sum::<f64>()
    }
}

impl Estimator {
    /// The frame with its dots where they are seen at the time of the ball's center, and what is known before they are fitted.
    fn at_once(
        &self,
        moving: &Moving<'_>,
        spin: &Vec3,
        row_s: f64,
        drawn: Drawn,
    ) -> Option<(FrameEstimate, refine::PosePrior, Rotation)> {
        let (view, pose) = (self.view(moving.frame)?, moving.frame.pose()?);
        let (spin, center) = (moving.to_view * spin, view.circle().center);
        let mut frame = moving.frame.clone();
        for dot in &mut frame.dots {
            let late_s = row_s * (dot.pixel.v - center.v);
            let moved = moving.velocity * late_s;
            let there = Pixel {
                u: dot.pixel.u - moved.x,
                v: dot.pixel.v - moved.y,
            };
            // Beside the ball there is nothing that turns.
            if let Some(direction) = view.direction(there) {
                let turned = Rotation::from_scaled_axis(spin * -late_s) * direction;
                dot.pixel = view.project(&turned);
            }
        }
        // Not the corrected outline, which has the sheared dots' error.
        let outline = frame.outline?.with_model_error();
        let prior = refine::PosePrior {
            outline,
            oval: None,
            camera: self.config.camera,
            start: self.config.camera.at(pose.distance),
            drawn,
            axis: frame.axis,
        };
        let rotation = view.to_camera().inverse() * pose.rotation;
        Some((frame, prior, rotation))
    }

    /// Minus two log-likelihoods of a frame's named dots where the ball has this spin.
    fn misfit_at_once(&self, moving: &Moving<'_>, spin: &Vec3, row_s: f64) -> f64 {
        let dots = self.ball.pattern().dots();
        let fitted = self.at_once(moving, spin, row_s, Drawn::AsStated);
        fitted.map_or(0.0, |(frame, prior, rotation)| {
            self.refiner.misfit(dots, &prior, &rotation, &frame)
        })
    }

    /// The pose of a frame at the time of the ball's center; `None` where the dots fit none.
    fn refined_at_once(
        &self,
        moving: &Moving<'_>,
        spin: &Vec3,
        row_s: f64,
    ) -> Option<(FrameEstimate, RefinedFrame)> {
        let dots = self.ball.pattern().dots();
        let (mut frame, prior, rotation) = self.at_once(moving, spin, row_s, Drawn::AsSeen)?;
        let (matches, refiner) = (&mut Vec::new(), &self.refiner);
        let refined = refiner.refine(dots, &prior, &rotation, &mut frame, matches)?;
        Some((frame, refined))
    }
}

/// Corrects the poses of a sequence for a rolling shutter, by the spin that orientations and rows say together; dots stay where they
/// are seen. `times_s` are the times at which the balls are seen ([`seen_times`]). Where there is no spin, nothing changes.
pub(crate) fn correct_rows(
    estimator: &Estimator,
    config: &SequenceConfig,
    times_s: &[f64],
    frames: &mut [FrameEstimate],
) {
    for _ in 0..ROUNDS {
        correct_once(estimator, config, times_s, frames);
    }
}

fn correct_once(
    estimator: &Estimator,
    config: &SequenceConfig,
    times_s: &[f64],
    frames: &mut [FrameEstimate],
) {
    let named = NamedFrame::of_times(times_s, frames);
    let axes = CameraFrame::default();
    let Some(rows) = SequenceRows::new(estimator, config.row_s, &named, axes) else {
        return;
    };
    let file = orientations(&named, axes, true);
    let (measurements, settings) = (file.measurements(), file.spin_config(config.spin));
    let Ok(fit) = SpinEstimate::provisional(&measurements, &settings, &rows) else {
        return;
    };
    let spin = fit.motion.spin;
    let corrected = rows.frames.iter().filter_map(|moving| {
        let (at_once, refined) = estimator.refined_at_once(moving, &spin, config.row_s)?;
        let pose = refined.of(moving.frame.pose()?);
        Some((moving.number, at_once.assignment, refined, pose))
    });
    let corrected: Vec<_> = corrected.collect();
    for (number, assignment, refined, pose) in corrected {
        let frame = &mut frames[number];
        frame.assignment = assignment;
        frame.circle = Some(*refined.view.circle());
        frame.outcome = Ok(pose);
    }
}
