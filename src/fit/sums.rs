//! Weighted normal equations, summed over pixels or edges.

use std::ops::{AddAssign, Mul};

use nalgebra::SMatrix;

/// Weighted sums over pixels, of derivatives by `N` unknowns; of the information the lower triangle. Of numbers, or of lanes of them.
pub(crate) struct Sums<const N: usize, T = f64> {
    pub information: [[T; N]; N],
    pub gradient: [T; N],
    pub squares: T,
    pub weights: T,
}

impl<const N: usize> Default for Sums<N> {
    fn default() -> Self {
        Self::from_zero(0.0)
    }
}

impl<const N: usize, T: Copy + AddAssign + Mul<Output = T>> Sums<N, T> {
    /// Of nothing: all are this.
    #[inline(always)]
    pub fn from_zero(zero: T) -> Self {
        Self {
            information: [[zero; N]; N],
            gradient: [zero; N],
            squares: zero,
            weights: zero,
        }
    }

    /// Adds a pixel or an edge, or one in each lane.
    #[inline(always)]
    pub fn add(&mut self, by: &[T; N], residual: T, weight: T) {
        for (k, row) in self.information.iter_mut().enumerate() {
            let weighted = weight * by[k];
            for (cell, other) in row[..=k].iter_mut().zip(by) {
                *cell += weighted * *other;
            }
            self.gradient[k] += weighted * residual;
        }
        self.squares += weight * residual * residual;
        self.weights += weight;
    }
}

impl<const N: usize> Sums<N> {
    /// Both triangles.
    pub fn symmetric(&self) -> SMatrix<f64, N, N> {
        SMatrix::from_fn(|row, column| self.information[row.max(column)][row.min(column)])
    }

    /// The residuals' standard deviation.
    pub fn scatter(&self) -> f64 {
        (self.squares / self.weights).sqrt()
    }
}
