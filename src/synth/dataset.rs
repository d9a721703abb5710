//! Frames with their truth: independent ones, and sequences of one turning ball.
//!
//! Every frame is drawn from a generator of its own, seeded by the set's seed and the frame's
//! number: it is the same whichever thread draws it, and whatever others are drawn. Frame `k` of a
//! seed is the same scene for every pattern; only the dots differ. [`super::folder`] writes frames
//! to disk.

use nalgebra::Quaternion;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::config::{SynthConfig, SynthKind};
use super::occlusion::OccluderKind;
use super::render::{BallRendering, Rendering, TrueDot};
use super::scene::Scene;
use super::sensor::Sensor;
use super::several::{BallImage, ImageOf, StrobeConfig};
use super::view::Ellipse;
use crate::concurrency;
use crate::error::{Error, Result, require};
use crate::geometry::{Rotation, Vec3, to_wxyz};
use crate::image::RgbImage;
use crate::pattern::Pattern;
use crate::vision::optics::camera::{Camera, Intrinsics, Pixel};

/// Time of a sequence's first frame, ns: so that all names have the same length for an hour.
pub(super) const FIRST_NS: u64 = 1_000_000_000_000;
/// Maximum of a sequence's random drift over the ball's radius, along either axis.
const MAX_DRIFT: f64 = 0.1;
/// Maximum of a sequence's given drift along either axis, pixels: wider than the images.
const MAX_DRIFT_PX: f64 = 10_000.0;
/// Maximum speed of a ball along the columns, over that of the rolling shutter.
const MAX_PACE: f64 = 0.5;
/// Least and greatest number of frames a second.
const FPS: (f64, f64) = (1e-3, 1e6);

/// A ball seen again and again.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ClipConfig {
    /// Frames per second.
    pub fps: f64,
    /// Spin, camera frame, rad/s; at random within the frames' bounds where not given.
    pub spin: Option<[f64; 3]>,
    /// Exposure, s; as drawn where not given.
    pub exposure_s: Option<f64>,
    /// Displacement of the ball's center over the whole sequence, pixels (u, v); where not given,
    /// at random, with a maximum of a tenth of the radius.
    pub drift_px: Option<[f64; 2]>,
    /// Rolling shutter: time from the exposure of the image's first row to that of its last, s; 0 for a global shutter. A frame's name
    /// has the time of its first row; its truth is that of the row in which the ball's center is seen.
    #[serde(default)]
    pub readout_s: f64,
}

/// A dot's truth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DotTruth {
    /// Its index in the pattern.
    pub index: usize,
    /// Its middle as drawn, unit vector, view frame (see [`Rendering`]).
    pub direction: [f64; 3],
    /// Its middle in the image.
    pub pixel: Pixel,
    /// Its angular radius, radians.
    pub radius_rad: f64,
    /// See [`TrueDot::facing`].
    pub facing: f64,
    /// See [`TrueDot::contrast`].
    pub contrast: f64,
    /// See [`TrueDot::inside`].
    pub inside: bool,
    /// See [`TrueDot::occluded`].
    pub occluded: bool,
    /// Whether a detector should find it: see [`TrueDot::is_visible`].
    pub visible: bool,
}

