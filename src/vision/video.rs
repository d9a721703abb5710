//! Frames of a video, decoded by `ffmpeg`, which must be installed, to 8 bits a color.
//!
//! ffmpeg writes binary PPM pictures ([`PictureStream`]) and a log with the frames' time stamps
//! ([`DecoderLog`]).
//!
//! # Slow motion
//! A phone may store 240 frames a second so that they play at 30. Where the container says at which
//! rate they were taken (`com.android.capture.fps`), the time stamps are scaled by it
//! ([`VideoClock`]); where it does not, nothing in the file tells slow motion from an ordinary
//! video.
//!
//! [`VideoWriter`] writes a video the same way.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use super::input::{InputFrame, SourceTimes, stem};
use super::picture::{Picture, RgbBytes};
use crate::error::{Error, Result};
use crate::files::OutputFile;

/// Rounding of a container's time stamps, seconds, twice.
const TIME_ROUNDING_S: f64 = 2.1e-3;
/// Ratio of the rate of capture to the rate as stored from which on a video is slow motion.
const SLOW_MOTION: f64 = 1.2;

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

/// Passes the frames of a video on; its times are known at its end only.
pub(super) fn read_video(
    path: &Path,
    max_pixels: u64,
    visit: &mut dyn FnMut(InputFrame) -> Result<()>,
) -> Result<SourceTimes> {
    // A name with a colon would be taken for a protocol.
    let mut file = OsString::from("file:");
    file.push(path);
    // Deeper video would come as 16-bit pictures.
    let mut child = Command::new("ffmpeg")
        .args(["-nostdin", "-hide_banner", "-i"])
        .arg(file)
        .args(["-map", "0:v:0", "-vf", "showinfo", "-fps_mode", "passthrough"])
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
    // Both outputs must be read at once: a full pipe would stop the other.
    let log = child.stderr.take();
    let log = std::thread::spawn(move || log.map_or_else(DecoderLog::default, DecoderLog::read));
    let name = stem(path);
    let mut count = 0usize;
    let mut done = Ok(());
    if let Some(out) = child.stdout.take() {
        let mut pictures = PictureStream::new(BufReader::new(out), path, max_pixels);
        done = loop {
            match pictures.next_picture() {
                Ok(None) => break Ok(()),
                Ok(Some(picture)) => {
                    count += 1;
                    let name = format!("{name}_{count:06}");
                    let frame = InputFrame {
                        path: path.with_file_name(&name),
                        name,
                        time_s: None,
                        picture: Ok(picture),
                    };
                    if let Err(e) = visit(frame) {
                        break Err(e);
                    }
                }
                Err(e) => break Err(e),
            }
        };
    }
    if done.is_err() {
        // The reader has given up, so that the decoder has nobody to write to.
        let _ = child.kill();
    }
    let status = child.wait().map_err(|e| Error::read(path, e))?;
    let log = log.join().unwrap_or_default();
    done?;
    if count == 0 {
        let problem = format!("ffmpeg finds no video in it: {}", log.last);
        return Err(Error::input(path, "video", problem));
    }
    let mut log = log;
    log.compare_with_duration();
    let mut times_s = log.times;
    times_s.resize(count, None);
    let clock = VideoClock::new(&times_s, log.capture_fps);
    if let Some(scale) = clock.map(|c| c.time_scale()) {
        let times = times_s.iter_mut().flatten();
        times.for_each(|t| *t *= scale);
    }
    Ok(SourceTimes {
        times_s,
        clock,
        cut_short: match status.success() {
            true => log.damage,
            false => Some(log.damage.unwrap_or(log.last)),
        },
    })
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
        let mut log = Self::default();
        // Metadata may be in any encoding.
        let lines = BufReader::new(from).split(b'\n').map_while(|l| l.ok());
        for bytes in lines {
            let line = String::from_utf8_lossy(&bytes).into_owned();
            if let Some((_, rest)) = line.split_once("pts_time:") {
                let time = rest.split_whitespace().next();
                let time = time.and_then(|t| t.parse().ok());
                log.times.push(time.filter(|t: &f64| t.is_finite()));
            } else if let Some((_, rest)) = line.split_once("com.android.capture.fps") {
                let rate = rest.trim_start_matches([' ', ':']).trim().parse().ok();
                log.capture_fps = rate.filter(|r: &f64| *r > 0.0 && r.is_finite());
            } else if let Some((_, rest)) = line.split_once("Duration: ") {
                log.duration_s = rest.split(',').next().and_then(seconds);
            } else if !line.trim().is_empty() {
                if log.damage.is_none() && is_damage(&line) {
                    log.damage = Some(line.clone());
                }
                log.last = line;
            }
        }
        log
    }

    /// Compares the times of the frames with the duration that the container states: where they end early, that is damage.
    pub fn compare_with_duration(&mut self) {
        let (Some(duration), None) = (self.duration_s, &self.damage) else {
            return;
        };
        let mut known = self.times.iter().flatten();
        let (Some(first), Some(last)) = (known.next(), known.next_back()) else {
            return;
        };
        let steps = self.times.len().saturating_sub(1).max(1) as f64;
        let step = (last - first) / steps;
        let missing = duration - (last - first) - step;
        if missing > MISSING.0 * duration && missing > MISSING.1 * step {
            self.damage = Some(format!(
                "it states {duration:.2} s, and its pictures end after {:.2} s",
                last - first + step
            ));
        }
    }
}

