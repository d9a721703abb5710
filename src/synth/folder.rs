//! Frames and their truth as files: for training, for tests, for other people's detectors.
//!
//! A folder holds
//! - `images/*.png`;
//! - `masks/*.png` where asked for: white where the ball is seen;
//! - `index.csv`, as the SpinDOE authors' reader (`DotDataset`) takes it: no header; the image's
//!   path from the folder, the orientation as a quaternion `w, x, y, z` (their regression's order;
//!   pattern to view frame), then from the sixth column on the pixel positions `u0, v0, u1, v1,
//!   ...` of the dots that a detector should find, so that rows differ in length. That reader fails
//!   on rows without dots, so such frames are in the truth only;
//! - `truth.json`: the full truth of every frame ([`FrameTruth`]), with the seed, the configuration
//!   and the pattern; where a frame shows several images of balls, `balls` has the truth of each
//!   ([`BallTruth`](super::dataset::BallTruth)), and all else is that of the first;
//! - `orientations.csv` for a sequence, as `spindoe spin` reads it, pattern to camera frame; the
//!   images' names are nanoseconds then;
//! - `contact_sheet.png`: the first frames side by side.
//!
//! The index is written last: a folder with an index is complete.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::config::SynthConfig;
use super::dataset::{ClipConfig, FrameTruth, SynthFrame};
use super::several::StrobeConfig;
use crate::concurrency;
use crate::error::{Result, require};
use crate::files;
use crate::image::RgbImage;

/// Version of the format of `truth.json`.
pub const FORMAT_VERSION: u32 = 2;
/// Frames drawn between two reports of progress.
const CHUNK: usize = 64;
/// Frames on the contact sheet.
const SHOWN: usize = 36;
/// Side of a frame on the contact sheet, pixels.
const CELL: usize = 160;
/// Gap between frames on the contact sheet, pixels.
const GAP: usize = 4;

/// What all frames of a folder have in common.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    /// Seed of the set.
    pub seed: u64,
    /// The pattern's digest ([`crate::pattern::Pattern::sha256`]).
    pub pattern_sha256: String,
    /// The pattern: unit vectors, in order of index.
    pub pattern: Vec<[f64; 3]>,
    /// The ranges from which frames were drawn.
    pub config: SynthConfig,
    /// For a sequence, how it was taken.
    pub sequence: Option<ClipConfig>,
    /// The flashes of each image, where there are several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strobe: Option<StrobeConfig>,
}

/// The content of `truth.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// [`FORMAT_VERSION`].
    pub format_version: u32,
    /// The frames' origin.
    #[serde(flatten)]
    pub origin: Origin,
    /// The frames.
    pub frames: Vec<FrameTruth>,
}

/// Whether masks are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Masks {
    /// No masks.
    #[default]
    Omit,
    /// A mask for each frame.
    Write,
}

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Written {
    /// Frames.
    pub frames: usize,
    /// Of these, frames without any dot to be found: they are not in the index.
    pub without_dots: usize,
    /// Dots that a detector should find, over all frames.
    pub visible_dots: usize,
}

