//! Clips of balls painted with blotches: on a treadmill, turned by hand, and in flight.

use std::f64::consts::TAU;

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use spindoe::geometry::{Rotation, Vec3, random_direction, random_rotation, spiral_directions};
use spindoe::pattern::Pattern;
use spindoe::synth::blotches::Blotches;
use spindoe::synth::{Rendering, Scene, SynthConfig, SynthKind};

use crate::Outcome;

/// What is done with the ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Handling {
    /// It floats in a cup, in one place, and an animal turns it.
    Treadmill,
    /// A hand turns it, with pauses, and fingers before it.
    Hand,
    /// It flies at a constant spin.
    Flight,
}

impl Handling {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Treadmill, Self::Hand, Self::Flight];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Treadmill => "treadmill",
            Self::Hand => "turned by hand",
            Self::Flight => "in flight",
        }
    }
}

/// A clip that is yet to be rendered.
pub struct PaintedClip {
    /// Frames per second.
    pub fps: f64,
    /// Diameter of the ball, pixels.
    pub ball_px: f64,
    /// The spin of a ball in flight, camera frame, rad/s.
    pub spin: Option<Vec3>,
    /// The frames.
    pub scenes: Vec<Scene>,
}

/// Frames of balls that have nothing to do with each other.
const UNRELATED: usize = 24;
const UNRELATED_PX: [f64; 2] = [30.0, 120.0];
/// Diameters of the balls, pixels.
const BALL_PX: [f64; 2] = [50.0, 200.0];

