//! Clips of a painted ball: what the frames show of its surface, and the poses by which they all show the same.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::balls::BallEstimate;
use super::batch::{Batch, BatchObserver};
use super::config::BatchConfig;
use crate::error::{Error, Result};
use crate::geometry::{CameraFrame, Vec3, spiral_directions, turned_covariance};
use crate::image::RgbImage;
use crate::pattern::Pattern;
use crate::spin::orientations::{OrientationRow, Orientations};
use crate::spin::shared::ViewTurn;
use crate::surface::{
    PaintedFrame, PaintedPose, PaintedPoses, PaintedTracker, SYSTEMATIC, SurfaceMap,
};
use crate::vision::Budget;
use crate::vision::frame::config::{CameraModel, OutlineMethod};
use crate::vision::outline::circle::CircleConfig;
use crate::vision::outline::find::OutlineFinder;

/// By so much a clip drifts from its first frame to its last, the standard deviation about an axis, degrees, where the camera's distance is
/// known. With it a spin's region of 95 % holds it in 70 of 72 rendered clips, without in 14; with too little of it even spins pass for pushed
/// ones (`docs/measurements/painted.md`).
const DRIFT_DEG: f64 = 1.0;
/// The same where it is not known: 49 of 50 rendered clips, without it 16.
const DRIFT_WITHOUT_DISTANCE_DEG: f64 = 2.0;

/// Estimates the frames of a painted ball: their outlines by [`run`](super::run::run), then all of them on one surface.
#[derive(Debug)]
pub struct PaintedEstimator {
    /// Finds the outlines.
    pub finder: OutlineFinder,
    pub(super) camera: CameraModel,
    tracker: PaintedTracker,
    drift_rad: f64,
}

impl PaintedEstimator {
    /// For a ball of this radius, m, seen by such a camera.
    ///
    /// # Errors
    /// Those of [`OutlineFinder::new`].
    pub fn new(camera: &CameraModel, method: OutlineMethod, ball_radius_m: f64) -> Result<Self> {
        let finder = OutlineFinder::new(CircleConfig::default(), method, camera)?;
        let drift_deg = match camera {
            CameraModel::Known(_) => DRIFT_DEG,
            CameraModel::Unknown(_) => DRIFT_WITHOUT_DISTANCE_DEG,
        };
        Ok(Self {
            finder: finder.with_ball_radius_m(ball_radius_m),
            camera: *camera,
            tracker: PaintedTracker::new(camera),
            drift_rad: drift_deg.to_radians(),
        })
    }

    /// The poses of a clip's frames, of each of which `take` gives what a [`SurfaceObserver`] has kept: on `surface`, which an earlier clip
    /// has made, or relative to the first of them, on the surface that they show.
    pub fn lay_out<K>(
        &self,
        mut batch: Batch<K>,
        take: impl Fn(&mut K) -> PaintedFrame,
        surface: Option<&SurfaceMap>,
    ) -> PaintedClip<K> {
        let kept = batch.frames.iter_mut();
        let frames: Vec<PaintedFrame> = kept.map(|frame| take(&mut frame.kept)).collect();
        let diameters = frames.iter().filter_map(PaintedFrame::diameter_px);
        let diameter_px = crate::stats::median(&mut diameters.collect::<Vec<_>>());
        let (poses, made) = match surface {
            Some(surface) => (self.tracker.place(&frames, surface), None),
            None => {
                let track = self.tracker.track(&frames);
                (track.poses, Some(track.surface))
            }
        };
        PaintedClip {
            batch,
            poses,
            made,
            diameter_px,
            drift_rad: self.drift_rad,
        }
    }
}

/// A clip of a painted ball.
#[derive(Debug)]
pub struct PaintedClip<K> {
    /// Its frames, with outlines.
    pub batch: Batch<K>,
    /// Their poses, each or why there is none.
    pub poses: PaintedPoses,
    /// The surface that they show, where none was given.
    pub made: Option<SurfaceMap>,
    /// The ball's diameter in the picture, the median; 0 where no frame shows it.
    pub diameter_px: f64,
    /// By how much it drifts from its first frame to its last.
    drift_rad: f64,
}

impl<K> PaintedClip<K> {
    /// Whether the poses say anything: that of the frame by which a surface begins, alone, does not.
    pub fn is_answered(&self) -> bool {
        self.poses.iter().flatten().count() > usize::from(self.made.is_some())
    }

    /// How far the clip has drifted by a time, about three axes: evenly. None where a frame has no time.
    fn drift(&self) -> Option<impl Fn(f64) -> ViewTurn> {
        let times = self.batch.times_s()?;
        let (first, last) = (*times.first()?, *times.last()?);
        let drift_rad = self.drift_rad;
        (first < last).then_some(move |time_s: f64| {
            let share = (time_s - first) / (last - first) - 0.5;
            let axes = [Vec3::x(), Vec3::y(), Vec3::z()];
            ViewTurn {
                shared_rad: axes.map(|axis| axis * (share * drift_rad)),
                ..ViewTurn::default()
            }
        })
    }

