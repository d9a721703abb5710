//! One ball in the clips of several cameras.
//!
//! The ball has one surface, one spin and one path, straight and even, through the views of all cameras; each has its own background,
//! sensor and light, as if each had its lamp. Truths are in each camera's own frame, by its own clock.

use std::fmt::Write as _;

use nalgebra::Matrix3;
use rand::RngExt;

use super::config::SynthConfig;
use super::dataset::{ClipConfig, FIRST_NS, SynthFrame, SynthSequence, frame, frame_rng};
use super::scene::Scene;
use super::view::circle_of;
use crate::error::{Error, Result, require};
use crate::geometry::{Rotation, Vec3, random_direction};
use crate::pattern::Pattern;
use crate::vision::optics::camera::{Camera, Intrinsics};
use crate::vision::optics::lens::Lens;
use crate::vision::optics::rig::{Extrinsics, Rig, RigCamera};

/// The stream of the path's numbers, and those of the cameras': no frame has their numbers.
const PATH: u64 = 1 << 41;
const CAMERAS: u64 = 1 << 42;
/// Distances from the first camera that are tried where its ball's size is not given, m.
const DISTANCES_M: (f64, f64) = (0.1, 10.0);
const DISTANCES: usize = 60;
/// Paths that are tried.
const PATHS: usize = 400;
/// Longest path over its distance, and longest step of the ball aside from where all axes meet.
const LONGEST: f64 = 0.25;
const ASIDE: f64 = 0.08;
/// Room that a ball has to the border, radii.
const ROOM: f64 = 1.4;
/// Least radius of a ball, pixels.
const LEAST_PX: f64 = 8.0;

/// The clips of one ball by the cameras of a rig.
#[derive(Debug, Clone)]
pub struct RigSequence {
    views: Vec<RigView>,
    /// In the rig's frame, the crate's axes: center in the middle of the clip, m, and velocity, m/s.
    middle_m: Vec3,
    velocity_m_s: Vec3,
    /// At the first frame.
    rotation: Rotation,
    spin: Vec3,
    ball_radius_m: f64,
    fps: f64,
    count: usize,
    seed: u64,
}

/// A camera's own scene.
#[derive(Debug, Clone)]
struct RigView {
    scene: Scene,
    intrinsics: Intrinsics,
    from_rig: Extrinsics,
    delay_s: f64,
}

impl RigView {
    /// What a camera sees of the ball of the first one's scene, whose center is here in ball radii; light and background are its own.
    fn of(mut scene: Scene, first: &Scene, seeing: &CameraSeeing, center: &Vec3) -> Self {
        scene.surface = first.surface.clone();
        scene.exposure_s = first.exposure_s;
        scene.camera = Camera::Perspective(seeing.intrinsics);
        scene.spin = seeing.from_rig.rotation * first.spin;
        scene.circle = circle_of(&seeing.intrinsics, center);
        scene.background.origin = scene.circle.center;
        scene.background.radius_px = scene.circle.radius;
        Self {
            scene,
            intrinsics: seeing.intrinsics,
            from_rig: seeing.from_rig,
            delay_s: seeing.delay_s,
        }
    }
}

impl RigSequence {
    /// A random ball on a random path that all cameras see, `count` times. [`SynthConfig::ball_px`] is its size for the first camera; by
    /// default it flies where the cameras' axes meet.
    ///
    /// # Errors
    /// Those of [`SynthSequence::random`]; [`Error::Argument`] for cameras with distortion or without the size of their images, and where no
    /// place is seen by all.
    pub fn random(
        pattern: &Pattern,
        config: &SynthConfig,
        clip: &ClipConfig,
        rig: &Rig,
        ball_radius_m: f64,
        seed: u64,
        count: usize,
    ) -> Result<Self> {
        let cameras: Vec<CameraSeeing> = rig
            .cameras()
            .iter()
            .map(CameraSeeing::of)
            .collect::<Result<_>>()?;
        if clip.drift_px.is_some() || clip.readout_s != 0.0 {
            let problem = "expected neither drift nor readout for several cameras";
            return Err(Error::argument("drift_px", problem));
        }
        let of_camera = |k: usize| SynthConfig {
            image_px: Some(cameras[k].size),
            cut_share: 0.0,
            ..config.clone()
        };
        let first = SynthSequence::random(pattern, &of_camera(0), clip, seed, count)?.first;
        let duration_s = (count.max(2) - 1) as f64 / clip.fps;
        let (middle_m, velocity_m_s) = path(
            &cameras,
            config,
            ball_radius_m,
            duration_s,
            &mut frame_rng(seed, PATH),
        )?;
        let mut views = Vec::with_capacity(cameras.len());
        for (k, seeing) in cameras.iter().enumerate() {
            let scene = match k {
                0 => first.clone(),
                _ => {
                    let rng = &mut frame_rng(seed, CAMERAS + k as u64);
                    Scene::random(pattern, &of_camera(k), rng)?
                }
            };
            let center = seeing.from_rig.apply(&middle_m) / ball_radius_m;
            views.push(RigView::of(scene, &first, seeing, &center));
        }
        Ok(Self {
            views,
            middle_m,
            velocity_m_s,
            rotation: first.rotation,
            spin: first.spin,
            ball_radius_m,
            fps: clip.fps,
            count,
            seed,
        })
    }

