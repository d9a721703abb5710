//! Orientations of a treadmill's ball in the columns of FicTrac, so that the analysis of a fly's or a mouse's walk reads them.
//!
//! An animal that is held walks on a ball, and the ball's rotation is its fictive path. [FicTrac] (R. J. D. Moore et al., J. Neurosci.
//! Methods 225, 2014) follows such a ball by its paint and writes 25 columns without a header, which [`FicTracRow`] has. Its documents
//! `data_header.txt` and `coordinate_frames.md` define them:
//!
//! - camera: x right, y down, z forward; lab: x the animal's front, y its right, z down, the camera's frame rotated by `C` (`c2a_r`);
//! - a change `d` of orientation, a rotation vector, leads from one row to the next: `R(k) = exp([d]x) R(k-1)`, `d_lab = C d`;
//! - the animal stands on the ball: `+y_lab` is a step ahead, `+x_lab` one to its left, `+z_lab` a turn to its left.
//!
//! ```text
//! v = (d_y, -d_x),   speed = |v|,   direction = atan2(v_y, v_x),   heading += -d_z
//! position += sinc(d_z / 2) Rot(heading before - d_z / 2) v
//! ```
//!
//! the last of which is the path of an animal that walks and turns evenly from one row to the next (FicTrac sums four steps of it: at
//! 0.5 rad a frame it differs by 6e-4 of the step). Angles are in `[0, 2 pi)`, lengths in radii of the ball.
//!
//! Three columns are other than FicTrac's own: the absolute orientation leads from the *pattern* to the camera or lab, where FicTrac's
//! first frame is its own origin; the error score is a deviation in radians, not a difference of gray values; the time of day is NaN
//! where nobody knows when a picture was taken.
//!
//! Guarantees: a frame without an orientation has no row, and counts, as with FicTrac; then the next row's change is the shortest rotation
//! since the last row. Not guaranteed: that the ball turned less than half a turn in between.
//!
//! [FicTrac]: https://github.com/rjdmoore/fictrac
//!
//! ```
//! use spindoe::geometry::{Rotation, Vec3};
//! use spindoe::spin::fictrac::{FicTrac, FicTracConfig};
//! use spindoe::spin::orientations::OrientationRow;
//!
//! // A camera behind the animal: the ball's top comes towards it, about the camera's +x, which is the animal's right.
//! let mut fictrac = FicTrac::new(FicTracConfig::default());
//! let mut at = |k: i32| OrientationRow {
//!     time_s: 0.01 * f64::from(k),
//!     orientation: Some(Rotation::new(Vec3::x() * 0.1 * f64::from(k))),
//!     ..OrientationRow::default()
//! };
//! fictrac.push(&at(0), None)?;
//! let row = fictrac.push(&at(1), None)?.expect("an orientation");
//! assert!((row.position_radii[0] - 0.1).abs() < 1e-12 && row.direction_rad.abs() < 1e-12);
//! # Ok::<(), spindoe::Error>(())
//! ```

use std::f64::consts::TAU;
use std::fmt;

use nalgebra::Matrix3;

use super::orientations::{OrientationRow, Orientations};
use crate::error::{Error, Result, require};
use crate::geometry::{CameraFrame, Rotation, Vec3};

/// Number of columns.
pub const COLUMNS: usize = 25;
/// Their names, in order: those of FicTrac's `data_header.txt` in short.
pub const NAMES: [&str; COLUMNS] = [
    "frame",
    "delta_cam_x",
    "delta_cam_y",
    "delta_cam_z",
    "delta_error",
    "delta_lab_x",
    "delta_lab_y",
    "delta_lab_z",
    "absolute_cam_x",
    "absolute_cam_y",
    "absolute_cam_z",
    "absolute_lab_x",
    "absolute_lab_y",
    "absolute_lab_z",
    "position_x",
    "position_y",
    "heading",
    "direction",
    "speed",
    "forward",
    "side",
    "timestamp_ms",
    "sequence",
    "delta_timestamp_ms",
    "alt_timestamp_ms",
];

/// How a ball's orientations become an animal's path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FicTracConfig {
    /// From the camera's frame (x right, y down, z forward) to the lab's (x the animal's front, y its right, z down): FicTrac's `c2a_r`.
    pub camera_to_lab: Rotation,
    /// After more frames without an orientation than this, the path begins anew: FicTrac's `max_bad_frames`. `None` is its -1: never.
    pub max_bad_frames: Option<u64>,
}

impl Default for FicTracConfig {
    /// A level camera behind the animal that looks ahead: its z is the lab's x, its x the lab's y, its y the lab's z. As FicTrac's,
    /// a path never begins anew.
    fn default() -> Self {
        let third = TAU / 3.0 / 3f64.sqrt();
        Self {
            camera_to_lab: Rotation::new(Vec3::repeat(third)),
            max_bad_frames: None,
        }
    }
}

