//! Clips of balls with dots drawn by hand, turned by hand before the camera.
//!
//! Dots are anywhere on the ball, evenly or in clusters, uneven and oval, of a pen that covers 4 to 8 mm of a ball of 40 to 220 mm.
//! The ball is turned about one axis and then about another, in strokes of a third of a turn to a whole one, with pauses where the
//! hand takes it anew; fingers are in view in two clips of three. Who follows docs/hand-drawn.md ([`Habits::Guided`]) draws 14 to 30 larger
//! dots, apart from each other, and turns the ball once about the vertical axis, once about the horizontal one, and about one between.

use std::f64::consts::TAU;

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::geometry::{
    Rotation, Vec3, angle_between, random_direction, random_rotation, spiral_directions,
    tangent_frame,
};
use spindoe::pattern::Pattern;
use spindoe::synth::occlusion::{Occluder, OccluderKind};
use spindoe::synth::pen::Spot;
use spindoe::synth::surface::{HalvesSeam, Surface};
use spindoe::synth::view::View;
use spindoe::synth::{Rendering, Scene, SynthConfig};

use crate::Outcome;

/// Diameters of the balls and of the dots, millimeters.
const BALL_MM: [f64; 2] = [40.0, 220.0];
const DOT_MM: [f64; 2] = [4.0, 8.0];
/// Numbers of dots.
const DOTS: [usize; 2] = [12, 60];
/// Diameters of the balls, pixels.
const BALL_PX: [f64; 2] = [50.0, 140.0];
/// Numbers of frames.
const FRAMES: [usize; 2] = [60, 300];
/// Between the middles of two dots lie as many radii, and as many radians more.
const GAP: [f64; 2] = [2.4, 0.08];
/// The whole turn of a clip, and the largest from a frame to the next, radians.
const TURN: [f64; 2] = [2.0 * TAU, 5.0 * TAU];
const MAX_STEP: f64 = 0.26;
/// A stroke, radians, and the frames of a pause.
const STROKE: [f64; 2] = [TAU / 3.0, TAU];
const PAUSE: std::ops::RangeInclusive<usize> = 0..=8;
/// How the hand trembles from frame to frame: the ball's turn, radians, its center and its radius, radii.
const TREMOR: [f64; 3] = [0.004, 0.01, 0.003];
/// Share of the clips with fingers in view.
const FINGERS: f64 = 0.67;
/// Share of the balls whose dots are in clusters.
const CLUSTERED: f64 = 0.4;
/// A place is shown that faces the camera so far in so many frames; a dot in so many, as docs/hand-drawn.md asks for.
const FACING: f64 = 0.25;
const VIEWS: usize = 3;
const DOT_VIEWS: usize = 10;
/// A dot that is seen in fewer of the views in which it faces the camera is hidden by print.
const HIDDEN: f64 = 0.3;
/// Places at which it is looked up what is shown.
const PLACES: usize = 400;

/// The same of who follows the guide: numbers of dots, their angular radii, radians, the bare ball between two, radii of a dot, frames, and
/// the turn about each axis, radians.
const GUIDED_DOTS: [usize; 2] = [14, 30];
const GUIDED_RADIUS: [f64; 2] = [0.06, 0.11];
const GUIDED_GAP: f64 = 2.0;
/// They lie so many radii off print, looked at in so many directions.
const OFF_PRINT: f64 = 2.0;
const AROUND: usize = 12;
/// Ink that no one sees.
const NO_INK: f32 = 0.05;
const GUIDED_FRAMES: [usize; 2] = [150, 300];
const GUIDED_TURN: [f64; 2] = [1.1 * TAU, 1.5 * TAU];

/// How dots are drawn and the ball is turned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Habits {
    /// Without a plan.
    Any,
    /// As docs/hand-drawn.md asks for.
    Guided,
}

/// How a stroke begins and ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Strokes {
    /// Slowly, with pauses between strokes.
    Eased,
    /// From one frame to the next, about another axis: as even a turn as a motor's, the ball taken anew in no time.
    Abrupt,
}

