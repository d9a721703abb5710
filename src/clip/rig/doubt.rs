//! What is wrong with the cameras of a rig as a whole, in a line each.

use super::agreement::{Compared, Discord, compare};
use super::fuse::CameraReading;
use super::pairs::CameraTrack;
use super::{Assembly, CameraClip};
use crate::vision::estimator::Estimator;
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection, is_mirrored};
use crate::vision::optics::camera::{BallView, Camera};

/// Frames of one camera that it takes to say what is wrong with all of them.
const MIN_FRAMES: usize = 3;

/// What is wrong with the cameras of a rig as a whole.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum RigDoubt {
    /// A camera shows the ball in a mirror. Its frames are left out.
    Mirrored {
        /// Its name.
        camera: String,
    },
    /// A camera shows another ball than the table's. Its frames are left out.
    OtherBall {
        /// Its name.
        camera: String,
    },
    /// The clips fit when they are exchanged.
    Swapped {
        /// The names of both cameras.
        cameras: [String; 2],
    },
    /// A camera is turned against its stated place.
    Turned {
        /// Its name, and that of the first camera.
        cameras: [String; 2],
        /// By this angle, radians.
        angle_rad: f64,
        /// Standard deviation of the angle, radians.
        std_rad: f64,
    },
    /// Cameras see the ball in different places.
    Gap {
        /// The name of one, and that of the first camera.
        cameras: [String; 2],
        /// So far apart, m.
        gap_m: f64,
        /// At this distance from the first camera, m.
        distance_m: f64,
    },
    /// Cameras see a ball that moves differently.
    Apart {
        /// The name of one, and that of the first camera.
        cameras: [String; 2],
        /// Share of the orientations that have anything in common.
        share: f64,
    },
}

impl RigDoubt {
    /// Whether nothing that the cameras say together can be believed, rather than one camera left out.
    pub fn is_of_all(&self) -> bool {
        !matches!(self, Self::Mirrored { .. } | Self::OtherBall { .. })
    }
}

impl std::fmt::Display for RigDoubt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Mirrored { camera } => write!(
                f,
                "{camera} shows the ball in a mirror: is its picture flipped? Its frames are left out"
            ),
            Self::OtherBall { camera } => write!(
                f,
                "{camera} shows another ball than the table's: its frames are left out"
            ),
            Self::Swapped { cameras: [a, b] } => write!(
                f,
                "the clips of {a} and {b} are exchanged: they agree the other way around"
            ),
            Self::Turned {
                cameras: [camera, first],
                angle_rad,
                std_rad,
            } => write!(
                f,
                "{camera} is turned by {:.1} +- {:.1} deg against where the rig's file has it beside {first}: its R is wrong, or a camera \
                 has moved",
                angle_rad.to_degrees(),
                std_rad.to_degrees()
            ),
            Self::Gap {
                cameras: [camera, first],
                gap_m,
                distance_m,
            } => write!(
                f,
                "{camera} and {first} see the ball {:.0} mm apart, {:.2} m away: T (meters?) or the ball's diameter is wrong, or a camera \
                 has moved",
                1e3 * gap_m,
                distance_m
            ),
            Self::Apart {
                cameras: [camera, first],
                share,
            } => write!(
                f,
                "{camera} and {first} do not see one motion: only {:.0} % of the orientations have one turn in common; are the clips of one \
                 flight?",
                100.0 * share
            ),
        }
    }
}

/// What is wrong with one camera's frames by themselves.
pub(super) fn of_camera(name: &str, frames: &[FrameEstimate]) -> Option<RigDoubt> {
    let count = |is: &dyn Fn(&FrameEstimate) -> bool| frames.iter().filter(|f| is(f)).count();
    let posed = count(&|f| f.pose().is_some());
    let camera = name.to_owned();
    let most = |n: usize| n >= MIN_FRAMES && n > posed;
    if most(count(&is_mirrored)) {
        return Some(RigDoubt::Mirrored { camera });
    }
    let is_foreign = |f: &FrameEstimate| f.outcome == Err(FrameRejection::Foreign);
    most(count(&is_foreign)).then_some(RigDoubt::OtherBall { camera })
}