impl FicTracConfig {
    /// The rotation vector of the camera's frame to the lab's, as FicTrac's configuration has it, radians.
    ///
    /// # Errors
    /// [`Error::Argument`] for numbers that are not finite.
    pub fn with_c2a_r(self, c2a_r: [f64; 3]) -> Result<Self> {
        let inside = c2a_r.iter().all(|x| x.is_finite());
        require(inside, "c2a_r", "three finite numbers", shown(c2a_r))?;
        Ok(Self {
            camera_to_lab: Rotation::new(c2a_r.into()),
            ..self
        })
    }
}

fn shown(numbers: [f64; 3]) -> String {
    numbers.map(|x| x.to_string()).join(",")
}

/// A row of FicTrac's output. Angles are radians, lengths radii of the ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FicTracRow {
    /// Number of the frame, from 1 on; frames without an orientation count.
    pub frame: u64,
    /// Rotation vector since the row before, camera frame.
    pub delta_cam: Vec3,
    /// Standard deviation of that rotation: the root of its covariance's trace, the errors of both orientations taken as independent; NaN
    /// where they are not known.
    pub delta_error: f64,
    /// Rotation vector since the row before, lab frame.
    pub delta_lab: Vec3,
    /// Rotation vector that leads from the pattern to the camera's frame.
    pub absolute_cam: Vec3,
    /// Rotation vector that leads from the pattern to the lab's frame.
    pub absolute_lab: Vec3,
    /// The animal's fictive path: to the front and right of where it began.
    pub position_radii: [f64; 2],
    /// The animal's heading, clockwise from above from where it began.
    pub heading_rad: f64,
    /// Direction of this step from the animal's front, clockwise from above; any, where there is none.
    pub direction_rad: f64,
    /// Length of this step.
    pub speed_radii: f64,
    /// Sums of the steps ahead and to the right, whatever the heading.
    pub motion_radii: [f64; 2],
    /// The frame's time, ms.
    pub timestamp_ms: f64,
    /// Number of the frame since the path last began, from 1 on.
    pub sequence: u64,
    /// Time since the row before, ms; 0 where the path begins.
    pub delta_timestamp_ms: f64,
    /// When the picture was taken, ms since midnight (UTC); NaN where that is not known.
    pub alt_timestamp_ms: f64,
}

impl FicTracRow {
    /// The columns in their order.
    pub fn values(&self) -> [f64; COLUMNS] {
        let mut values = [0.0; COLUMNS];
        let mut put = |at: usize, numbers: &[f64]| {
            values[at..][..numbers.len()].copy_from_slice(numbers);
        };
        put(0, &[self.frame as f64]);
        put(1, self.delta_cam.as_slice());
        put(4, &[self.delta_error]);
        put(5, self.delta_lab.as_slice());
        put(8, self.absolute_cam.as_slice());
        put(11, self.absolute_lab.as_slice());
        put(14, &self.position_radii);
        put(
            16,
            &[self.heading_rad, self.direction_rad, self.speed_radii],
        );
        put(19, &self.motion_radii);
        put(21, &[self.timestamp_ms, self.sequence as f64]);
        put(23, &[self.delta_timestamp_ms, self.alt_timestamp_ms]);
        values
    }
}

impl fmt::Display for FicTracRow {
    /// The columns as FicTrac writes them: between them a comma and a space, no header.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, value) in self.values().iter().enumerate() {
            let before = if at == 0 { "" } else { ", " };
            // Zero has no sign.
            write!(f, "{before}{}", value + 0.0)?;
        }
        Ok(())
    }
}

/// The orientation of the last row.
#[derive(Debug, Clone, Copy)]
struct Last {
    time_s: f64,
    orientation: Rotation,
    covariance: Option<Matrix3<f64>>,
}

/// An animal's path so far.
#[derive(Debug, Clone)]
pub struct FicTrac {
    config: FicTracConfig,
    frame: u64,
    sequence: u64,
    /// Frames without an orientation since the last row.
    bad: u64,
    last: Option<Last>,
    position: [f64; 2],
    heading: f64,
    motion: [f64; 2],
}

impl FicTrac {
    /// A path that has not begun.
    pub fn new(config: FicTracConfig) -> Self {
        Self {
            config,
            frame: 0,
            sequence: 0,
            bad: 0,
            last: None,
            position: [0.0; 2],
            heading: 0.0,
            motion: [0.0; 2],
        }
    }

    /// How many frames there were, with an orientation or without.
    pub fn frames(&self) -> u64 {
        self.frame
    }

    /// The next frames have no orientation: so many that were not recognized, or came too fast.
    pub fn miss(&mut self, frames: u64) {
        self.frame += frames;
        let bad = self.bad.saturating_add(frames);
        match self.config.max_bad_frames {
            // So many frames begin it anew, each time.
            Some(most) if bad > most => {
                let left = bad % most.saturating_add(1);
                *self = Self {
                    frame: self.frame,
                    motion: self.motion,
                    sequence: left,
                    bad: left,
                    ..Self::new(self.config)
                };
            }
            _ => {
                self.sequence += frames;
                self.bad = bad;
            }
        }
    }