    /// The spin in the rig's frame (the crate's axes), rad/s.
    pub fn spin(&self) -> Vec3 {
        self.spin
    }

    /// Where the ball is in frame number `k`, in the rig's frame (the crate's axes), m.
    pub fn center_m(&self, k: usize) -> Vec3 {
        let middle = 0.5 * (self.count.max(2) - 1) as f64;
        self.middle_m + self.velocity_m_s * ((k as f64 - middle) / self.fps)
    }

    /// How a camera's clip was taken.
    pub fn taken(&self, camera: usize, asked: &ClipConfig) -> ClipConfig {
        ClipConfig {
            spin: Some(self.views[camera].scene.spin.into()),
            exposure_s: Some(self.views[camera].scene.exposure_s),
            ..*asked
        }
    }

    /// Frame number `k` of a camera; its name has the time by that camera's clock, ns.
    ///
    /// # Errors
    /// [`Error::Internal`] where the compression fails.
    ///
    /// # Panics
    /// Where there is no camera of this number.
    pub fn frame(&self, camera: usize, k: usize) -> Result<SynthFrame> {
        let view = &self.views[camera];
        let mut scene = view.scene.clone();
        let since_s = k as f64 / self.fps;
        let seen = |late_s: f64| {
            let center = self.center_m(k) + self.velocity_m_s * late_s;
            circle_of(
                &view.intrinsics,
                &(view.from_rig.apply(&center) / self.ball_radius_m),
            )
        };
        scene.circle = seen(0.0);
        let half_s = 0.5 * scene.exposure_s;
        let [before, after] = [seen(-half_s), seen(half_s)].map(|c| c.center);
        scene.shift_px = [after.u - before.u, after.v - before.v];
        let rotation = Rotation::from_scaled_axis(self.spin * since_s) * self.rotation;
        scene.rotation = view.from_rig.rotation * rotation;
        let stream = CAMERAS + ((camera as u64) << 32) + 1 + k as u64;
        scene.noise_seed = frame_rng(self.seed, stream).random();
        let own_s = since_s - view.delay_s;
        let ns = (FIRST_NS as f64 + 1e9 * own_s).round() as u64;
        frame(&scene, format!("{ns}.png"), Some(1e-9 * ns as f64))
    }
}

/// What a camera sees.
struct CameraSeeing {
    intrinsics: Intrinsics,
    size: [usize; 2],
    from_rig: Extrinsics,
    delay_s: f64,
}

impl CameraSeeing {
    fn of(camera: &RigCamera) -> Result<Self> {
        let (name, calibration) = (&camera.name, &camera.calibration);
        let fail = |problem: &str| Err(Error::argument("rig", format!("{name}: {problem}")));
        if calibration.intrinsics.lens != Lens::Ideal || calibration.intrinsics.skew != 0.0 {
            return fail("expected no distortion: pictures are rendered without");
        }
        let Some(size) = calibration.size else {
            return fail("expected image_width and image_height, found none");
        };
        require(
            camera.clock_offset_s.abs() < 1e-9 * FIRST_NS as f64,
            "clock_offset_s",
            "less than 1000 s",
            camera.clock_offset_s,
        )?;
        Ok(Self {
            intrinsics: calibration.intrinsics,
            size: size.map(|n| n as usize),
            from_rig: camera.extrinsics.in_camera_axes(),
            delay_s: camera.clock_offset_s,
        })
    }

