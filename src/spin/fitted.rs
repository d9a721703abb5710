//! The motions of a ball, and what became of each.

use super::Fit;
use super::decay::DecayFit;
use super::free::FreeFit;
use super::precession::PrecessionFit;
use crate::error::Error;
use crate::geometry::{Rotation, Vec3};

/// How a ball is taken to move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MotionModel {
    /// As the evidence says.
    #[default]
    Auto,
    /// At one spin.
    Constant,
    /// At a spin that the air slows down.
    Decaying,
    /// As an uneven ball without torque but that of the air.
    Precessing,
    /// Pushed: at a spin that changes smoothly, in whatever way.
    Free,
}

impl MotionModel {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Auto,
        Self::Constant,
        Self::Decaying,
        Self::Precessing,
        Self::Free,
    ];

    /// As written in files and on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Constant => "constant",
            Self::Decaying => "decaying",
            Self::Precessing => "precessing",
            Self::Free => "free",
        }
    }
}

impl std::fmt::Display for MotionModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}

impl std::str::FromStr for MotionModel {
    type Err = Error;

    fn from_str(name: &str) -> crate::error::Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "model", name)
    }
}

/// A motion, as fitted.
// One a sequence: a kilobyte is less trouble than a box.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, PartialEq)]
pub enum FittedMotion {
    /// At one spin.
    Constant(Fit),
    /// At a spin that decays.
    Decaying(DecayFit),
    /// Precessing.
    Precessing(PrecessionFit),
    /// Pushed.
    Free(FreeFit),
}

impl FittedMotion {
    /// Which one it is; never [`MotionModel::Auto`].
    pub fn model(&self) -> MotionModel {
        match self {
            Self::Constant(_) => MotionModel::Constant,
            Self::Decaying(_) => MotionModel::Decaying,
            Self::Precessing(_) => MotionModel::Precessing,
            Self::Free(_) => MotionModel::Free,
        }
    }

    /// The orientation at `time_s`, pattern to camera.
    pub fn predict(&self, time_s: f64) -> Rotation {
        match self {
            Self::Constant(fit) => fit.motion.at(time_s),
            Self::Decaying(fit) => fit.motion.at(time_s),
            Self::Precessing(fit) => fit.motion.at(time_s),
            Self::Free(fit) => fit.predict(time_s),
        }
    }

    /// The spin at `time_s`, the mean one of a ball that precesses, with its covariance, and the orientation then.
    pub fn at(&self, time_s: f64) -> Fit {
        match self {
            Self::Constant(fit) => Fit {
                motion: fit.motion.rebased(time_s),
                ..*fit
            },
            Self::Decaying(fit) => fit.at(time_s),
            Self::Precessing(fit) => fit.mean_at(time_s),
            Self::Free(fit) => fit.at(time_s),
        }
    }

    /// How the ball turns at `time_s`, rad/s; of one that precesses not the mean.
    pub(super) fn spin_at(&self, time_s: f64) -> Vec3 {
        match self {
            Self::Precessing(fit) => {
                let now = fit.motion.rebased(time_s);
                now.space.spin + now.space.orientation * now.body_rate
            }
            _ => self.at(time_s).motion.spin,
        }
    }

    /// Rate at which the spin decays, 1/s; 0 for a constant one.
    pub fn decay_per_s(&self) -> f64 {
        match self {
            Self::Constant(_) | Self::Free(_) => 0.0,
            Self::Decaying(fit) => fit.motion.decay_per_s,
            Self::Precessing(fit) => fit.motion.decay_per_s,
        }
    }

    /// The rotation that is fixed in the ball at `time_s`, pattern frame, rad/s; 0 without a precession.
    pub fn body_rate(&self, time_s: f64) -> Vec3 {
        match self {
            Self::Precessing(fit) => fit.motion.rebased(time_s).body_rate,
            Self::Constant(_) | Self::Decaying(_) | Self::Free(_) => Vec3::zeros(),
        }
    }
}

/// What became of a motion beyond the constant spin.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rival<F> {
    /// It was not asked for.
    NotFitted,
    /// The orientations do not determine it: a ball that hardly turns, a short sequence.
    Open,
    /// The fit, with evidence or without.
    Fitted(F),
}

impl<F> Rival<F> {
    pub(super) fn of(fit: Option<F>) -> Self {
        fit.map_or(Self::Open, Self::Fitted)
    }

    /// The fit, if there is one.
    pub fn fit(&self) -> Option<&F> {
        match self {
            Self::Fitted(fit) => Some(fit),
            Self::NotFitted | Self::Open => None,
        }
    }
}