    /// The row of the next frame, whose orientation is in [`CameraFrame::Optical`] axes; `None` where it has none. `taken_ms` is when its
    /// picture was taken, ms since midnight, where that is known.
    ///
    /// # Errors
    /// [`Error::Argument`] for a frame without a time, or whose time is not later than the last row's.
    pub fn push(
        &mut self,
        row: &OrientationRow,
        taken_ms: Option<f64>,
    ) -> Result<Option<FicTracRow>> {
        let Some(orientation) = row.orientation else {
            self.miss(1);
            return Ok(None);
        };
        self.frame += 1;
        self.sequence += 1;
        let now = Last {
            time_s: row.time_s,
            orientation,
            covariance: row.covariance,
        };
        self.check_time(now.time_s)?;
        let step = self.last.map(|last| FictracStep::new(&last, &now));
        self.bad = 0;
        self.last = Some(now);
        let step = step.unwrap_or_default();
        Ok(Some(self.row(&now, &step, taken_ms)))
    }

    fn check_time(&self, time_s: f64) -> Result<()> {
        let frame = self.frame;
        if !time_s.is_finite() {
            let problem = format!("frame {frame}: expected a time: FicTrac's columns have one");
            return Err(Error::argument("time_s", problem));
        }
        match self.last {
            Some(last) if time_s <= last.time_s => {
                let problem = format!(
                    "frame {frame}: expected a time after {} s, found {time_s}",
                    last.time_s
                );
                Err(Error::argument("time_s", problem))
            }
            _ => Ok(()),
        }
    }

    /// Walks a step; its row.
    fn row(&mut self, now: &Last, step: &FictracStep, taken_ms: Option<f64>) -> FicTracRow {
        let to_lab = self.config.camera_to_lab;
        let delta_lab = to_lab * step.turn;
        let ahead = [delta_lab.y, -delta_lab.x];
        self.walk(ahead, -delta_lab.z);
        FicTracRow {
            frame: self.frame,
            delta_cam: step.turn,
            delta_error: step.error,
            delta_lab,
            absolute_cam: now.orientation.scaled_axis(),
            absolute_lab: (to_lab * now.orientation).scaled_axis(),
            position_radii: self.position,
            heading_rad: self.heading,
            direction_rad: whole_turn(ahead[1].atan2(ahead[0])),
            speed_radii: ahead[0].hypot(ahead[1]),
            motion_radii: self.motion,
            timestamp_ms: 1e3 * now.time_s,
            sequence: self.sequence,
            delta_timestamp_ms: 1e3 * step.interval_s,
            alt_timestamp_ms: taken_ms.unwrap_or(f64::NAN),
        }
    }

    /// A step ahead and to the right while the animal turns clockwise.
    fn walk(&mut self, [ahead, right]: [f64; 2], turned: f64) {
        self.motion[0] += ahead;
        self.motion[1] += right;
        let half = 0.5 * turned;
        // The chord of an arc over its length.
        let chord = if half == 0.0 { 1.0 } else { half.sin() / half };
        let (sin, cos) = (self.heading + half).sin_cos();
        self.position[0] += chord * (cos * ahead - sin * right);
        self.position[1] += chord * (sin * ahead + cos * right);
        self.heading = whole_turn(self.heading + turned);
    }
}

/// What lies between two rows; nothing where a path begins.
#[derive(Debug, Clone, Copy, Default)]
struct FictracStep {
    turn: Vec3,
    error: f64,
    interval_s: f64,
}

impl FictracStep {
    fn new(last: &Last, now: &Last) -> Self {
        let covariances = last.covariance.zip(now.covariance);
        Self {
            turn: (now.orientation * last.orientation.inverse()).scaled_axis(),
            error: covariances.map_or(f64::NAN, |(a, b)| (a + b).trace().sqrt()),
            interval_s: now.time_s - last.time_s,
        }
    }
}

/// An angle in `[0, 2 pi)`.
fn whole_turn(angle: f64) -> f64 {
    let angle = angle.rem_euclid(TAU);
    // What is just below 0 is rounded to a whole turn.
    if angle < TAU { angle } else { 0.0 }
}

/// The rows of a whole file, whatever its axes.
///
/// # Errors
/// Those of [`FicTrac::push`].
pub fn rows(file: &Orientations, config: FicTracConfig) -> Result<Vec<FicTracRow>> {
    let (_, turn) = file
        .camera_frame
        .unwrap_or_default()
        .in_axes(CameraFrame::Optical);
    let mut fictrac = FicTrac::new(config);
    let mut rows = Vec::with_capacity(file.rows.len());
    for row in &file.rows {
        // Of a covariance the trace counts, which no turn changes.
        let optical = OrientationRow {
            orientation: row.orientation.map(|r| turn * r),
            time_s: row.time_s,
            covariance: row.covariance,
            ..OrientationRow::default()
        };
        rows.extend(fictrac.push(&optical, None)?);
    }
    Ok(rows)
}