/// A clip that is yet to be rendered.
pub struct HandClip {
    /// The dots as they are drawn.
    pub truth: Pattern,
    /// Their mean angular radius, radians.
    pub dot_radius_rad: f64,
    /// Diameter of the ball, pixels.
    pub ball_px: f64,
    /// Frames per second.
    pub fps: f64,
    scenes: Vec<Scene>,
}

/// What the frames of a clip show.
pub struct Shown {
    /// Share of the ball's surface.
    pub share: f64,
    /// Whether every dot faces the camera in enough frames.
    pub all_dots: bool,
    /// For each dot whether print hides it.
    pub hidden: Vec<bool>,
}

impl HandClip {
    /// The clip `k` of a seed: balls look as `looks` has it, but for what a hand draws.
    ///
    /// # Errors
    /// Settings that cannot be drawn from.
    pub fn random(
        looks: &SynthConfig,
        habits: Habits,
        strokes: Strokes,
        seed: u64,
        k: u64,
    ) -> Outcome<Self> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(k);
        let ball_mm = log_between(BALL_MM, &mut rng);
        let dot_radius_rad = match habits {
            Habits::Any => rng.random_range(DOT_MM[0]..DOT_MM[1]) / ball_mm,
            Habits::Guided => log_between(GUIDED_RADIUS, &mut rng),
        };
        let truth = drawn_by_hand(dot_radius_rad, habits, &mut rng)?;
        let config = SynthConfig {
            ball_px: Some([log_between(BALL_PX, &mut rng); 2]),
            dot_radius_rad: [dot_radius_rad; 2],
            dot_radius_spread: [0.05, 0.2],
            max_dot_elongation: 0.2,
            ink_density: [0.6, 1.0],
            max_streaks: 0.3,
            max_noise: 6.0,
            defocus_px: [0.2, 1.0],
            max_background: 0.8,
            clutter_share: 0.3,
            video_share: 0.3,
            video_qp: [18.0, 28.0],
            ..looks.clone().as_designed()
        };
        let mut scene = Scene::random(&truth, &config, &mut rng)?;
        let truth = match habits {
            Habits::Any => truth,
            Habits::Guided => off_print(&truth, &mut scene.surface)?,
        };
        let lengths = match habits {
            Habits::Any => FRAMES,
            Habits::Guided => GUIDED_FRAMES,
        };
        let frames = log_between(lengths.map(|n| n as f64), &mut rng).round() as usize;
        let fps = if rng.random_bool(0.7) { 30.0 } else { 240.0 };
        let fingers = rng.random_bool(FINGERS).then_some(&config);
        let hand = (habits, strokes);
        let scenes = turned(&scene, (frames, fps), hand, fingers, &truth, &mut rng)?;
        Ok(Self {
            truth,
            dot_radius_rad,
            ball_px: 2.0 * scene.circle.radius,
            fps,
            scenes,
        })
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.scenes.len()
    }

    /// Renders the frames, gives each to `take`, and says what they show.
    ///
    /// # Errors
    /// A scene that cannot be rendered.
    pub fn show(&self, mut take: impl FnMut(&Rendering)) -> Outcome<Shown> {
        let places: Vec<Vec3> = spiral_directions(PLACES).collect();
        let mut faced = vec![0usize; places.len()];
        let mut views = vec![[0usize; 2]; self.truth.len()];
        for scene in &self.scenes {
            let seen = scene.render()?;
            let view = View::new(&scene.camera, scene.circle)?;
            for (place, faced) in places.iter().zip(&mut faced) {
                let normal = scene.rotation * place;
                *faced += usize::from(
                    view.facing(&normal) >= FACING && shows(&seen, &view, &normal, scene.size),
                );
            }
            for dot in seen.dots.iter().filter(|d| d.facing > FACING) {
                views[dot.index][0] += usize::from(!dot.occluded);
                views[dot.index][1] += usize::from(dot.is_visible());
            }
            take(&seen);
        }
        let shown = faced.iter().filter(|n| **n >= VIEWS).count();
        let is_hidden = |[facing, seen]: &[usize; 2]| (*seen as f64) < HIDDEN * *facing as f64;
        Ok(Shown {
            all_dots: views.iter().all(|[facing, _]| *facing >= DOT_VIEWS),
            share: shown as f64 / places.len() as f64,
            hidden: views.iter().map(is_hidden).collect(),
        })
    }
}

