//! Frames with their truth, many at once: for training, for tests, for other people's detectors.
//!
//! A folder holds
//! - `images/*.png`;
//! - `index.csv`, in the format that the SpinDOE authors' reader takes: no header; the image's path, the orientation as a
//!   quaternion `x, y, z, w` (SciPy's order; pattern to camera), then the pixel positions `u0, v0, u1, v1, ...` of the dots that can be
//!   seen, so that rows differ in length;
//! - `truth.json`: everything known of every frame ([`FrameTruth`]);
//! - for a sequence also `orientations.csv`, as `spindoe spin` reads it, and the names of images are nanoseconds.
//!
//! Independent frames are drawn each from its own generator, whatever the number of threads. A sequence is one ball that turns at a
//! constant spin and crosses the view.

use std::fmt::Write as _;
use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::render::{Rendering, TrueDot};
use super::scene::{Scene, SynthConfig};
use crate::error::{Error, Result};
use crate::files;
use crate::geometry::{Rotation, Vec3};
use crate::pattern::Pattern;
use crate::vision::camera::Pixel;
use crate::vision::image::RgbImage;

/// Time of a sequence's first frame, ns: so that all names have the same length for an hour.
const FIRST_NS: u64 = 1_000_000_000_000;
/// How far a sequence's ball may go off the crop's middle in all, over half the side.
const WAY: f64 = 0.1;

/// A ball seen again and again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SequenceConfig {
    /// Frames per second.
    pub fps: f64,
    /// Spin, camera frame, rad/s; at random within the frames' bounds where not given.
    pub spin: Option<[f64; 3]>,
    /// Exposure, s; as drawn where not given.
    pub exposure_s: Option<f64>,
}

/// A dot's truth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DotTruth {
    /// Its index in the pattern.
    pub index: usize,
    /// Its middle as drawn, unit vector, camera frame.
    pub direction: [f64; 3],
    /// Its middle in the image.
    pub pixel: Pixel,
    /// Its angular radius, radians.
    pub radius_rad: f64,
    /// See [`TrueDot::contrast`].
    pub contrast: f64,
    /// Whether a detector should find it.
    pub visible: bool,
}

/// A frame's truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameTruth {
    /// The image's name within `images`.
    pub image: String,
    /// Time of mid-exposure, s, in a sequence.
    pub time_s: Option<f64>,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Orientation at mid-exposure, `w, x, y, z`, pattern to camera.
    pub quaternion_wxyz: [f64; 4],
    /// Spin, camera frame, rad/s.
    pub spin_rad_s: [f64; 3],
    /// Exposure, s.
    pub exposure_s: f64,
    /// The ball's centre.
    pub center: Pixel,
    /// The ball's radius, pixels.
    pub radius_px: f64,
    /// Distance of the camera in ball radii; none for parallel rays.
    pub distance: Option<f64>,
    /// Most that the surface moved during the exposure, pixels.
    pub blur_px: f64,
    /// The logo's kind, if there is one.
    pub logo: Option<super::logo::LogoKind>,
    /// The dots on the side that faces the camera.
    pub dots: Vec<DotTruth>,
}

/// A frame with its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The image.
    pub image: RgbImage,
    /// What is known of it.
    pub truth: FrameTruth,
}

/// The generator of a frame of the set with the given seed.
pub fn frame_rng(seed: u64, frame: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(frame);
    rng
}

/// Independent frames of balls with one pattern.
///
/// # Errors
/// [`Error::Argument`] where the configuration is out of its domain.
pub fn frames(
    pattern: &Pattern,
    config: &SynthConfig,
    seed: u64,
    count: usize,
) -> Result<Vec<Frame>> {
    (0..count)
        .into_par_iter()
        .map(|k| {
            let scene = Scene::random(pattern, config, &mut frame_rng(seed, k as u64))?;
            frame(&scene, format!("frame-{k:06}.png"), None)
        })
        .collect()
}

/// One ball in a row of frames.
///
/// # Errors
/// [`Error::Argument`] where a configuration is out of its domain.
pub fn sequence(
    pattern: &Pattern,
    config: &SynthConfig,
    sequence: &SequenceConfig,
    seed: u64,
    count: usize,
) -> Result<Vec<Frame>> {
    if !(sequence.fps > 0.0 && sequence.fps.is_finite()) {
        let problem = format!("expected a positive number, found {}", sequence.fps);
        return Err(Error::argument("fps", problem));
    }
    let mut rng = frame_rng(seed, 0);
    let mut first = Scene::random(pattern, config, &mut rng)?;
    if let Some(spin) = sequence.spin {
        first.spin = Vec3::from(spin);
    }
    if let Some(exposure_s) = sequence.exposure_s {
        first.exposure_s = exposure_s;
    }
    let way = 0.5 * first.size[0] as f64 * WAY;
    let drift = [0, 1].map(|_| way * rng.random_range(-1.0..1.0));
    (0..count)
        .into_par_iter()
        .map(|k| {
            let step = (1e9 * k as f64 / sequence.fps).round() as u64;
            // The time that the name tells, to the nanosecond.
            let since_s = step as f64 * 1e-9;
            let share = k as f64 / count.max(2) as f64 - 0.5;
            let mut scene = first.clone();
            scene.rotation = Rotation::from_scaled_axis(first.spin * since_s) * first.rotation;
            scene.circle.center.u += drift[0] * share;
            scene.circle.center.v += drift[1] * share;
            scene.noise_seed = frame_rng(seed, 1 + k as u64).random();
            let ns = FIRST_NS + step;
            frame(&scene, format!("{ns}.png"), Some(ns as f64 * 1e-9))
        })
        .collect()
}

