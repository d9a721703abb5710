//! One simulated view of a pattern, with its ground truth.

use nalgebra::{Matrix2, Unit};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::protocol::{Noise, Protocol};
use crate::geometry::{
    Rotation, Vec3, random_direction, random_direction_above, random_rotation, tangent_frame,
};
use crate::pattern::Pattern;
use crate::recognize::observed::ObservedFrame;
use crate::recognize::{DotUncertainty, ObservedDot};

/// Minimum standard deviation given to a recognizer, radians: noise-free trials must not divide by
/// zero.
const MIN_SIGMA_RAD: f64 = 1e-4;
/// Minimum z, towards the limb, at which a back-projected dot's uncertainty is linearized.
const LIMB_Z: f64 = 0.1;

/// A view and its truth.
#[derive(Debug, Clone, Default)]
pub struct Trial {
    /// Maps pattern to camera.
    pub rotation: Rotation,
    /// The dots as given to the recognizer.
    pub dots: Vec<ObservedDot>,
    /// Each dot's index in the pattern, or `None` for a false dot.
    pub truth: Vec<Option<u16>>,
    given: Vec<(ObservedDot, Option<u16>)>,
}

impl Trial {
    /// Dots that are the pattern's.
    pub fn real_dots(&self) -> usize {
        self.truth.iter().flatten().count()
    }

    /// Copies what is given to the recognizer, in this order.
    pub(super) fn fill(&mut self, given: impl Iterator<Item = (ObservedDot, Option<u16>)>) {
        self.dots.clear();
        self.truth.clear();
        for (dot, index) in given {
            self.dots.push(dot);
            self.truth.push(index);
        }
    }
}

/// The random numbers of a protocol's trials: each trial has its own stream.
#[derive(Debug, Clone)]
pub(super) struct Draws {
    pub protocol: Protocol,
    pub rng: ChaCha8Rng,
}

impl Draws {
    pub fn new(protocol: Protocol, seed: u64) -> Self {
        Self {
            protocol,
            rng: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// Moves to trial number `index` from any position, and draws its rotation.
    pub fn begin(&mut self, index: u64) -> Rotation {
        self.rng.set_stream(index);
        self.rng.set_word_pos(0);
        random_rotation(&mut self.rng)
    }

    /// The dot as measured, with the uncertainty that a careful estimator would state.
    pub fn displaced(&mut self, q: &Vec3) -> ObservedDot {
        displaced(q, &self.protocol.noise, &mut self.rng)
    }

    /// A false dot: uniform on the visible cap.
    pub fn false_dot(&mut self) -> ObservedDot {
        let direction = random_direction_above(&mut self.rng, self.protocol.visibility_limit);
        ObservedDot {
            direction,
            uncertainty: uncertainty(&direction, &self.protocol.noise),
        }
    }

    /// The number of dots that the protocol gives out of those visible. A view with fewer than it
    /// requests is skipped.
    pub fn given_of(&self, visible: usize) -> usize {
        match self.protocol.dots_given {
            Some(given) if visible < given => 0,
            Some(given) => given,
            None => visible,
        }
    }
}

/// Makes trials of a protocol.
#[derive(Debug, Clone)]
pub struct TrialGenerator<'p> {
    pattern: &'p Pattern,
    draws: Draws,
}

impl<'p> TrialGenerator<'p> {
    /// A generator of the trials that belong to `seed`.
    pub fn new(pattern: &'p Pattern, protocol: Protocol, seed: u64) -> Self {
        Self {
            pattern,
            draws: Draws::new(protocol, seed),
        }
    }

    /// Makes trial number `index`, independent of earlier calls.
    pub fn generate(&mut self, index: u64, trial: &mut Trial) {
        let draws = &mut self.draws;
        let p = draws.protocol;
        trial.rotation = draws.begin(index);
        let mut given = std::mem::take(&mut trial.given);
        given.clear();
        for (j, dot) in self.pattern.dots().iter().enumerate() {
            let q = trial.rotation * dot;
            if q.z > p.visibility_limit {
                given.push((draws.displaced(&q), Some(j as u16)));
            }
        }
        if p.dots_given.is_some() {
            given.shuffle(&mut draws.rng);
            given.truncate(draws.given_of(given.len()));
        }
        if p.miss_probability > 0.0 {
            given.retain(|_| draws.rng.random::<f64>() >= p.miss_probability);
        }
        for _ in 0..p.false_dots {
            given.push((draws.false_dot(), None));
        }
        given.shuffle(&mut draws.rng);
        trial.fill(given.iter().copied());
        trial.given = given;
    }
}

/// The views of a validation as a detector would report them, named `trial-0`, `trial-1`, ...;
/// views with too few real dots for the protocol are left out.
pub fn observed_frames(
    pattern: &Pattern,
    protocol: &Protocol,
    seed: u64,
    samples: u64,
) -> Vec<ObservedFrame> {
    let mut generator = TrialGenerator::new(pattern, *protocol, seed);
    let mut trial = Trial::default();
    let mut frame = |index: u64| {
        generator.generate(index, &mut trial);
        (trial.real_dots() >= protocol.min_dots).then(|| ObservedFrame {
            name: format!("trial-{index}"),
            time_s: None,
            dots: trial.dots.clone(),
        })
    };
    (0..samples).filter_map(&mut frame).collect()
}

/// The dot as measured, with its uncertainty.
fn displaced(q: &Vec3, noise: &Noise, rng: &mut ChaCha8Rng) -> ObservedDot {
    let direction = match *noise {
        Noise::RandomAxis { sigma_rad } => {
            let axis = Unit::new_unchecked(random_direction(rng));
            let z: f64 = StandardNormal.sample(rng);
            Rotation::from_axis_angle(&axis, sigma_rad * z) * q
        }
        Noise::Pixel {
            sigma_px,
            radius_px,
        } => {
            let (a, b): (f64, f64) = (StandardNormal.sample(rng), StandardNormal.sample(rng));
            let sigma = sigma_px / radius_px;
            let (x, y) = (q.x + sigma * a, q.y + sigma * b);
            let r2 = x * x + y * y;
            // A dot measured beyond the limb is taken to lie on it.
            Vec3::new(x, y, (1.0 - r2).max(0.0).sqrt()).normalize()
        }
    };
    ObservedDot {
        direction,
        uncertainty: uncertainty(&direction, noise),
    }
}

/// The uncertainty of a dot measured at `direction` under this noise.
fn uncertainty(direction: &Vec3, noise: &Noise) -> DotUncertainty {
    match *noise {
        Noise::RandomAxis { sigma_rad } => DotUncertainty::Isotropic {
            sigma_rad: (sigma_rad / 3f64.sqrt()).max(MIN_SIGMA_RAD),
        },
        Noise::Pixel {
            sigma_px,
            radius_px,
        } => {
            // Orthographic: a tangent step t moves the image by its x and y; along the radius it is
            // foreshortened by z.
            let s = (sigma_px / radius_px).max(MIN_SIGMA_RAD);
            let along = s / direction.z.max(LIMB_Z);
            let [e1, e2] = tangent_frame(direction);
            // The tangent direction that runs outward in the image (towards -z).
            let outward = direction * direction.z - Vec3::z();
            let norm = outward.norm();
            let (c, d) = if norm > 1e-9 {
                (outward.dot(&e1) / norm, outward.dot(&e2) / norm)
            } else {
                (1.0, 0.0)
            };
            let (v, w) = (along * along, s * s);
            let off = (v - w) * c * d;
            DotUncertainty::Tangent {
                covariance: Matrix2::new(v * c * c + w * d * d, off, off, v * d * d + w * c * c),
            }
        }
    }
}
