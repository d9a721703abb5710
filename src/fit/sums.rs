//! Weighted normal equations, summed over pixels or edges.

use nalgebra::SMatrix;

/// Weighted sums over pixels, of derivatives by `N` unknowns; of the information the lower triangle.
pub(crate) struct Sums<const N: usize> {
    pub information: [[f64; N]; N],
    pub gradient: [f64; N],
    pub squares: f64,
    pub weights: f64,
}

impl<const N: usize> Default for Sums<N> {
    fn default() -> Self {
        Self {
            information: [[0.0; N]; N],
            gradient: [0.0; N],
            squares: 0.0,
            weights: 0.0,
        }
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

    /// Adds a pixel or an edge.
    pub fn add(&mut self, by: &[f64; N], residual: f64, weight: f64) {
        for (k, row) in self.information.iter_mut().enumerate() {
            let weighted = weight * by[k];
            for (cell, other) in row[..=k].iter_mut().zip(by) {
                *cell += weighted * other;
            }
            self.gradient[k] += weighted * residual;
        }
        self.squares += weight * residual * residual;
        self.weights += weight;
    }
}