/// A frame's truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameTruth {
    /// The image's name within `images`.
    pub image: String,
    /// What is shown.
    pub kind: SynthKind,
    /// Time of mid-exposure, s, in a sequence; of a rolling shutter that of the row in which the ball's center is seen.
    pub time_s: Option<f64>,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Orientation at mid-exposure, `w, x, y, z`, pattern to view frame (see [`Rendering`]).
    pub quaternion_wxyz: [f64; 4],
    /// Orientation at mid-exposure, `w, x, y, z`, pattern to camera frame: the same for a ball on
    /// the optical axis and for parallel rays.
    pub camera_quaternion_wxyz: [f64; 4],
    /// Spin, camera frame, rad/s.
    pub spin_rad_s: [f64; 3],
    /// Exposure, s.
    pub exposure_s: f64,
    /// The center of the circle nearest to the ball's outline.
    pub center: Pixel,
    /// The radius of that circle, pixels.
    pub radius_px: f64,
    /// The ball's outline.
    pub outline: Ellipse,
    /// Where the ball's center is seen.
    pub ball_center: Pixel,
    /// The camera's intrinsics; none for parallel rays.
    pub intrinsics: Option<Intrinsics>,
    /// Distance of the camera in ball radii; none for parallel rays.
    pub distance: Option<f64>,
    /// Maximum of the surface's motion during the exposure, pixels.
    pub blur_px: f64,
    /// The first logo's kind, if there is one.
    pub logo: Option<super::logo::LogoKind>,
    /// What hides a part of the ball, if anything does.
    pub occluder: Option<OccluderKind>,
    /// Share of the outline that is within the image and not hidden.
    pub rim_visible: f64,
    /// Share of the ball's area that is within the image and not hidden.
    pub area_visible: f64,
    /// Whether the image is flipped left to right.
    pub mirrored: bool,
    /// The sensor's defocus, noise, tone and compression.
    pub sensor: Sensor,
    /// The pattern's dots on the part of the ball in the camera's sight.
    pub dots: Vec<DotTruth>,
    /// Every image of a ball, where the frame has several; what stands above is that of the first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub balls: Vec<BallTruth>,
}

/// The truth of one of several images of balls in a frame; the fields are as in [`FrameTruth`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BallTruth {
    /// Number of the ball.
    pub ball: usize,
    /// Number of the flash that lights it.
    pub flash: usize,
    /// Time, s: after the first flash of an exposure, or of the frame in a sequence.
    pub time_s: f64,
    /// Orientation, `w, x, y, z`, pattern to view frame.
    pub quaternion_wxyz: [f64; 4],
    /// Orientation, `w, x, y, z`, pattern to camera frame.
    pub camera_quaternion_wxyz: [f64; 4],
    /// Spin, camera frame, rad/s.
    pub spin_rad_s: [f64; 3],
    /// The center of the circle nearest to the outline.
    pub center: Pixel,
    /// The radius of that circle, pixels.
    pub radius_px: f64,
    /// The ball's outline.
    pub outline: Ellipse,
    /// Where the ball's center is seen.
    pub ball_center: Pixel,
    /// Distance of the camera in ball radii; none for parallel rays.
    pub distance: Option<f64>,
    /// Share of the outline that is within the image and not hidden.
    pub rim_visible: f64,
    /// Share of the ball's area that is within the image and not hidden.
    pub area_visible: f64,
    /// The pattern's dots on the part of the ball in the camera's sight.
    pub dots: Vec<DotTruth>,
}

impl BallTruth {
    fn of(seen: &BallRendering, time_s: f64) -> Self {
        Self {
            ball: seen.of.ball,
            flash: seen.of.flash,
            time_s: time_s + seen.late_s,
            quaternion_wxyz: to_wxyz(&seen.rotation),
            camera_quaternion_wxyz: to_wxyz(&seen.camera_rotation),
            spin_rad_s: seen.spin.into(),
            center: seen.circle.center,
            radius_px: seen.circle.radius,
            outline: seen.outline,
            ball_center: seen.center,
            distance: seen.distance,
            rim_visible: seen.rim_visible,
            area_visible: seen.area_visible,
            dots: seen.dots.iter().map(DotTruth::from).collect(),
        }
    }

    /// Orientation, pattern to view frame.
    pub fn orientation(&self) -> Rotation {
        of_wxyz(self.quaternion_wxyz)
    }

    /// Orientation, pattern to camera frame.
    pub fn camera_orientation(&self) -> Rotation {
        of_wxyz(self.camera_quaternion_wxyz)
    }
}

impl FrameTruth {
    /// Orientation at mid-exposure, pattern to view frame.
    pub fn orientation(&self) -> Rotation {
        of_wxyz(self.quaternion_wxyz)
    }

