//! Frames of a video, decoded by `ffmpeg`, which must be installed, to 8 bits a color.
//!
//! ffmpeg writes binary PPM pictures, as any pipe, and a log with the frames' time stamps ([`DecoderLog`]).
//!
//! # Slow motion
//! A phone may store 240 frames a second so that they play at 30. Where the container says at which
//! rate they were taken (`com.android.capture.fps`), the time stamps are to be scaled by it
//! ([`VideoClock`], known at the end); where it does not, nothing in the file distinguishes slow motion
//! from an ordinary video.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::{OnceLock, mpsc};
use std::thread::JoinHandle;

use super::pipe::{PipeFormat, PipeReader};
use super::{Frame, FrameSource, SourceEnd, stem};
use crate::error::{Error, Result};

/// Rounding of a container's time stamps, seconds, twice.
const TIME_ROUNDING_S: f64 = 2.1e-3;
/// Ratio of the rate of capture to the rate as stored from which on a video is slow motion.
const SLOW_MOTION: f64 = 1.2;

/// Endings of raw streams, whose frames have no times: what ffmpeg logs of them is its guess.
const RAW_STREAMS: [&str; 11] = [
    "h264", "264", "h265", "265", "hevc", "mjpeg", "mjpg", "m1v", "m2v", "obu", "av1",
];

/// The option that leaves the frames as they are: `-fps_mode` from ffmpeg 5.1 on, before it `-vsync`, which went with 9.
fn passthrough() -> &'static str {
    static OPTION: OnceLock<&str> = OnceLock::new();
    OPTION.get_or_init(|| {
        let said = Command::new("ffmpeg")
            .arg("-version")
            .stdin(Stdio::null())
            .output();
        let said = said.map(|output| String::from_utf8_lossy(&output.stdout).into_owned());
        option_of(&said.unwrap_or_default())
    })
}

/// The option by what `ffmpeg -version` prints; one that names no release is newer than all.
fn option_of(version: &str) -> &'static str {
    let words = version.strip_prefix("ffmpeg version ").unwrap_or_default();
    let mut numbers = words
        .trim_start_matches('n')
        .split(['.', '-', ' '])
        .map(str::parse::<u32>);
    let mut next = || numbers.next().and_then(|number| number.ok());
    match (next(), next()) {
        (Some(major), minor) if (major, minor.unwrap_or(0)) < (5, 1) => "-vsync",
        _ => "-fps_mode",
    }
}

/// What a container says of its frames' times.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct VideoClock {
    /// Mean frames per second by the time stamps as stored.
    pub stored_fps: f64,
    /// Whether the intervals differ by more than the rounding of time stamps.
    pub is_variable: bool,
    /// Frames per second at which the camera took them, where the container says that they are
    /// stored for slow motion; the times are scaled by it.
    pub capture_fps: Option<f64>,
}

impl VideoClock {
    /// The clock behind these stored times, seconds; `None` where one is missing or none passes.
    pub fn new(stored_s: &[Option<f64>], capture_fps: Option<f64>) -> Option<Self> {
        let times: Vec<f64> = stored_s.iter().copied().collect::<Option<_>>()?;
        let duration = times.last()? - times.first()?;
        let intervals = times.windows(2).map(|w| w[1] - w[0]);
        let (low, high) = intervals.fold((f64::INFINITY, 0f64), |(low, high), t| {
            (low.min(t), high.max(t))
        });
        if duration.is_nan() || duration <= 0.0 {
            return None;
        }
        let stored_fps = (times.len() - 1) as f64 / duration;
        Some(Self {
            stored_fps,
            // Containers round to a millisecond at the coarsest.
            is_variable: high - low > TIME_ROUNDING_S,
            capture_fps: capture_fps.filter(|c| *c > SLOW_MOTION * stored_fps),
        })
    }

    /// Seconds of the ball's motion in a second of the video.
    pub fn time_scale(&self) -> f64 {
        self.capture_fps.map_or(1.0, |c| self.stored_fps / c)
    }
}

/// The frames of a video.
#[derive(Debug)]
pub struct VideoSource {
    path: PathBuf,
    child: Child,
    pictures: PipeReader<BufReader<ChildStdout>>,
    /// The time stamps that the log has, one a frame.
    stamps: mpsc::Receiver<Option<f64>>,
    log: Option<JoinHandle<DecoderLog>>,
    times_s: Vec<Option<f64>>,
    is_raw: bool,
    end: SourceEnd,
}