    /// Whether a ball is seen whole.
    fn sees(&self, center_m: &Vec3, ball_radius_m: f64) -> bool {
        let center = self.from_rig.apply(center_m) / ball_radius_m;
        if center.z > -1.5 {
            return false;
        }
        let circle = circle_of(&self.intrinsics, &center);
        let inside = |x: f64, size: usize| {
            (ROOM * circle.radius..=size as f64 - ROOM * circle.radius).contains(&x)
        };
        circle.radius >= LEAST_PX
            && inside(circle.center.u, self.size[0])
            && inside(circle.center.v, self.size[1])
    }
}

/// A path that all cameras see: its middle, m, and the velocity, m/s.
fn path(
    cameras: &[CameraSeeing],
    config: &SynthConfig,
    ball_radius_m: f64,
    duration_s: f64,
    rng: &mut impl rand::Rng,
) -> Result<(Vec3, Vec3)> {
    let is_seen = |center: &Vec3| cameras.iter().all(|c| c.sees(center, ball_radius_m));
    let along = |distance_m: f64| Vec3::new(0.0, 0.0, -distance_m);
    let first = &cameras[0].intrinsics;
    let by_size = config.ball_px.map(|[low, high]| {
        let radius_px = 0.25 * (low + high);
        along(first.focal() * ball_radius_m / radius_px)
    });
    let (near, far) = DISTANCES_M;
    let step = (far / near).powf(1.0 / DISTANCES as f64);
    let on_axis = (0..=DISTANCES).map(|k| along(near * step.powi(k as i32)));
    let candidates = match by_size {
        Some(place) => vec![place],
        None => meeting(cameras).into_iter().chain(on_axis).collect(),
    };
    let Some(place) = candidates.into_iter().find(is_seen) else {
        let problem = match by_size {
            Some(_) => {
                "expected a --ball-px at which all cameras see the ball on the first one's axis"
            }
            None => "expected cameras that see one place, found none on the first one's axis",
        };
        return Err(Error::argument("rig", problem));
    };
    let distance = place.norm();
    for left in (0..PATHS).rev() {
        let size = left as f64 / PATHS as f64;
        let middle = place + random_direction(rng) * (ASIDE * size * distance);
        let length = LONGEST * size * distance * rng.random::<f64>();
        let half = random_direction(rng) * (0.5 * length);
        if [middle - half, middle, middle + half].iter().all(is_seen) {
            return Ok((middle, half * 2.0 / duration_s));
        }
    }
    Ok((place, Vec3::zeros()))
}

/// Where the optical axes come nearest to each other; `None` where they are nearly parallel.
fn meeting(cameras: &[CameraSeeing]) -> Option<Vec3> {
    let mut sum = Matrix3::zeros();
    let mut weighted = Vec3::zeros();
    for camera in cameras {
        let to_rig = camera.from_rig.inverse();
        let axis = to_rig.rotation * -Vec3::z();
        let across = Matrix3::identity() - axis * axis.transpose();
        sum += across;
        weighted += across * to_rig.translation_m;
    }
    let is_clear = sum.symmetric_eigenvalues().min() > 1e-2;
    sum.try_inverse()
        .filter(|_| is_clear)
        .map(|inverse| inverse * weighted)
}

/// A rig of pinhole cameras as its file, which [`Rig::read`] reads.
///
/// # Errors
/// [`Error::Argument`] for cameras with distortion or without the size of their images.
pub fn to_yaml(rig: &Rig) -> Result<String> {
    let mut text = String::from(
        "# x_camera = R x_first_camera + T, optical axes (x right, y down, z forward), meters\n",
    );
    for camera in rig.cameras() {
        let CameraSeeing {
            intrinsics: k,
            size: [width, height],
            ..
        } = CameraSeeing::of(camera)?;
        let turn = camera.extrinsics.rotation.to_rotation_matrix();
        let rows: Vec<String> = turn
            .matrix()
            .transpose()
            .iter()
            .map(f64::to_string)
            .collect();
        let t = camera.extrinsics.translation_m;
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "{}:\n  image_width: {width}\n  image_height: {height}\n  camera_matrix: [{}, 0, {}, 0, {}, {}, 0, 0, 1]\n  R: [{}]\n  \
             T: [{}, {}, {}]\n  clock_offset_s: {}",
            camera.name,
            k.fx,
            k.cx,
            k.fy,
            k.cy,
            rows.join(", "),
            t.x,
            t.y,
            t.z,
            camera.clock_offset_s
        );
    }
    Ok(text)
}