/// Draws `count` frames and writes them to `dir`; each file is written atomically. `progress`
/// learns how many are done.
///
/// # Errors
/// [`crate::Error::Write`] where the system refuses, or the error of `draw`.
pub fn write(
    dir: &Path,
    origin: Origin,
    count: usize,
    masks: Masks,
    draw: impl Fn(usize) -> Result<SynthFrame> + Sync,
    mut progress: impl FnMut(usize),
) -> Result<Written> {
    let images = dir.join("images");
    files::create_dir(&images)?;
    let mask_dir = dir.join("masks");
    if masks == Masks::Write {
        files::create_dir(&mask_dir)?;
    }
    let mut frames = Vec::with_capacity(count);
    let mut shown = Vec::new();
    for start in (0..count).step_by(CHUNK) {
        let chunk = start as u64..count.min(start + CHUNK) as u64;
        let chunk = concurrency::map_range(chunk, |k| -> Result<SynthFrame> {
            let frame = draw(k as usize)?;
            frame.image.write_png(&images.join(&frame.truth.image))?;
            if masks == Masks::Write {
                mask_image(&frame)?.write_png(&mask_dir.join(&frame.truth.image))?;
            }
            Ok(frame)
        });
        for frame in chunk {
            let frame = frame?;
            if shown.len() < SHOWN {
                shown.push(frame.image);
            }
            frames.push(frame.truth);
        }
        progress(frames.len());
    }
    if !shown.is_empty() {
        contact_sheet(&shown, CELL)?.write_png(&dir.join("contact_sheet.png"))?;
    }
    let is_sequence = origin.sequence.is_some();
    let truth = Truth {
        format_version: FORMAT_VERSION,
        origin,
        frames,
    };
    files::write_atomic(&dir.join("truth.json"), |file| {
        let mut out = std::io::BufWriter::new(file);
        serde_json::to_writer(&mut out, &truth)?;
        out.flush()
    })?;
    if is_sequence {
        let text = orientations(&truth.frames);
        files::write_bytes(&dir.join("orientations.csv"), text.as_bytes())?;
    }
    let index = index(&truth.frames);
    files::write_bytes(&dir.join("index.csv"), index.as_bytes())?;
    Ok(summary(&truth.frames))
}

fn mask_image(frame: &SynthFrame) -> Result<RgbImage> {
    let values = frame.mask.iter().map(|m| [f32::from(*m) / 255.0; 3]);
    RgbImage::new(frame.image.width(), frame.image.height(), values.collect())
}

fn visible(frame: &FrameTruth) -> usize {
    frame.dots.iter().filter(|d| d.visible).count()
}

fn summary(frames: &[FrameTruth]) -> Written {
    Written {
        frames: frames.len(),
        without_dots: frames.iter().filter(|f| visible(f) == 0).count(),
        visible_dots: frames.iter().map(visible).sum(),
    }
}

/// The truth as an orientations file. (Writing to a string does not fail.)
fn orientations(frames: &[FrameTruth]) -> String {
    let mut text = "frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence\n".to_owned();
    for frame in frames {
        let [w, x, y, z] = frame.camera_quaternion_wxyz;
        let seen = visible(frame);
        let stem = frame.image.trim_end_matches(".png");
        let time = frame.time_s.map_or(String::new(), |t| t.to_string());
        let _ = writeln!(text, "{stem},{time},{w},{x},{y},{z},{seen},{seen},0,1");
    }
    text
}

fn index(frames: &[FrameTruth]) -> String {
    let mut text = String::new();
    for frame in frames.iter().filter(|f| visible(f) > 0) {
        let [w, x, y, z] = frame.quaternion_wxyz;
        // With a slash on every system, so that a folder may be moved to any.
        let _ = write!(text, "images/{},{w},{x},{y},{z}", frame.image);
        for dot in frame.dots.iter().filter(|d| d.visible) {
            let _ = write!(text, ",{:.4},{:.4}", dot.pixel.u, dot.pixel.v);
        }
        text.push('\n');
    }
    text
}

/// Images side by side, each enlarged or shrunk to fit into a square; `cell` is its side with the
/// gap, pixels.
///
/// # Errors
/// [`crate::Error::Argument`] where there is no image, or the cell no larger than the gap.
pub fn contact_sheet(images: &[RgbImage], cell: usize) -> Result<RgbImage> {
    require(cell > GAP, "cell", "more pixels than the gap of 4", cell)?;
    let side = cell - GAP;
    let columns = (images.len() as f64).sqrt().ceil() as usize;
    let rows = images.len().div_ceil(columns.max(1));
    let (width, height) = (columns * cell, rows * cell);
    let mut values = vec![[0.0f32; 3]; width * height];
    for (k, image) in images.iter().enumerate() {
        let scale = side as f64 / image.width().max(image.height()) as f64;
        let scaled = |n: usize| ((n as f64 * scale).round() as usize).max(1);
        let (w, h) = (scaled(image.width()), scaled(image.height()));
        let resized = image.resized(w, h)?;
        let corner = (k / columns) * cell * width + (k % columns) * cell;
        for (v, row) in resized.values().chunks_exact(w).enumerate() {
            values[corner + v * width..][..w].copy_from_slice(row);
        }
    }
    RgbImage::new(width, height, values)
}