impl VideoSource {
    /// Starts to decode a video, into pictures of up to `max_pixels` pixels.
    ///
    /// # Errors
    /// [`Error::Input`] where ffmpeg cannot be started.
    pub fn open(path: &Path, max_pixels: u64) -> Result<Self> {
        // A name with a colon would be taken for a protocol.
        let mut file = OsString::from("file:");
        file.push(path);
        // Deeper video would come as 16-bit pictures.
        let mut child = Command::new("ffmpeg")
            .args(["-nostdin", "-hide_banner", "-i"])
            .arg(file)
            .args(["-map", "0:v:0", "-vf", "showinfo", passthrough(), "passthrough"])
            .args(["-f", "image2pipe", "-c:v", "ppm", "-pix_fmt", "rgb24", "-"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|e| {
                let problem = format!(
                    "a video is read through ffmpeg, which cannot be started ({e}): install it (https://ffmpeg.org), or give a folder of images"
                );
                Error::input(path, "video", problem)
            })?;
        let (Some(out), Some(words)) = (child.stdout.take(), child.stderr.take()) else {
            return Err(Error::Internal("ffmpeg has no output".into()));
        };
        // Both outputs must be read at once: a full pipe would stop the other.
        let (sender, stamps) = mpsc::channel();
        let read_log = move || {
            // The source may be gone before the log ends.
            DecoderLog::read_with(words, |stamp| {
                let _ = sender.send(stamp);
            })
        };
        let out = BufReader::new(out);
        Ok(Self {
            path: path.to_path_buf(),
            child,
            pictures: PipeReader::new(out, path, PipeFormat::Images, max_pixels)?,
            stamps,
            log: Some(std::thread::spawn(read_log)),
            times_s: Vec::new(),
            is_raw: {
                let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
                ending.is_some_and(|e| RAW_STREAMS.contains(&e.as_str()))
            },
            end: SourceEnd::default(),
        })
    }

    /// Hears how ffmpeg ends after its last picture.
    fn finish(&mut self) -> Result<()> {
        let Some(log) = self.log.take() else {
            return Ok(());
        };
        let status = self.child.wait();
        let status = status.map_err(|e| Error::read(&self.path, e))?;
        let mut log = log.join().unwrap_or_default();
        if self.times_s.is_empty() {
            // One that the system ends says nothing itself.
            let why = match log.last.is_empty() {
                true => format!("it ended with {status}"),
                false => log.last,
            };
            let problem = format!("ffmpeg finds no video in it: {why}");
            return Err(Error::input(&self.path, "video", problem));
        }
        log.compare_with_duration();
        self.end = SourceEnd {
            clock: VideoClock::new(&self.times_s, log.capture_fps),
            cut_short: match status.success() {
                true => log.damage,
                false => Some(log.damage.unwrap_or(log.last)),
            },
            is_stated: false,
        };
        Ok(())
    }
}

impl FrameSource for VideoSource {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<bool> {
        if !self.pictures.next_frame(frame)? {
            self.finish()?;
            return Ok(false);
        }
        // ffmpeg logs a frame before it writes it.
        let stamp = self.stamps.recv().ok().flatten();
        frame.time_s = stamp.filter(|_| !self.is_raw);
        self.times_s.push(frame.time_s);
        frame.name = format!("{}_{:06}", stem(&self.path), self.times_s.len());
        frame.path = self.path.with_file_name(&frame.name);
        Ok(true)
    }