impl PaintedClip {
    /// The clip `k` of a seed; `again` is another clip of the same ball, under the same light.
    ///
    /// # Errors
    /// Settings that cannot be drawn from.
    pub fn random(handling: Handling, seed: u64, k: u64, again: u64) -> Outcome<Self> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(k);
        let config = config(handling, &mut rng);
        let stand_in = Pattern::new(spiral_directions(12).collect())?;
        let scene = Scene::random(&stand_in, &config, &mut rng)?;
        let seed = rng.random::<u64>() ^ again;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let fingers = (handling == Handling::Hand && rng.random_bool(0.67)).then_some(&config);
        let mut clip = Self {
            fps: match handling {
                Handling::Treadmill => rng.random_range(60.0..200.0),
                Handling::Hand => 30.0,
                Handling::Flight => 350.0,
            },
            ball_px: 2.0 * scene.circle.radius,
            spin: None,
            scenes: Vec::new(),
        };
        match handling {
            Handling::Treadmill => clip.treadmill(scene, &mut rng),
            Handling::Hand => clip.hand(scene, fingers, &stand_in, &mut rng)?,
            Handling::Flight => clip.flight(scene, &mut rng),
        }
        Ok(clip)
    }

    /// Frames each of which shows another ball, of one size.
    ///
    /// # Errors
    /// Settings that cannot be drawn from.
    pub fn unrelated(seed: u64, k: u64) -> Outcome<Self> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(k);
        let px = UNRELATED_PX[0] * (UNRELATED_PX[1] / UNRELATED_PX[0]).powf(rng.random::<f64>());
        let config = SynthConfig {
            ball_px: Some([px; 2]),
            ..config(Handling::Flight, &mut rng)
        };
        let stand_in = Pattern::new(spiral_directions(12).collect())?;
        let scenes: Outcome<Vec<Scene>> = (0..UNRELATED)
            .map(|_| Ok(Scene::random(&stand_in, &config, &mut rng)?))
            .collect();
        let scenes = scenes?;
        Ok(Self {
            fps: 350.0,
            ball_px: 2.0 * scenes[0].circle.radius,
            spin: None,
            scenes,
        })
    }

    fn push<R: Rng + ?Sized>(&mut self, scene: &Scene, turn: Vec3, exposure_s: f64, rng: &mut R) {
        let mut frame = scene.clone();
        frame.spin = turn * self.fps;
        frame.exposure_s = exposure_s.min(0.9 / self.fps);
        frame.noise_seed = rng.random();
        self.scenes.push(frame);
    }

    /// The turn from frame to frame wanders smoothly, up to 30 degrees.
    fn treadmill<R: Rng + ?Sized>(&mut self, mut scene: Scene, rng: &mut R) {
        let frames = rng.random_range(100..200);
        let lively = 0.5 * rng.random_range(0.02..0.2f64);
        let keep = (-1.0 / rng.random_range(5.0..30.0f64)).exp();
        let exposure_s = rng.random_range(5e-4..3e-3);
        let mut turn = random_direction(rng) * lively;
        scene.rotation = random_rotation(rng);
        scene.shift_px = [0.0; 2];
        for _ in 0..frames {
            self.push(&scene, turn, exposure_s, rng);
            scene.rotation = Rotation::from_scaled_axis(turn) * scene.rotation;
            let mut kick = || rng.sample::<f64, _>(StandardNormal);
            let kick = Vec3::new(kick(), kick(), kick()) * (lively * (1.0 - keep * keep).sqrt());
            turn = turn * keep + kick;
            turn *= (0.52 / turn.norm()).min(1.0);
        }
    }

    /// Strokes about an axis that changes, with pauses.
    fn hand<R: Rng + ?Sized>(
        &mut self,
        mut scene: Scene,
        fingers: Option<&SynthConfig>,
        stand_in: &Pattern,
        rng: &mut R,
    ) -> Outcome {
        let frames = rng.random_range(80..160);
        let step: f64 = rng.random_range(0.04..0.17);
        let exposure_s = rng.random_range(5e-4..5e-3);
        scene.rotation = random_rotation(rng);
        scene.shift_px = [0.0; 2];
        let still = scene.circle;
        while self.scenes.len() < frames {
            let axis = random_direction(rng);
            let stroke = (rng.random_range(TAU / 3.0..TAU) / step).ceil() as usize;
            let pause: usize = rng.random_range(0..=8);
            scene.occluder = match fingers {
                Some(config) => crate::hand::a_finger(stand_in, config, rng).map(Some)?,
                None => None,
            };
            for i in 0..stroke + pause {
                let turn = axis * crate::hand::stroke_turn(i, stroke, step)
                    + random_direction(rng) * 0.004;
                scene.circle = still;
                let mut shake = || 0.01 * still.radius * rng.random_range(-1.0..1.0);
                scene.circle.center.u += shake();
                scene.circle.center.v += shake();
                self.push(&scene, turn, exposure_s, rng);
                scene.rotation = Rotation::from_scaled_axis(turn) * scene.rotation;
            }
        }
        self.scenes.truncate(frames);
        Ok(())
    }

    /// A constant spin, on a straight path.
    fn flight<R: Rng + ?Sized>(&mut self, mut scene: Scene, rng: &mut R) {
        let frames = rng.random_range(12..40);
        let turn = random_direction(rng) * rng.random_range(0.02..0.7);
        let exposure_s = rng.random_range(1e-4..5e-4);
        scene.rotation = random_rotation(rng);
        let way = 0.5 * scene.circle.radius;
        let (s, c) = rng.random_range(0.0..TAU).sin_cos();
        self.spin = Some(turn * self.fps);
        let step = [c, s].map(|x| x * way / frames as f64);
        scene.circle.center.u -= 0.5 * c * way;
        scene.circle.center.v -= 0.5 * s * way;
        for _ in 0..frames {
            scene.shift_px = step.map(|x| x * exposure_s * self.fps);
            self.push(&scene, turn, exposure_s, rng);
            scene.rotation = Rotation::from_scaled_axis(turn) * scene.rotation;
            scene.circle.center.u += step[0];
            scene.circle.center.v += step[1];
        }
    }

    /// Renders the frames and gives each to `take`.
    ///
    /// # Errors
    /// A scene that cannot be rendered.
    pub fn show(&self, mut take: impl FnMut(&Rendering)) -> Outcome {
        for scene in &self.scenes {
            take(&scene.render()?);
        }
        Ok(())
    }
}

fn config<R: Rng + ?Sized>(handling: Handling, rng: &mut R) -> SynthConfig {
    let px = BALL_PX[0] * (BALL_PX[1] / BALL_PX[0]).powf(rng.random::<f64>());
    SynthConfig {
        kind: SynthKind::Dotless,
        ball_px: Some([px; 2]),
        fill: [0.6, 0.75],
        ambient: [0.1, 0.8],
        max_noise: 6.0,
        defocus_px: [0.2, 1.0],
        max_background: 0.8,
        blotches: Some(Blotches::default()),
        infrared: handling == Handling::Treadmill,
        ..SynthConfig::good()
    }
}