/// What is wrong between the cameras, of those that were compared.
pub(super) fn of_rig(rig: &mut Assembly<'_>, clips: &[CameraClip<'_>]) {
    for k in 1..clips.len() {
        let Some(Compared {
            discord: Some(discord),
            agreement,
            ..
        }) = rig.compared[k]
        else {
            continue;
        };
        let names = |a: usize, b: usize| [a, b].map(|k| rig.rig.cameras()[k].name.clone());
        // Cameras that fit when two clips are exchanged are not wrong otherwise.
        let other =
            (0..clips.len()).find(|other| *other != k && fits_exchanged(rig, clips, *other, k));
        let doubt = match (other, discord) {
            (Some(other), _) => RigDoubt::Swapped {
                cameras: names(other.min(k), other.max(k)),
            },
            (None, Discord::Apart { share }) => RigDoubt::Apart {
                cameras: names(k, 0),
                share,
            },
            (None, Discord::Turned { angle_rad, std_rad }) => RigDoubt::Turned {
                cameras: names(k, 0),
                angle_rad,
                std_rad: std_rad.max(agreement.turn_std_rad),
            },
            (None, Discord::Gap { gap_m, distance_m }) => RigDoubt::Gap {
                cameras: names(k, 0),
                gap_m,
                distance_m,
            },
        };
        if !rig.doubts.contains(&doubt) {
            rig.doubts.push(doubt);
        }
    }
}

/// Whether all cameras agree with the clips of two exchanged.
fn fits_exchanged(rig: &Assembly<'_>, clips: &[CameraClip<'_>], a: usize, b: usize) -> bool {
    let clip_of = |camera: usize| match camera {
        k if k == a => b,
        k if k == b => a,
        k => k,
    };
    let tracks: Vec<CameraTrack> = (0..clips.len())
        .map(|camera| {
            exchanged(
                rig,
                &clips[clip_of(camera)],
                clips[camera].estimator,
                camera,
            )
        })
        .collect();
    // Clocks may be anything then, but the rest must fit.
    let compared = (1..clips.len()).map(|k| compare(&tracks[0], &tracks[k]));
    let mut compared = compared.flatten().peekable();
    compared.peek().is_some() && compared.all(|compared| compared.discord.is_none())
}

/// A clip as if another camera had taken it.
fn exchanged(
    rig: &Assembly<'_>,
    clip: &CameraClip<'_>,
    by: &Estimator,
    camera: usize,
) -> CameraTrack {
    let to_rig = rig.rig.cameras()[camera].to_rig();
    let timed = clip.times_s.iter().flatten().zip(&clip.frames);
    let readings = timed.filter_map(|(time_s, frame)| {
        let seen = by_camera(frame, clip.estimator, by)?;
        Some((
            *time_s + rig.delays_s[camera],
            CameraReading::of(&seen, &to_rig)?,
        ))
    });
    let readings: Vec<(f64, CameraReading)> = readings.collect();
    let measured = readings.iter().filter_map(|(time_s, reading)| {
        Some(crate::spin::Measurement {
            confidence: reading.confidence,
            ..crate::spin::Measurement::new(*time_s, reading.rotation?)
        })
    });
    let measured: Vec<_> = measured.collect();
    let spin = rig.config.sequence.spin;
    let fit = crate::spin::robust::RobustEstimator::new(spin)
        .fit(&measured)
        .ok();
    CameraTrack { readings, fit }
}

/// A frame's pose and place as the intrinsics of another camera have them.
fn by_camera(frame: &FrameEstimate, own: &Estimator, other: &Estimator) -> Option<FrameEstimate> {
    let view = |estimator: &Estimator| match estimator.config().camera {
        CameraModel::Known(camera @ Camera::Perspective(_)) => {
            BallView::new(&camera, frame.circle?).ok()
        }
        _ => None,
    };
    let (from, to) = (view(own)?, view(other)?);
    let turn = to.to_camera() * from.to_camera().inverse();
    let mut pose = *frame.pose()?;
    pose.rotation = turn * pose.rotation;
    pose.covariance = crate::geometry::turned_covariance(&turn, &pose.covariance);
    let center_m = to.center()? * other.ball_radius_m();
    pose.position = pose.position.map(|position| crate::geometry::Position {
        center_m,
        ..position.turned(&turn)
    });
    Some(FrameEstimate {
        outcome: Ok(pose),
        ..frame.clone()
    })
}