    /// Orientation at mid-exposure, pattern to camera frame.
    pub fn camera_orientation(&self) -> Rotation {
        of_wxyz(self.camera_quaternion_wxyz)
    }

    /// Rotation vector from the beginning of the exposure to its end, view frame, radians.
    pub fn turn(&self) -> Vec3 {
        let to_camera = self.camera_orientation() * self.orientation().inverse();
        to_camera.inverse() * Vec3::from(self.spin_rad_s) * self.exposure_s
    }
}

fn of_wxyz([w, x, y, z]: [f64; 4]) -> Rotation {
    Rotation::new_normalize(Quaternion::new(w, x, y, z))
}

/// A frame with its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct SynthFrame {
    /// The image.
    pub image: RgbImage,
    /// Share of each pixel that shows the ball, 0 to 255, row after row.
    pub mask: Vec<u8>,
    /// Its truth.
    pub truth: FrameTruth,
}

/// The generator of a frame of the set with the given seed.
pub fn frame_rng(seed: u64, frame: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(frame);
    rng
}

/// Frame number `k` of the independent frames of a seed: another ball, view and camera each.
///
/// # Errors
/// [`Error::Argument`] where the configuration is out of its domain.
pub fn independent_frame(
    pattern: &Pattern,
    config: &SynthConfig,
    seed: u64,
    k: usize,
) -> Result<SynthFrame> {
    let scene = Scene::random(pattern, config, &mut frame_rng(seed, k as u64))?;
    frame(&scene, format!("frame-{k:06}.png"), None)
}

/// Frame number `k` of the exposures of a seed: another ball, flight and camera each, with several flashes.
///
/// # Errors
/// [`Error::Argument`] where a configuration is out of its domain.
pub fn strobed_frame(
    pattern: &Pattern,
    config: &SynthConfig,
    strobe: &StrobeConfig,
    seed: u64,
    k: usize,
) -> Result<SynthFrame> {
    let scene = Scene::strobed(pattern, config, strobe, &mut frame_rng(seed, k as u64))?;
    frame(&scene, format!("frame-{k:06}.png"), None)
}

/// The first `count` independent frames of a seed.
///
/// # Errors
/// [`Error::Argument`] where the configuration is out of its domain.
pub fn frames(
    pattern: &Pattern,
    config: &SynthConfig,
    seed: u64,
    count: usize,
) -> Result<Vec<SynthFrame>> {
    let frame = |k: u64| independent_frame(pattern, config, seed, k as usize);
    let frames = concurrency::map_range(0..count as u64, frame);
    frames.into_iter().collect()
}

/// One ball in a row of frames: it turns at a constant spin and moves at a constant speed across
/// the image. Camera, light and background stand still.
#[derive(Debug, Clone, PartialEq)]
pub struct SynthSequence {
    pub(super) first: Scene,
    fps: f64,
    seed: u64,
    count: usize,
    /// Displacement of the ball's center over the whole sequence, pixels (u, v).
    pub(super) drift_px: [f64; 2],
    /// Further balls as they are in the middle of the sequence, each with its displacement.
    pub(super) fellows: Vec<(BallImage, [f64; 2])>,
}

fn require_within_frame(name: &'static str, seconds: f64, fps: f64) -> Result<()> {
    let expected = format!("0 to {} s, the time between two frames", 1.0 / fps);
    let inside = (0.0..=1.0 / fps).contains(&seconds);
    require(inside, name, &expected, seconds)
}

impl Scene {
    /// Lets the ball turn like this. The arc that was drawn stays: an exposure fit for a slow ball would smear a fast one beyond recognition.
    fn spin_as(&mut self, spin: [f64; 3]) -> Result<()> {
        if spin.iter().any(|w| !w.is_finite()) {
            return Err(Error::argument("spin", "expected three finite numbers"));
        }
        let arc = self.spin.norm() * self.exposure_s;
        self.spin = Vec3::from(spin);
        if arc > 0.0 && self.spin.norm() > 0.0 {
            self.exposure_s = arc / self.spin.norm();
        }
        Ok(())
    }
}