/// Whether nothing before the ball hides a place of it.
fn shows(seen: &Rendering, view: &View, normal: &Vec3, [width, height]: [usize; 2]) -> bool {
    let pixel = view.project(normal);
    let [u, v] = [pixel.u.round(), pixel.v.round()];
    let inside = u >= 0.0 && v >= 0.0 && u < width as f64 && v < height as f64;
    inside && seen.mask[v as usize * width + u as usize] > 127
}

/// The dots that are not drawn on print, and the surface with them alone.
fn off_print(dots: &Pattern, surface: &mut Surface) -> Outcome<Pattern> {
    let spots = dots.dots().iter().zip(surface.dots.clone());
    let is_bare = |spot: &Spot| {
        let [a, b] = tangent_frame(&spot.middle);
        let around = (0..AROUND).map(|i| (TAU * i as f64 / AROUND as f64).sin_cos());
        let places = around.flat_map(|(s, c)| {
            [0.0, 1.0, OFF_PRINT].map(|radii| spot.middle + (a * c + b * s) * (radii * spot.radius))
        });
        let mut inks = places.map(|place| {
            let under = surface.under(&place.normalize());
            let parts = under.iter().zip(&surface.ball);
            parts.map(|(u, b)| (u / b - 1.0).abs()).fold(0.0, f32::max)
        });
        let is_off_seam = |seam: &HalvesSeam| {
            let away = seam.axis.dot(&spot.middle).abs().asin();
            away > seam.half_width + OFF_PRINT * spot.radius
        };
        inks.all(|ink| ink < NO_INK) && surface.seams.iter().all(is_off_seam)
    };
    let kept: Vec<(Vec3, Option<Spot>)> = spots
        .filter(|(_, spot)| spot.as_ref().is_none_or(is_bare))
        .map(|(dot, spot)| (*dot, spot))
        .collect();
    let (dots, spots) = kept.into_iter().unzip();
    surface.dots = spots;
    Ok(Pattern::new(dots)?)
}

/// Dots of a mean angular radius anywhere, none on another.
fn drawn_by_hand<R: Rng + ?Sized>(radius: f64, habits: Habits, rng: &mut R) -> Outcome<Pattern> {
    let is_guided = habits == Habits::Guided;
    let [least, most] = if is_guided { GUIDED_DOTS } else { DOTS };
    let wanted = rng.random_range(least..=most);
    let clusters: Vec<Vec3> = match !is_guided && rng.random_bool(CLUSTERED) {
        true => (0..rng.random_range(2..=4))
            .map(|_| random_direction(rng))
            .collect(),
        false => Vec::new(),
    };
    let apart = match is_guided {
        false => GAP[0] * radius + GAP[1],
        true => (2.0 + GUIDED_GAP) * radius,
    };
    let mut dots: Vec<Vec3> = Vec::new();
    // A ball that is full holds fewer.
    for _ in 0..200 * wanted {
        if dots.len() == wanted {
            break;
        }
        let dot = random_direction(rng);
        let nearest = clusters.iter().map(|c| angle_between(c, &dot));
        let nearest = nearest.fold(f64::INFINITY, f64::min);
        let kept = clusters.is_empty() || rng.random_bool((-nearest * nearest).exp().max(0.1));
        if kept && dots.iter().all(|d| angle_between(d, &dot) > apart) {
            dots.push(dot);
        }
    }
    Ok(Pattern::new(dots)?)
}

