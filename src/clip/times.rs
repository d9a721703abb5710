//! The times of a clip's frames: by their names, a video, a rate or a table.

use std::path::PathBuf;

use super::batch::BatchFrame;
use super::config::FrameClock;
use crate::error::{Error, Result};
use crate::source::video::VideoClock;
use crate::spin::robust::{SpinConfig, TimeOrigin};

/// Where the times of a batch came from.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case", tag = "source")]
pub enum TimeSource {
    /// No frame has a time.
    None,
    /// Some frames have a time by their names, others not.
    Partial {
        /// How many have one.
        timed: usize,
    },
    /// The names are numbers, but so near to each other that they count frames or a longer unit: they
    /// are no times.
    FrameNumbers {
        /// The median step of the names, taken as nanoseconds, in seconds.
        step_s: f64,
    },
    /// The names are one and the same number: they are no times.
    SameNumber,
    /// The names of the files, in nanoseconds.
    Names {
        /// Mean frames per second; none of a single frame.
        fps: Option<f64>,
    },
    /// A rate that was given.
    Rate {
        /// Frames per second.
        fps: f64,
    },
    /// A table.
    Table,
    /// They were stated with the frames.
    Stated,
    /// The time stamps of a video.
    Video(VideoClock),
}

impl TimeSource {
    /// The settings of a spin by these times.
    pub fn of_spin(&self, config: SpinConfig) -> SpinConfig {
        let times = match self {
            Self::Video(_) => TimeOrigin::Video,
            _ => TimeOrigin::Stated,
        };
        SpinConfig { times, ..config }
    }

    /// Why the numbers in the frames' names are no times, where they are none.
    pub fn problem(&self) -> Option<&'static str> {
        match self {
            Self::FrameNumbers { .. } => {
                Some("the names are frame numbers, not times in nanoseconds")
            }
            Self::SameNumber => Some("the names are one and the same number, and no times"),
            _ => None,
        }
    }
}

/// Sets the times of all frames, unless all were stated with them; where they come from.
pub(super) fn set_times(
    clock: &FrameClock,
    (video, is_stated): (Option<VideoClock>, bool),
    frames: &mut [BatchFrame],
) -> Result<TimeSource> {
    match clock {
        FrameClock::Inputs if is_stated => Ok(TimeSource::Stated),
        FrameClock::Inputs => Ok(input_times(video, frames)),
        FrameClock::FramesPerSecond(rate) => {
            for (k, frame) in frames.iter_mut().enumerate() {
                frame.time_s = Some(k as f64 / rate);
            }
            Ok(TimeSource::Rate { fps: *rate })
        }
        FrameClock::Ordered(path, times_s) => {
            if times_s.len() != frames.len() {
                let problem = format!(
                    "expected the times of {} frames, found {}",
                    frames.len(),
                    times_s.len()
                );
                return Err(Error::input(path, "file", problem));
            }
            for (frame, time) in frames.iter_mut().zip(times_s) {
                frame.time_s = Some(*time);
            }
            Ok(TimeSource::Table)
        }
        FrameClock::Table(table) => {
            let paths: Vec<PathBuf> = frames.iter().map(|f| f.path.clone()).collect();
            for (frame, time) in frames.iter_mut().zip(table.of_frames(&paths)?) {
                frame.time_s = Some(time);
            }
            Ok(TimeSource::Table)
        }
    }
}

/// What the inputs say of the times; names that count frames, or are all alike, are no times.
fn input_times(video: Option<VideoClock>, frames: &mut [BatchFrame]) -> TimeSource {
    if let Some(clock) = video {
        return TimeSource::Video(clock);
    }
    let times: Vec<f64> = frames.iter().filter_map(|f| f.time_s).collect();
    let timed = times.len();
    match timed {
        0 => return TimeSource::None,
        _ if timed < frames.len() => return TimeSource::Partial { timed },
        1 => return TimeSource::Names { fps: None },
        _ => {}
    }
    let steps = times
        .windows(2)
        .map(|w| (1e9 * (w[1] - w[0]).abs()).round() as u64);
    let first = times.iter().copied().fold(f64::INFINITY, f64::min);
    let last = times.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let problem = match crate::files::frame_number_step(steps.collect()) {
        _ if first == last => TimeSource::SameNumber,
        Some(step_ns) => TimeSource::FrameNumbers {
            step_s: 1e-9 * step_ns as f64,
        },
        None => {
            let fps = Some((timed - 1) as f64 / (last - first));
            return TimeSource::Names { fps };
        }
    };
    frames.iter_mut().for_each(|f| f.time_s = None);
    problem
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Five frames in 40 ms: four steps of 10 ms.
    #[test]
    fn a_rate_is_that_of_the_steps() {
        let frame = |k: u32| BatchFrame {
            name: k.to_string(),
            path: PathBuf::new(),
            time_s: Some(7.0 + 0.01 * f64::from(k)),
            first_row_s: None,
            balls: Vec::new(),
            size: None,
            unreadable: None,
            kept: (),
        };
        let mut frames: Vec<BatchFrame> = (0..5).map(frame).collect();
        let source = set_times(&FrameClock::Inputs, (None, false), &mut frames);
        let Ok(TimeSource::Names { fps: Some(fps) }) = source else {
            panic!("{source:?}");
        };
        assert!((fps - 100.0).abs() < 1e-6, "{fps}");
    }
}