impl SynthSequence {
    /// A random ball, seen `count` times.
    ///
    /// # Errors
    /// [`Error::Argument`] where a configuration is out of its domain, or the exposure longer than
    /// the time between two frames.
    pub fn random(
        pattern: &Pattern,
        config: &SynthConfig,
        sequence: &ClipConfig,
        seed: u64,
        count: usize,
    ) -> Result<Self> {
        let ClipConfig {
            fps,
            spin,
            exposure_s,
            drift_px,
            readout_s,
        } = *sequence;
        let (low, high) = FPS;
        let expected = format!("{low} to {high}");
        require((low..=high).contains(&fps), "fps", &expected, fps)?;
        let mut rng = frame_rng(seed, 0);
        let mut first = Scene::random(pattern, config, &mut rng)?;
        if let Some(spin) = spin {
            first.spin_as(spin)?;
        }
        first.exposure_s = first.exposure_s.min(1.0 / fps);
        if let Some(exposure_s) = exposure_s {
            require_within_frame("exposure_s", exposure_s, fps)?;
            first.exposure_s = exposure_s;
        }
        let drift = MAX_DRIFT * first.circle.radius;
        let random_px = [0, 1].map(|_| drift * rng.random_range(-1.0..1.0));
        let drift_px = drift_px.unwrap_or(random_px);
        let expected = format!("two numbers of at most {MAX_DRIFT_PX} pixels");
        for drift in drift_px {
            require(drift.abs() <= MAX_DRIFT_PX, "drift_px", &expected, drift)?;
        }
        let speed = fps / count.max(2) as f64;
        // What moves between frames moves during the exposure, too, and nothing else does.
        first.shift_px = drift_px.map(|d| d * speed * first.exposure_s);
        first.velocity_px_s = drift_px.map(|d| d * speed);
        require_within_frame("readout_s", readout_s, fps)?;
        first.row_s = readout_s / (first.size[1] as f64 - 1.0);
        let pace = first.row_s * first.velocity_px_s[1].abs();
        let expected = format!("at most {MAX_PACE} of the rolling shutter's speed");
        require(pace <= MAX_PACE, "drift_px", &expected, pace)?;
        Ok(Self {
            first,
            fps,
            seed,
            count,
            drift_px,
            fellows: Vec::new(),
        })
    }

    /// The ball of a scene, which stays at its place in the image, seen `count` times.
    pub fn of_scene(first: Scene, fps: f64, seed: u64, count: usize) -> Self {
        Self {
            first,
            fps,
            seed,
            count,
            drift_px: [0.0; 2],
            fellows: Vec::new(),
        }
    }

    /// How it was taken, with what `asked` left to chance.
    pub fn taken(&self, asked: &ClipConfig) -> ClipConfig {
        ClipConfig {
            spin: Some(self.spin().into()),
            exposure_s: Some(self.first.exposure_s),
            drift_px: Some(self.drift_px),
            ..*asked
        }
    }

    /// The spin, camera frame, rad/s.
    pub fn spin(&self) -> Vec3 {
        self.first.spin
    }

    /// Frame number `k`.
    ///
    /// # Errors
    /// [`Error::Internal`] where the compression fails.
    pub fn frame(&self, k: usize) -> Result<SynthFrame> {
        let (scene, ns) = self.scene(k);
        let seen_s = scene.row_s * scene.circle.center.v;
        frame(&scene, format!("{ns}.png"), Some(ns as f64 * 1e-9 + seen_s))
    }