    /// The row of each frame, in these axes. Its residual is what light, outline and surface err alike wherever the ball shows the same
    /// side, as that of dots ([`SharedError::of_residuals`](crate::spin::shared::SharedError::of_residuals)). It has no confidence: how often a
    /// pose is right depends on how far its clip has drifted, which the frame does not know.
    pub fn orientations(&self, axes: CameraFrame) -> Orientations {
        let (turn, drift) = (axes.turn(), self.drift());
        let frames = self.batch.frames.iter().zip(&self.poses);
        let rows = frames.map(|(frame, pose)| {
            let pose = pose.as_ref().ok();
            let drift = pose.and(drift.as_ref()).zip(frame.time_s);
            let row = OrientationRow {
                frame: frame.name.clone(),
                time_s: frame.time_s.unwrap_or(f64::NAN),
                turn: drift.map(|(drift, time_s)| drift(time_s)),
                position: frame.estimate().position().map(|p| p.turned(&turn)),
                ..OrientationRow::default()
            };
            painted_row(row, pose, axes)
        });
        Orientations {
            rows: rows.collect(),
            camera_frame: Some(axes),
            ..Orientations::default()
        }
    }
}

/// A frame's row with its pose, in these axes, if it has one.
pub(crate) fn painted_row(
    row: OrientationRow,
    pose: Option<&PaintedPose>,
    axes: CameraFrame,
) -> OrientationRow {
    let turn = axes.turn();
    OrientationRow {
        orientation: pose.map(|p| turn * p.rotation),
        covariance: pose.map(|p| turned_covariance(&turn, &p.covariance)),
        residual_rad: pose.map(|_| SYSTEMATIC),
        ..row
    }
}

/// What is kept of a clip's frames takes no more, bytes; as much again is made of it.
const MOST_BYTES: usize = 2 << 30;

/// Directions of a pattern that stands in for the ball's.
const STAND_IN_DOTS: usize = 20;

/// Keeps what frames show of the ball, up to 2 GiB.
#[derive(Debug)]
pub struct SurfaceObserver {
    bytes: AtomicUsize,
    most_bytes: usize,
}

impl Default for SurfaceObserver {
    fn default() -> Self {
        Self {
            bytes: AtomicUsize::new(0),
            most_bytes: MOST_BYTES,
        }
    }
}

impl SurfaceObserver {
    /// Settings under which outlines and detections are found and no pose is looked for, which is all that is needed.
    pub fn settings(batch: BatchConfig) -> BatchConfig {
        BatchConfig {
            independent: true,
            budget: Self::budget(),
            ..batch
        }
    }

    /// The pattern of an estimator that finds no more: it stands in for the ball's.
    ///
    /// # Errors
    /// As [`Pattern::new`]; none in fact.
    pub fn stand_in() -> Result<Pattern> {
        Pattern::new(spiral_directions(STAND_IN_DOTS).collect())
    }

    /// What finding them in a frame may cost.
    pub fn budget() -> Budget {
        Budget {
            runs: 0,
            ..Budget::default()
        }
    }
}

impl BatchObserver for SurfaceObserver {
    type Kept = PaintedFrame;

    fn keep(&self, image: &RgbImage, balls: &[BallEstimate]) -> Result<PaintedFrame> {
        let take = |outline| PaintedFrame::take(image, outline);
        let outline = balls.first().and_then(|ball| ball.frame.outline.as_ref());
        let taken = outline.map(take).unwrap_or_default();
        let before = self.bytes.fetch_add(taken.bytes(), Ordering::Relaxed);
        if before + taken.bytes() > self.most_bytes {
            let problem = format!(
                "expected balls of {} MiB at most in a clip: give fewer frames, or smaller images",
                self.most_bytes >> 20
            );
            return Err(Error::argument("images", problem));
        }
        Ok(taken)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;
    use crate::vision::optics::camera::{BallCircle, Pixel};
    use crate::vision::{FrameEstimate, Outline};

    #[test]
    fn a_clip_that_takes_too_much_memory_is_refused() {
        let image = RgbImage::new(80, 80, vec![[0.5; 3]; 6_400]).expect("an image");
        let circle = BallCircle::new(Pixel { u: 40.0, v: 40.0 }, 30.0);
        let outline = Outline::given(circle, Matrix3::zeros());
        let ball = BallEstimate::of(FrameEstimate::from_detections(outline, Vec::new()), 0);
        let observer = SurfaceObserver {
            bytes: AtomicUsize::new(0),
            most_bytes: 20_000,
        };
        let kept: Vec<bool> = (0..5)
            .map(|_| observer.keep(&image, std::slice::from_ref(&ball)).is_ok())
            .collect();
        assert_eq!(kept, [true, true, true, false, false]);
    }
}
