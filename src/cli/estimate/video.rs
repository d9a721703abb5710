//! Videos, written through `ffmpeg`.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::error::{Error, Result};
use crate::files::OutputFile;

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