    fn end(&self) -> SourceEnd {
        self.end.clone()
    }
}

impl Drop for VideoSource {
    fn drop(&mut self) {
        // Who gives up before the end leaves a decoder that has nobody to write to.
        if self.log.is_some() {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

/// What ffmpeg logs.
#[derive(Debug, Default)]
pub struct DecoderLog {
    /// The time stamp of each frame, seconds.
    pub times: Vec<Option<f64>>,
    /// The rate of capture by the container's metadata, frames per second.
    pub capture_fps: Option<f64>,
    /// How long the container says that the video is, seconds.
    pub duration_s: Option<f64>,
    /// When it says that it starts, seconds.
    pub start_s: f64,
    /// Whether there is sound, which may be longer than the pictures.
    pub has_sound: bool,
    /// Why some of its frames are missing, where some are: ffmpeg goes on after damage, and ends as if nothing were.
    pub damage: Option<String>,
    /// The last line that says anything else.
    pub last: String,
}

/// What a decoder says of damage, lower case.
const DAMAGE: [&str; 6] = [
    "error",
    "invalid",
    "corrupt",
    "prematurely",
    "concealing",
    "missing picture",
];
/// Part of the stated duration that may be missing at its end, and steps between frames: streams of sound are longer.
const MISSING: (f64, f64) = (0.05, 2.5);

impl DecoderLog {
    /// Reads a log to its end.
    pub fn read(from: impl Read) -> Self {
        Self::read_with(from, |_| ())
    }

    /// As [`DecoderLog::read`]; hands on the time stamp of each frame at once.
    fn read_with(from: impl Read, mut hand_on: impl FnMut(Option<f64>)) -> Self {
        let mut log = Self::default();
        // Metadata may be in any encoding.
        let lines = BufReader::new(from).split(b'\n').map_while(|l| l.ok());
        for bytes in lines {
            let line = String::from_utf8_lossy(&bytes).into_owned();
            if log.damage.is_none() {
                log.damage = damage_in(&line).map(str::to_owned);
            }
            if let Some((_, rest)) = line.split_once("pts_time:") {
                let time = rest.split_whitespace().next();
                let time = time.and_then(|t| t.parse().ok());
                let time = time.filter(|t: &f64| t.is_finite());
                log.times.push(time);
                hand_on(time);
            } else if let Some((_, rest)) = line.split_once("com.android.capture.fps") {
                let rate = rest.trim_start_matches([' ', ':']).trim().parse().ok();
                log.capture_fps = rate.filter(|r: &f64| *r > 0.0 && r.is_finite());
            } else if let Some((_, rest)) = line.split_once("Duration: ") {
                let mut parts = rest.split(',');
                log.duration_s = parts.next().and_then(seconds);
                let start =
                    parts.find_map(|part| part.trim().strip_prefix("start: ")?.parse().ok());
                log.start_s = start.filter(|s: &f64| s.is_finite()).unwrap_or(0.0);
            } else if line.trim_start().starts_with("Stream #") && line.contains(" Audio: ") {
                log.has_sound = true;
            } else if !line.trim().is_empty() {
                log.last = line;
            }
        }
        log
    }

    /// Compares the times of the frames with the duration that the container states: where they end early, that is damage.
    /// With sound beside them it is not known when they should end.
    pub fn compare_with_duration(&mut self) {
        let (Some(duration), None, false) = (self.duration_s, &self.damage, self.has_sound) else {
            return;
        };
        let mut known = self.times.iter().flatten();
        let (Some(first), Some(last)) = (known.next(), known.next_back()) else {
            return;
        };
        let steps = self.times.len().saturating_sub(1).max(1) as f64;
        let step = (last - first) / steps;
        // Pictures may begin late; ffmpeg takes the container's start off their times, and not off its duration.
        let missing = duration - self.start_s.max(0.0) - last.max(last - first) - step;
        if missing > MISSING.0 * duration && missing > MISSING.1 * step {
            self.damage = Some(format!(
                "it states {duration:.2} s, and its pictures end after {:.2} s",
                last - first + step
            ));
        }
    }
}

/// What a line says of damage. A frame is described in pieces, and what another thread says may stand among them.
fn damage_in(line: &str) -> Option<&str> {
    let tags = line
        .match_indices(" @ 0x")
        .filter_map(|(at, _)| line[..at].rfind('['));
    let mut begins = vec![0];
    begins.extend(tags.filter(|begin| *begin > 0));
    let ends = begins[1..].iter().copied().chain([line.len()]);
    let mut parts = begins
        .iter()
        .zip(ends)
        .map(|(begin, end)| &line[*begin..end]);
    parts.find(|part| is_damage(part)).map(str::trim_end)
}

/// Whether a line reports damage: a decoder's or a container's, and not what they print of the file.
fn is_damage(line: &str) -> bool {
    // What writes the pictures complains of the times of raw streams, and loses none.
    let is_of_part =
        line.starts_with('[') && !line.starts_with("[image2pipe") || line.starts_with("Error");
    let words = line.to_lowercase();
    is_of_part && DAMAGE.iter().any(|word| words.contains(word))
}

/// `HH:MM:SS.cc` in seconds.
fn seconds(text: &str) -> Option<f64> {
    let mut parts = text.trim().rsplit(':').map(|part| part.parse::<f64>().ok());
    let (s, m, h) = (parts.next()??, parts.next()??, parts.next()??);
    let total = s + 60.0 * m + 3600.0 * h;
    (total > 0.0 && total.is_finite()).then_some(total)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What ffmpeg 7 logs of a video of `count` frames at 30 Hz that states two seconds.
    fn log(count: usize, words: &str) -> DecoderLog {
        let mut text = String::from(
            "Input #0, matroska,webm, from 'file:error.mkv':\n  Metadata:\n    title : corrupt\n  \
             Duration: 00:00:02.00, start: 0.000000, bitrate: 723 kb/s\n",
        );
        for k in 0..count {
            let time = k as f64 / 30.0;
            text += &format!(
                "[Parsed_showinfo_0 @ 0x55] n: {k} pts: {k} pts_time:{time} duration: 1\n"
            );
        }
        let mut log = DecoderLog::read(text.as_bytes().chain(words.as_bytes()));
        log.compare_with_duration();
        log
    }

    #[test]
    fn a_whole_video_is_not_damaged() {
        assert_eq!(log(60, "").duration_s, Some(2.0));
        // The sound may end a little later.
        for count in [60, 59, 58] {
            assert_eq!(log(count, "").damage, None, "{count}");
        }
        assert_eq!(log(1, "").damage, None);
        let raw = "[image2pipe @ 0x56497fa8d200] Application provided invalid, non monotonically increasing dts to muxer in stream 0: 0 >= 0\n";
        assert_eq!(log(60, raw).damage, None);
        // Two threads that speak at once.
        let both = "[Parsed_showinfo_0 @ 0x5] n: 7 pts: 70 pts_time:0.07 [h264 @ 0x6] error while decoding MB 3 2\n mean:[128]\n";
        let of_decoder = "[h264 @ 0x6] error while decoding MB 3 2";
        assert_eq!(log(60, both).damage.as_deref(), Some(of_decoder));
        // Nor is one whose sound is longer, or whose pictures begin late.
        let sound =
            "  Stream #0:1[0x2](und): Audio: aac (LC), 44100 Hz, mono, fltp, 69 kb/s (default)\n";
        assert_eq!(log(30, sound).damage, None);
        let mut late = DecoderLog {
            duration_s: Some(2.0),
            times: (30..60).map(|k| Some(f64::from(k) / 30.0)).collect(),
            ..DecoderLog::default()
        };
        late.compare_with_duration();
        assert_eq!(late.damage, None);
    }

    #[test]
    fn the_option_is_that_of_the_release() {
        for (version, option) in [
            (
                "ffmpeg version 4.2.7-0ubuntu0.1 Copyright (c) 2000-2022",
                "-vsync",
            ),
            ("ffmpeg version 5.0.1 Copyright", "-vsync"),
            ("ffmpeg version n4.4.2 Copyright", "-vsync"),
            ("ffmpeg version 5.1.6-0+deb12u1 Copyright", "-fps_mode"),
            ("ffmpeg version 7.1 Copyright", "-fps_mode"),
            ("ffmpeg version 9.0", "-fps_mode"),
            ("ffmpeg version N-112233-gabcdef0123 Copyright", "-fps_mode"),
            ("", "-fps_mode"),
        ] {
            assert_eq!(option_of(version), option, "{version}");
        }
    }

    #[test]
    fn damage_is_reported_though_ffmpeg_ends_as_if_nothing_were() {
        for line in [
            "[in#0/matroska,webm @ 0x562015742100] File ended prematurely",
            "[h264 @ 0x564310494ec0] error while decoding MB 0 1, bytestream 26247",
            "[dec:h264 @ 0x56431042fb80] corrupt decoded frame",
            "[h264 @ 0x55c0030cb280] Invalid NAL unit size (0 > 16).",
        ] {
            assert_eq!(log(60, line).damage.as_deref(), Some(line));
        }
        let ends = log(30, "").damage;
        let expected = "it states 2.00 s, and its pictures end after 1.00 s";
        assert_eq!(ends.as_deref(), Some(expected));
    }
}