fn frame(scene: &Scene, image: String, time_s: Option<f64>) -> Result<Frame> {
    let rendering = scene.render()?;
    let truth = truth(scene, &rendering, image, time_s);
    Ok(Frame {
        image: rendering.image,
        truth,
    })
}

fn truth(scene: &Scene, seen: &Rendering, image: String, time_s: Option<f64>) -> FrameTruth {
    FrameTruth {
        image,
        time_s,
        size: scene.size,
        quaternion_wxyz: wxyz(&seen.rotation),
        spin_rad_s: scene.spin.into(),
        exposure_s: scene.exposure_s,
        center: seen.circle.center,
        radius_px: seen.circle.radius,
        distance: scene.distance,
        blur_px: seen.blur_px,
        logo: scene.surface.mark.as_ref().map(|m| m.logo.kind),
        dots: seen.dots.iter().map(dot_truth).collect(),
    }
}

fn dot_truth(dot: &TrueDot) -> DotTruth {
    DotTruth {
        index: dot.index,
        direction: dot.direction.into(),
        pixel: dot.pixel,
        radius_rad: dot.radius_rad,
        contrast: dot.contrast,
        visible: dot.is_visible(),
    }
}

/// Scalar first, not negative.
fn wxyz(rotation: &Rotation) -> [f64; 4] {
    let q = rotation.quaternion();
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [q.w, q.i, q.j, q.k].map(|c| sign * c)
}

/// Writes frames and their truth to a folder; each file whole or not at all. The index comes last.
///
/// # Errors
/// [`Error::Write`] where the system refuses.
pub fn write(dir: &Path, frames: &[Frame]) -> Result<()> {
    let images = dir.join("images");
    files::create_dir(&images)?;
    frames
        .par_iter()
        .try_for_each(|f| f.image.write_png(&images.join(&f.truth.image)))?;
    let truths: Vec<&FrameTruth> = frames.iter().map(|f| &f.truth).collect();
    let text = serde_json::to_vec_pretty(&truths)
        .map_err(|e| Error::Internal(format!("cannot be written as JSON: {e}")))?;
    files::write_bytes(&dir.join("truth.json"), &text)?;
    if truths.iter().all(|t| t.time_s.is_some()) && !truths.is_empty() {
        files::write_bytes(
            &dir.join("orientations.csv"),
            orientations(&truths).as_bytes(),
        )?;
    }
    files::write_bytes(&dir.join("index.csv"), index(&images, &truths).as_bytes())
}

/// Writing to a string does not fail.
fn orientations(truths: &[&FrameTruth]) -> String {
    let mut text = "frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence\n".to_owned();
    for truth in truths {
        let [w, x, y, z] = truth.quaternion_wxyz;
        let seen = truth.dots.iter().filter(|d| d.visible).count();
        let stem = truth.image.trim_end_matches(".png");
        let time = truth.time_s.unwrap_or_default();
        let _ = writeln!(text, "{stem},{time},{w},{x},{y},{z},{seen},{seen},0,1");
    }
    text
}

fn index(images: &Path, truths: &[&FrameTruth]) -> String {
    let mut text = String::new();
    for truth in truths {
        let [w, x, y, z] = truth.quaternion_wxyz;
        let path = images.join(&truth.image);
        let _ = write!(text, "{},{x},{y},{z},{w}", path.display());
        for dot in truth.dots.iter().filter(|d| d.visible) {
            let _ = write!(text, ",{:.4},{:.4}", dot.pixel.u, dot.pixel.v);
        }
        text.push('\n');
    }
    text
}

/// All frames side by side, each enlarged or shrunk to a square of `cell` pixels; at most `most` of them.
///
/// # Errors
/// [`Error::Argument`] where there is no frame.
pub fn contact_sheet(frames: &[Frame], cell: usize, most: usize) -> Result<RgbImage> {
    let shown = &frames[..frames.len().min(most)];
    let columns = (shown.len() as f64).sqrt().ceil() as usize;
    let rows = shown.len().div_ceil(columns.max(1));
    let (width, height) = (columns * cell, rows * cell);
    let mut values = vec![[0.0f32; 3]; width * height];
    for (k, frame) in shown.iter().enumerate() {
        let enlarged = frame.image.resized(cell - 4, cell - 4)?;
        let corner = (k / columns) * cell * width + (k % columns) * cell;
        for (v, row) in enlarged.values().chunks_exact(cell - 4).enumerate() {
            values[corner + v * width..][..row.len()].copy_from_slice(row);
        }
    }
    RgbImage::new(width, height, values)
}
