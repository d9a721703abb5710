//! The equations of a step: how errors depend on a motion's parameters, and how far its predictions are off.

use nalgebra::{Cholesky, Const, Matrix3, SMatrix, SVector};

use crate::geometry::Vec3;

/// A prediction less certain than this (radians, per axis) is not linear any more: the frame waits.
const PREDICTION_LIMIT: f64 = 0.35;
/// The spin's least known component is undetermined where its share of the information of the best known
/// one is below this: frames in step, with whole turns between them. A spin of a day's sequence is
/// known better.
const MIN_INFORMATION: f64 = 1e-16;

/// Independent normal priors of some rates.
#[derive(Debug, Clone, Copy)]
pub(in crate::spin) struct RatePrior<const P: usize> {
    pub mean: SVector<f64, P>,
    /// Inverse variances; 0 for a rate without a prior.
    pub weight: SVector<f64, P>,
}

impl<const P: usize> RatePrior<P> {
    /// No prior of any rate.
    pub fn none() -> Self {
        Self {
            mean: SVector::zeros(),
            weight: SVector::zeros(),
        }
    }

    /// Log-density at the rates, up to a constant, and its gradient.
    pub(super) fn pull(&self, rates: &SVector<f64, P>) -> (f64, SVector<f64, P>) {
        let off = self.mean - rates;
        let gradient = self.weight.component_mul(&off);
        (-0.5 * off.dot(&gradient), gradient)
    }
}

/// How far a motion's predictions are off: the variance of its orientation, and the covariance of its
/// rates with the mean derivative about which they act.
#[derive(Debug, Clone, Copy)]
pub(in crate::spin) struct RateSpread<const P: usize> {
    /// Variance per axis at the mean derivative, rad^2.
    pub level: f64,
    pub center: SMatrix<f64, 3, P>,
    /// Covariance of the rates, local frame.
    pub rates: SMatrix<f64, P, P>,
}

impl<const P: usize> RateSpread<P> {
    /// Variance per axis of the prediction with this derivative, rad^2.
    pub(super) fn variance(&self, jacobian: &SMatrix<f64, 3, P>) -> f64 {
        let off = jacobian - self.center;
        self.level + (off * self.rates).dot(&off) / 3.0
    }

    /// Whether a prediction with this variance is good enough for a step.
    pub(super) fn is_good(variance: f64) -> bool {
        variance <= PREDICTION_LIMIT * PREDICTION_LIMIT
    }
}

/// A symmetric matrix over a motion's parameters, local frame: a covariance, or an information.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::spin) struct Blocks<const P: usize> {
    pub turn: Matrix3<f64>,
    pub both: SMatrix<f64, 3, P>,
    pub rates: SMatrix<f64, P, P>,
}

impl<const P: usize> Blocks<P> {
    /// `None` where it is not positive definite.
    pub(super) fn inverse(&self) -> Option<Self> {
        let turn = self.turn.cholesky()?.inverse();
        let slope = turn * self.both;
        let rates = (self.rates - self.both.tr_mul(&slope))
            .cholesky()?
            .inverse();
        let both = -slope * rates;
        Some(Self {
            turn: turn - both * slope.transpose(),
            both,
            rates,
        })
    }

    /// All of it multiplied.
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            turn: self.turn * factor,
            both: self.both * factor,
            rates: self.rates * factor,
        }
    }

    /// The covariance of a function of the parameters with these derivatives.
    pub fn propagated<const D: usize>(
        &self,
        by_turn: &SMatrix<f64, D, 3>,
        by_rates: &SMatrix<f64, D, P>,
    ) -> SMatrix<f64, D, D> {
        let mixed = by_turn * self.both * by_rates.transpose();
        by_turn * self.turn * by_turn.transpose()
            + mixed
            + mixed.transpose()
            + by_rates * self.rates * by_rates.transpose()
    }
}

/// The normal equations of a weighted step.
#[derive(Debug, Clone, Copy)]
pub(in crate::spin) struct WeightedNormal<const P: usize> {
    pub(super) weight: f64,
    jacobian: SMatrix<f64, 3, P>,
    squared: SMatrix<f64, P, P>,
    error: Vec3,
    pull: SVector<f64, P>,
}

/// A solution of the normal equations.
pub(super) struct MixtureStep<const P: usize> {
    pub turn: Vec3,
    pub rates: SVector<f64, P>,
    /// Square length in standard deviations.
    pub length: f64,
    pub solved: Cholesky<f64, Const<P>>,
    pub center: SMatrix<f64, 3, P>,
}

impl<const P: usize> MixtureStep<P> {
    /// How far predictions are off after this step of `normal`.
    pub(super) fn spread(&self, normal: &WeightedNormal<P>, widening: f64) -> RateSpread<P> {
        RateSpread {
            level: widening / normal.weight,
            center: self.center,
            rates: self.solved.inverse() * widening,
        }
    }
}

impl<const P: usize> WeightedNormal<P> {
    pub fn new() -> Self {
        Self {
            weight: 0.0,
            jacobian: SMatrix::zeros(),
            squared: SMatrix::zeros(),
            error: Vec3::zeros(),
            pull: SVector::zeros(),
        }
    }

    pub fn add(&mut self, weight: f64, error: &Vec3, jacobian: &SMatrix<f64, 3, P>) {
        let weighted = jacobian * weight;
        self.weight += weight;
        self.error += error * weight;
        self.jacobian += weighted;
        self.squared += weighted.tr_mul(jacobian);
        self.pull += weighted.tr_mul(error);
    }

    /// Those of the measurements of both.
    pub fn joined(&self, other: &Self) -> Self {
        Self {
            weight: self.weight + other.weight,
            jacobian: self.jacobian + other.jacobian,
            squared: self.squared + other.squared,
            error: self.error + other.error,
            pull: self.pull + other.pull,
        }
    }

    /// What a step without priors takes from the weighted squared errors; `None` where the rates are undetermined.
    pub fn reduction(&self) -> Option<f64> {
        let step = self.step(&SVector::zeros(), &RatePrior::none(), 0.0)?;
        Some(step.length)
    }

    /// The step with a damping (a share of the diagonal); `None` where the rates are undetermined.
    pub(super) fn step(
        &self,
        rates: &SVector<f64, P>,
        prior: &RatePrior<P>,
        damping: f64,
    ) -> Option<MixtureStep<P>> {
        let center = self.jacobian / self.weight;
        let gradient = self.pull + prior.pull(rates).1 - center.tr_mul(&self.error);
        let mut information =
            self.squared + SMatrix::from_diagonal(&prior.weight) - center.tr_mul(&self.jacobian);
        for i in 0..P {
            information[(i, i)] *= 1.0 + damping;
        }
        let solved = information.cholesky()?;
        let along = self.squared.diagonal().fixed_rows::<3>(0).max();
        let known = |i: usize| solved.l_dirty()[(i, i)].powi(2) > MIN_INFORMATION * along;
        if !(0..3).all(known) {
            return None;
        }
        let change = solved.solve(&gradient);
        let length = change.dot(&gradient) + self.error.norm_squared() / self.weight;
        Some(MixtureStep {
            turn: self.error / self.weight - center * change,
            rates: change,
            length,
            solved,
            center,
        })
    }
}
