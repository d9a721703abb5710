//! Weighted normal equations of residuals that are vectors.

use nalgebra::{SMatrix, SVector};

/// The normal equations of `N` unknowns, and minus two logarithms of the likelihood where these are kept.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Normal<const N: usize> {
    pub information: SMatrix<f64, N, N>,
    pub gradient: SVector<f64, N>,
    pub cost: f64,
}

impl<const N: usize> Default for Normal<N> {
    fn default() -> Self {
        Self {
            information: SMatrix::zeros(),
            gradient: SVector::zeros(),
            cost: 0.0,
        }
    }
}

impl<const N: usize> Normal<N> {
    /// Adds a residual of this information, by its derivatives, but for its cost, which its loss gives.
    pub fn add<const M: usize>(
        &mut self,
        by: &SMatrix<f64, M, N>,
        residual: &SVector<f64, M>,
        information: &SMatrix<f64, M, M>,
    ) {
        let weighted = by.transpose() * information;
        self.information += weighted * by;
        self.gradient += weighted * residual;
    }

    /// Adds what is known of one unknown: how far it is off that, and the standard deviation.
    pub fn hold(&mut self, unknown: usize, off: f64, sigma: f64) {
        let weight = sigma.powi(-2);
        self.information[(unknown, unknown)] += weight;
        self.gradient[unknown] += off * weight;
        self.cost += off * off * weight;
    }

    /// The step to the minimum; `None` where the equations are singular.
    pub fn step(&self) -> Option<SVector<f64, N>> {
        Some(self.information.cholesky()?.solve(&self.gradient))
    }
}