/// Whether a line tells of damage: a decoder's or a container's, and not what they print of the file.
fn is_damage(line: &str) -> bool {
    let is_of_part = line.starts_with('[') || line.starts_with("Error");
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

/// A stream of binary PPM pictures.
#[derive(Debug)]
pub struct PictureStream<R> {
    input: R,
    /// The video, for messages.
    path: PathBuf,
    max_pixels: u64,
}

impl<R: BufRead> PictureStream<R> {
    /// The pictures in `input`, of up to `max_pixels` pixels each; `path` names the video in errors.
    pub fn new(input: R, path: &Path, max_pixels: u64) -> Self {
        Self {
            input,
            path: path.to_path_buf(),
            max_pixels,
        }
    }

    /// The next picture; `None` at the stream's end.
    ///
    /// # Errors
    /// [`Error::Input`] for a picture that is none, is too large or ends early.
    pub fn next_picture(&mut self) -> Result<Option<Picture>> {
        let reject = |problem: String| Error::input(&self.path, "video", problem);
        let broken = |what: &str| reject(format!("ffmpeg's output ends early: {what}"));
        let from = &mut self.input;
        let mut header = [0usize; 3];
        match token(from).as_deref() {
            None => return Ok(None),
            Some("P6") => {}
            Some(_) => return Err(broken("no picture")),
        }
        for number in &mut header {
            let text = token(from).ok_or_else(|| broken("no size"))?;
            *number = text.parse().map_err(|_| broken("no size"))?;
        }
        let [width, height, max_value] = header;
        let max_pixels = self.max_pixels;
        if (width as u64).saturating_mul(height as u64) > max_pixels {
            return Err(reject(format!(
                "expected at most {max_pixels} pixels, found {width} x {height} (--max-pixels allows more)"
            )));
        }
        if max_value != 255 {
            return Err(broken("a depth that is not expected"));
        }
        let mut bytes = vec![0u8; width * height * 3];
        from.read_exact(&mut bytes)
            .map_err(|_| broken("half a picture"))?;
        let picture = RgbBytes::new(width, height, bytes).map_err(|e| reject(e.to_string()))?;
        Ok(Some(Picture::Bytes(picture)))
    }
}

/// A word of a PPM header and the white space after it.
fn token(from: &mut impl Read) -> Option<String> {
    let mut word = String::new();
    let mut byte = [0u8];
    while from.read_exact(&mut byte).is_ok() {
        if byte[0].is_ascii_whitespace() {
            if !word.is_empty() {
                break;
            }
        } else if word.len() < 20 {
            word.push(char::from(byte[0]));
        }
    }
    (!word.is_empty()).then_some(word)
}

/// Encoders of videos that any player shows, the best first.
const ENCODERS: [&str; 3] = ["libx264", "libopenh264", "mpeg4"];

/// A video to be written by ffmpeg. It appears complete, at [`VideoEncoding::finish`], or not at all.
pub struct VideoWriter {
    path: PathBuf,
    output: OutputFile,
    encoder: &'static str,
}

/// A video that is being written.
pub struct VideoEncoding {
    path: PathBuf,
    output: OutputFile,
    /// Where ffmpeg writes: an MP4 file's head is filled in at its end.
    folder: tempfile::TempDir,
    child: Child,
}

impl VideoWriter {
    /// Checks that ffmpeg is there and that `path` can be written, before the work.
    ///
    /// # Errors
    /// [`Error::Input`] without ffmpeg or an encoder of its, [`Error::Write`] where the path cannot be
    /// written.
    pub fn new(path: &Path) -> Result<Self> {
        let reject = |problem: String| Error::input(path, "video", problem);
        let found = Command::new("ffmpeg")
            .args(["-hide_banner", "-encoders"])
            .stdin(Stdio::null())
            .output()
            .map_err(|e| {
                reject(format!(
                    "a video is written through ffmpeg, which cannot be started ({e}): install it (https://ffmpeg.org), or name a folder"
                ))
            })?;
        let names = String::from_utf8_lossy(&found.stdout).into_owned();
        let has = |encoder: &&str| names.split_whitespace().any(|word| word == *encoder);
        let encoder = ENCODERS.into_iter().find(has).ok_or_else(|| {
            let expected = ENCODERS.join(", ");
            reject(format!(
                "expected an ffmpeg with one of the encoders {expected}"
            ))
        })?;
        Ok(Self {
            path: path.to_path_buf(),
            output: OutputFile::create(path)?,
            encoder,
        })
    }

    /// Begins a video of frames of this size at so many frames a second.
    ///
    /// # Errors
    /// [`Error::Write`] where ffmpeg cannot be started or there is no place for its file.
    pub fn begin(self, (width, height): (u32, u32), fps: f64) -> Result<VideoEncoding> {
        let failed = |e: std::io::Error| Error::write(&self.path, e);
        let folder = tempfile::tempdir().map_err(failed)?;
        let child = Command::new("ffmpeg")
            .args(["-y", "-hide_banner", "-loglevel", "error"])
            .args(["-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &format!("{width}x{height}"), "-r", &fps.to_string()])
            .args(["-i", "-", "-an", "-c:v", self.encoder])
            // Half as many colors as pixels need even sides.
            .args([
                "-vf",
                "pad=ceil(iw/2)*2:ceil(ih/2)*2",
                "-pix_fmt",
                "yuv420p",
            ])
            .args(["-movflags", "+faststart", "-f", "mp4"])
            .arg(folder.path().join(VIDEO))
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(failed)?;
        Ok(VideoEncoding {
            path: self.path,
            output: self.output,
            folder,
            child,
        })
    }
}

/// The name of ffmpeg's file.
const VIDEO: &str = "video.mp4";

impl VideoEncoding {
    /// Appends a frame: red, green, blue, row after row.
    ///
    /// # Errors
    /// [`Error::Write`] where ffmpeg gives up.
    pub fn write(&mut self, pixels: &[u8]) -> Result<()> {
        let input = self.child.stdin.as_mut();
        let written = input.map_or(Ok(()), |input| input.write_all(pixels));
        written.map_err(|e| {
            // It has ended: what it says of that is more than "broken pipe".
            let mut words = String::new();
            if let Some(log) = self.child.stderr.as_mut() {
                let _ = log.read_to_string(&mut words);
            }
            self.error(&words, e.to_string())
        })
    }

    /// Ends the video.
    ///
    /// # Errors
    /// [`Error::Write`] where ffmpeg or the system refuses.
    pub fn finish(mut self) -> Result<()> {
        drop(self.child.stdin.take());
        let mut words = String::new();
        if let Some(mut log) = self.child.stderr.take() {
            let _ = log.read_to_string(&mut words);
        }
        let ended = self.child.wait();
        let status = ended.map_err(|e| Error::write(&self.path, e))?;
        if !status.success() {
            return Err(self.error(&words, status.to_string()));
        }
        let mut video = std::fs::File::open(self.folder.path().join(VIDEO))
            .map_err(|e| Error::write(&self.path, e))?;
        std::io::copy(&mut video, &mut self.output).map_err(|e| Error::write(&self.path, e))?;
        self.output.finish()
    }

    fn error(&self, words: &str, or: String) -> Error {
        let last = words.lines().rfind(|line| !line.trim().is_empty());
        let problem = format!("ffmpeg: {}", last.unwrap_or(&or).trim());
        Error::write(&self.path, std::io::Error::other(problem))
    }
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
    }

    #[test]
    fn damage_is_told_though_ffmpeg_ends_as_if_nothing_were() {
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