    /// The scene of frame number `k` before it is rendered, and its time, ns; of a rolling shutter that of the first row.
    pub fn scene(&self, k: usize) -> (Scene, u64) {
        let step = (1e9 * k as f64 / self.fps).round() as u64;
        // The time that the name says, to the nanosecond.
        let since_s = step as f64 * 1e-9;
        let share = k as f64 / self.count.max(2) as f64 - 0.5;
        let mut scene = self.first.clone();
        let center = &mut scene.circle.center;
        center.u += self.drift_px[0] * share;
        center.v += self.drift_px[1] * share;
        // The shutter reaches the row of the ball's center while the ball moves on.
        let [u, v] = scene.velocity_px_s;
        let late_s = scene.row_s * center.v / (1.0 - scene.row_s * v);
        center.u += u * late_s;
        center.v += v * late_s;
        let turn = scene.spin * (since_s + late_s);
        scene.rotation = Rotation::from_scaled_axis(turn) * scene.rotation;
        scene.noise_seed = frame_rng(self.seed, 1 + k as u64).random();
        for (fellow, drift) in &self.fellows {
            let mut image = fellow.clone();
            image.circle.center.u += drift[0] * share;
            image.circle.center.v += drift[1] * share;
            image.rotation = Rotation::from_scaled_axis(image.spin * since_s) * image.rotation;
            scene.others.push(image);
        }
        (scene, FIRST_NS + step)
    }
}

pub(super) fn frame(scene: &Scene, image: String, time_s: Option<f64>) -> Result<SynthFrame> {
    let rendering = scene.render()?;
    let truth = truth(scene, &rendering, image, time_s);
    Ok(SynthFrame {
        image: rendering.image,
        mask: rendering.mask,
        truth,
    })
}

fn truth(scene: &Scene, seen: &Rendering, image: String, time_s: Option<f64>) -> FrameTruth {
    FrameTruth {
        image,
        kind: seen.kind,
        time_s,
        size: scene.size,
        quaternion_wxyz: to_wxyz(&seen.rotation),
        camera_quaternion_wxyz: to_wxyz(&seen.camera_rotation),
        spin_rad_s: scene.spin.into(),
        exposure_s: scene.exposure_s,
        center: seen.circle.center,
        radius_px: seen.circle.radius,
        outline: seen.outline,
        ball_center: seen.center,
        intrinsics: match seen.camera {
            Camera::Perspective(intrinsics) => Some(intrinsics),
            Camera::Orthographic | Camera::Near { .. } => None,
        },
        distance: seen.distance,
        blur_px: seen.blur_px,
        logo: scene.surface.marks.first().map(|m| m.logo.kind),
        occluder: scene.occluder.as_ref().map(|o| o.kind),
        rim_visible: seen.rim_visible,
        area_visible: seen.area_visible,
        mirrored: scene.mirrored,
        sensor: scene.sensor,
        dots: seen.dots.iter().map(DotTruth::from).collect(),
        balls: balls(seen, time_s.unwrap_or(0.0)),
    }
}

/// The truth of every image of a ball where there are several.
fn balls(seen: &Rendering, time_s: f64) -> Vec<BallTruth> {
    if seen.others.is_empty() {
        return Vec::new();
    }
    let own = BallRendering {
        of: ImageOf::default(),
        late_s: 0.0,
        circle: seen.circle,
        outline: seen.outline,
        center: seen.center,
        distance: seen.distance,
        rotation: seen.rotation,
        camera_rotation: seen.camera_rotation,
        spin: seen.spin,
        dots: seen.dots.clone(),
        rim_visible: seen.rim_visible,
        area_visible: seen.area_visible,
    };
    let all = std::iter::once(&own).chain(&seen.others);
    all.map(|ball| BallTruth::of(ball, time_s)).collect()
}

impl From<&TrueDot> for DotTruth {
    fn from(dot: &TrueDot) -> Self {
        Self {
            index: dot.index,
            direction: dot.direction.into(),
            pixel: dot.pixel,
            radius_rad: dot.radius_rad,
            facing: dot.facing,
            contrast: dot.contrast,
            inside: dot.inside,
            occluded: dot.occluded,
            visible: dot.is_visible(),
        }
    }
}