/// The frames of a ball that a hand turns.
fn turned<R: Rng + ?Sized>(
    scene: &Scene,
    (frames, fps): (usize, f64),
    (habits, strokes): (Habits, Strokes),
    fingers: Option<&SynthConfig>,
    truth: &Pattern,
    rng: &mut R,
) -> Outcome<Vec<Scene>> {
    let (axes, whole) = match habits {
        Habits::Any => {
            let whole = rng.random_range(TURN[0]..TURN[1]);
            let first = random_direction(rng);
            let second = first.cross(&random_direction(rng)).normalize();
            (vec![first, second], whole)
        }
        Habits::Guided => {
            let whole = 3.0 * rng.random_range(GUIDED_TURN[0]..GUIDED_TURN[1]);
            let between = (Vec3::x() + Vec3::y()).normalize();
            (vec![Vec3::y(), Vec3::x(), between], whole)
        }
    };
    let step = (whole / frames as f64).min(MAX_STEP / 1.5);
    let exposure_s = log_between([1.0 / 2000.0, 1.0 / 200.0], rng);
    let mut rotation = random_rotation(rng);
    let mut scene = scene.clone();
    let radius = scene.circle.radius;
    let mut scenes = Vec::with_capacity(frames);
    while scenes.len() < frames {
        let about = axes[axes.len() * scenes.len() / frames];
        let axis = (about + random_direction(rng) * 0.3).normalize();
        let stroke = (rng.random_range(STROKE[0]..STROKE[1]) / step).ceil() as usize;
        let pause = match (strokes, rng.random_range(PAUSE)) {
            (Strokes::Eased, pause) => pause,
            (Strokes::Abrupt, _) => 0,
        };
        scene.occluder = match fingers {
            Some(config) => Some(a_finger(truth, config, rng)?),
            None => None,
        };
        for i in 0..stroke + pause {
            let turn = match strokes {
                Strokes::Eased => stroke_turn(i, stroke, step),
                Strokes::Abrupt => step,
            };
            let turn = axis * turn + random_direction(rng) * TREMOR[0];
            let mut frame = scene.clone();
            frame.rotation = rotation;
            frame.spin = turn * fps;
            frame.exposure_s = exposure_s.min(0.9 / fps);
            frame.shift_px = [0.0; 2];
            frame.circle.center.u += radius * TREMOR[1] * rng.random_range(-1.0..1.0);
            frame.circle.center.v += radius * TREMOR[1] * rng.random_range(-1.0..1.0);
            frame.circle.radius *= 1.0 + TREMOR[2] * rng.random_range(-1.0..1.0);
            frame.noise_seed = rng.random();
            scenes.push(frame);
            rotation = Rotation::from_scaled_axis(turn) * rotation;
        }
    }
    scenes.truncate(frames);
    Ok(scenes)
}

/// The turn of a frame of a stroke, which begins and ends slowly, and of the pause after it; `step` is the mean one.
pub(crate) fn stroke_turn(frame: usize, stroke: usize, step: f64) -> f64 {
    let phase = 0.5 * TAU * (frame as f64 + 0.5) / stroke as f64;
    match frame < stroke {
        true => 1.5 * step * phase.sin(),
        false => 0.0,
    }
}

/// A finger or some of them before the ball.
///
/// # Errors
/// Settings that cannot be drawn from.
pub fn a_finger<R: Rng + ?Sized>(
    truth: &Pattern,
    config: &SynthConfig,
    rng: &mut R,
) -> Outcome<Occluder> {
    let config = SynthConfig {
        occlusion_share: 1.0,
        max_occlusion: 0.3,
        ..config.clone()
    };
    loop {
        let found = Scene::random(truth, &config, rng)?.occluder;
        if let Some(occluder) =
            found.filter(|o| matches!(o.kind, OccluderKind::Finger | OccluderKind::Hand))
        {
            return Ok(occluder);
        }
    }
}

fn log_between<R: Rng + ?Sized>([low, high]: [f64; 2], rng: &mut R) -> f64 {
    low * (high / low).powf(rng.random::<f64>())
}
