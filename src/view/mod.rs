//! What is seen of a ball: one model of a view, from which trials are drawn and likelihoods follow.
//!
//! A view shows the ball at a rotation uniform on SO(3). Its dots above the visibility limit are
//! detected or missed; each detected one is moved by noise; false dots are added. A small share of
//! views shows something else, or the ball's mirror image. The probability of the observed dots
//! `o_1 .. o_m`, given the rotation `R` and the assignment `A`, is
//!
//! ```text
//! p(o, A | R) = P(detected, missed | R)  prod_matched N(o_i; R p_A(i), C_i)  P(k) k! rho^k / m!
//! ```
//!
//! with `N` the noise's density ([`Noise`]), `k` the number of false dots ([`FalseDots`]), uniform
//! over a cap of density `rho = 1 / area`, and the detections either independent or a fixed number
//! of the visible dots ([`Detection`]).
//!
//! One [`ViewModel`] draws the trials of a validation ([`TrialGenerator`]), gives the robust recognizer its
//! likelihoods, is what learning finds from frames, and states what objectives and bounds assume.
//! The validation's protocols are named instances ([`ProtocolName::view`]). No number of it belongs
//! to a certain pattern.
//!
//! What it leaves out: the error that all dots of an image share (the outline's), dots that hide
//! each other, and everything that makes one dot harder to detect than another but its depth.

mod dot;
mod false_dots;
mod noise;
mod protocol;
mod trial;

use std::f64::consts::TAU;

pub use dot::{DotUncertainty, ObservedDot};
pub use false_dots::FalseDots;
pub(crate) use noise::POLE;
pub use noise::{Noise, NoiseShape};
pub use protocol::{Protocol, ProtocolName};
pub use trial::{Trial, TrialGenerator};

use crate::error::{Result, require};

/// Width, in z, over which a dot fades from visible to hidden at the limit: the noise moves dots
/// across it.
pub(crate) const VISIBILITY_SOFTNESS: f64 = 0.03;
/// The logistic curve of this slope approximates the normal distribution function.
pub(crate) const LOGISTIC: f64 = 1.7;

/// Which of the visible dots are given.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Detection {
    /// Each one on its own.
    Each {
        /// Probability that a dot well inside the visible cap is detected, (0, 1].
        probability: f64,
    },
    /// A fixed number of them, chosen at random; a view that shows fewer is none.
    Given {
        /// The number.
        dots: usize,
    },
}

/// A model of what is seen of a ball. See the module's head.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ViewModel {
    /// Minimum z of a visible dot (camera frame, ball of radius 1).
    pub visibility_limit: f64,
    /// Noise of a dot's position, as the observer states it.
    pub noise: Noise,
    /// Ratio of the noise's true standard deviation to that which the observer states.
    pub noise_scale: f64,
    /// Which of the visible dots are given.
    pub detection: Detection,
    /// Number of false dots in a view.
    pub false_dots: FalseDots,
    /// Minimum z of a false dot: they are uniform over the cap above it.
    pub false_dot_limit: f64,
    /// Share of the views that show something else than this ball, [0, 1).
    pub foreign_share: f64,
    /// Share of the views that show the ball's mirror image: an axis of the image is flipped, [0, 1).
    pub mirrored_share: f64,
    /// Views with fewer real dots are no identifications.
    pub min_dots: usize,
}

impl Default for ViewModel {
    /// What is expected where nothing is known: z > 0 visible, 90 % detected, half a false dot a
    /// view, one view in five of something else and one in 25 mirrored, noise of 3 degrees over
    /// sqrt 3 with a detector's tails.
    fn default() -> Self {
        Self {
            visibility_limit: 0.0,
            noise: Noise::HeavyTailed {
                sigma_rad: 3f64.to_radians() / 3f64.sqrt(),
            },
            noise_scale: 1.0,
            detection: Detection::Each { probability: 0.9 },
            false_dots: FalseDots::Poisson(0.5),
            false_dot_limit: 0.0,
            foreign_share: 0.2,
            mirrored_share: 0.04,
            min_dots: 3,
        }
    }
}

impl ViewModel {
    /// Checks the domains of all values.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) naming the parameter.
    pub fn check(&self) -> Result<()> {
        self.noise.check()?;
        let is_cap = |z: f64| (-1.0..1.0).contains(&z);
        let z = self.visibility_limit;
        require(is_cap(z), "visibility_limit", "a z in [-1, 1)", z)?;
        let z = self.false_dot_limit;
        require(is_cap(z), "false_dot_limit", "a z in [-1, 1)", z)?;
        let scale = self.noise_scale;
        let inside = scale > 0.0 && scale.is_finite();
        require(inside, "noise_scale", "a positive number", scale)?;
        match self.detection {
            Detection::Each { probability: p } => {
                let inside = p > 0.0 && p <= 1.0;
                require(
                    inside,
                    "detection_probability",
                    "a probability in (0, 1]",
                    p,
                )?;
            }
            Detection::Given { dots } => require(dots > 0, "dots_given", "1 or more", dots)?,
        }
        self.false_dots.check()?;
        let (foreign, mirrored) = (self.foreign_share, self.mirrored_share);
        let is_share = |x: f64| (0.0..1.0).contains(&x);
        require(
            is_share(foreign),
            "foreign_share",
            "a share in [0, 1)",
            foreign,
        )?;
        require(
            is_share(mirrored),
            "mirrored_share",
            "a share in [0, 1)",
            mirrored,
        )?;
        let both = foreign + mirrored;
        require(
            both < 1.0,
            "foreign_share",
            "less than 1 with the mirrored share",
            both,
        )
    }

    /// The same model with another size of the noise, [`Noise::sigma_rad`].
    #[must_use]
    pub fn with_sigma_rad(mut self, sigma_rad: f64) -> Self {
        self.noise = self.noise.with_sigma_rad(sigma_rad);
        self
    }

    /// Share of the visible dots of a pattern that are detected, on average over its views.
    pub fn detection_rate(&self, pattern_dots: usize) -> f64 {
        match self.detection {
            Detection::Each { probability } => probability,
            Detection::Given { dots } => {
                let visible = self.mean_visible(pattern_dots);
                (dots as f64 / visible.max(f64::MIN_POSITIVE)).min(1.0)
            }
        }
    }

    /// Mean number of visible dots of a pattern: each is visible over the same share of the sphere.
    pub fn mean_visible(&self, pattern_dots: usize) -> f64 {
        0.5 * (1.0 - self.visibility_limit) * pattern_dots as f64
    }

    /// Mean number of dots in a view, real and false.
    pub fn mean_dots(&self, pattern_dots: usize) -> f64 {
        let real = self.mean_visible(pattern_dots) * self.detection_rate(pattern_dots);
        real + self.false_dots.mean()
    }

    /// ln of the density of a false dot, per steradian.
    pub(crate) fn ln_false_density(&self) -> f64 {
        -(TAU * (1.0 - self.false_dot_limit.max(-0.999))).ln()
    }
}

/// Probability that a dot at this z is visible, by the noise about the limit.
pub(crate) fn visible(z: f64, limit: f64) -> f64 {
    let t = LOGISTIC * (z - limit) / VISIBILITY_SOFTNESS;
    1.0 / (1.0 + (-t.clamp(-20.0, 20.0)).exp())
}
