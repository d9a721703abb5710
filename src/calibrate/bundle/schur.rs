//! The normal equations of frames in a chain and of what they share, by the Schur complement.
//!
//! The unknowns are a block `x_k` a frame and a border `p` that all frames share. Frames are coupled
//! with their neighbors in time only, so that the matrix is block tridiagonal with a border:
//!
//! ```text
//! | D U   W |  x     g
//! | U' D  W |  .  =  .
//! | W' W' C |  p     c
//! ```
//!
//! With the block Cholesky factors `D_k - N_(k-1)^T N_(k-1) = L_k L_k^T`, `N_k = L_k^-1 U_k` and
//! `Y_k = L_k^-1 (W_k - N_(k-1)^T Y_(k-1))` the border's matrix is `S = C - sum Y_k^T Y_k`. The cost is
//! linear in the number of frames. `S^-1` is the border's covariance with all frames marginalized
//! (B. Triggs et al., "Bundle adjustment: a modern synthesis", 2000, Sec. 6.1).

use nalgebra::{Cholesky, Const, DMatrix, DVector, Dyn, OMatrix, SMatrix, SVector};

/// Unknowns of a frame.
pub(super) const BLOCK: usize = 9;

pub(super) type Block = SMatrix<f64, BLOCK, BLOCK>;
pub(super) type BlockVector = SVector<f64, BLOCK>;
/// A frame's rows of the border.
pub(super) type Border = OMatrix<f64, Const<BLOCK>, Dyn>;

/// The normal equations.
#[derive(Debug, Clone)]
pub(super) struct NormalEquations {
    /// A block a frame, and its coupling with the next one.
    pub diagonal: Vec<Block>,
    pub coupling: Vec<Block>,
    pub border: Vec<Border>,
    pub corner: DMatrix<f64>,
    pub gradient: Vec<BlockVector>,
    pub corner_gradient: DVector<f64>,
}

/// A solution: the step of every frame and of the border.
pub(super) struct BundleStep {
    pub frames: Vec<BlockVector>,
    pub border: DVector<f64>,
}

/// The factors of [`NormalEquations`].
struct Factors {
    lower: Vec<Cholesky<f64, Const<BLOCK>>>,
    next: Vec<Block>,
    border: Vec<Border>,
    gradient: Vec<BlockVector>,
    schur: DMatrix<f64>,
    schur_gradient: DVector<f64>,
}

impl NormalEquations {
    /// All zero, for so many frames and so long a border.
    pub fn new(frames: usize, border: usize) -> Self {
        Self {
            diagonal: vec![Block::zeros(); frames],
            coupling: vec![Block::zeros(); frames.saturating_sub(1)],
            border: vec![Border::zeros(border); frames],
            corner: DMatrix::zeros(border, border),
            gradient: vec![BlockVector::zeros(); frames],
            corner_gradient: DVector::zeros(border),
        }
    }

    /// Sets everything to zero.
    pub fn clear(&mut self) {
        self.diagonal.fill(Block::zeros());
        self.coupling.fill(Block::zeros());
        for border in &mut self.border {
            border.fill(0.0);
        }
        self.corner.fill(0.0);
        self.gradient.fill(BlockVector::zeros());
        self.corner_gradient.fill(0.0);
    }

    /// The step, with the diagonal grown by the share `damping`; `None` where the matrix is not
    /// positive definite.
    pub fn solve(&self, damping: f64) -> Option<BundleStep> {
        let f = self.factor(damping)?;
        let border = Cholesky::new(f.schur)?.solve(&f.schur_gradient);
        let mut frames = vec![BlockVector::zeros(); f.lower.len()];
        for k in (0..frames.len()).rev() {
            let mut rest = f.gradient[k] - &f.border[k] * &border;
            if let Some(after) = frames.get(k + 1) {
                rest -= f.next[k] * after;
            }
            // L^T x = rest.
            f.lower[k]
                .l_dirty()
                .tr_solve_lower_triangular_mut(&mut rest);
            frames[k] = rest;
        }
        Some(BundleStep { frames, border })
    }

    /// As [`solve`](Self::solve), with the step of one of the border's unknowns given.
    pub fn solve_given(&self, damping: f64, at: usize, step: f64) -> Option<BundleStep> {
        let mut given = self.clone();
        for (gradient, border) in given.gradient.iter_mut().zip(&mut given.border) {
            *gradient -= border.column(at) * step;
            border.column_mut(at).fill(0.0);
        }
        given.corner_gradient -= given.corner.column(at) * step;
        given.corner.column_mut(at).fill(0.0);
        given.corner.row_mut(at).fill(0.0);
        given.corner[(at, at)] = 1.0;
        // The damping takes nothing off what is given.
        given.corner_gradient[at] = step * (1.0 + damping);
        given.solve(damping)
    }

    /// The border's covariance with all frames marginalized.
    pub fn border_covariance(&self) -> Option<DMatrix<f64>> {
        Some(Cholesky::new(self.factor(0.0)?.schur)?.inverse())
    }

    fn factor(&self, damping: f64) -> Option<Factors> {
        let count = self.diagonal.len();
        let mut corner = self.corner.clone();
        for i in 0..corner.nrows() {
            corner[(i, i)] *= 1.0 + damping;
        }
        let mut f = Factors {
            lower: Vec::with_capacity(count),
            next: Vec::with_capacity(count),
            border: Vec::with_capacity(count),
            gradient: Vec::with_capacity(count),
            schur: corner,
            schur_gradient: self.corner_gradient.clone(),
        };
        for k in 0..count {
            let mut diagonal = self.diagonal[k];
            for i in 0..BLOCK {
                diagonal[(i, i)] *= 1.0 + damping;
            }
            let mut border = self.border[k].clone();
            let mut gradient = self.gradient[k];
            if k > 0 {
                let before = &f.next[k - 1];
                diagonal -= before.tr_mul(before);
                border -= before.tr_mul(&f.border[k - 1]);
                gradient -= before.tr_mul(&f.gradient[k - 1]);
            }
            let lower = diagonal.cholesky()?;
            lower.l_dirty().solve_lower_triangular_mut(&mut border);
            lower.l_dirty().solve_lower_triangular_mut(&mut gradient);
            f.next.push(match self.coupling.get(k) {
                Some(coupling) => lower.l_dirty().solve_lower_triangular(coupling)?,
                None => Block::zeros(),
            });
            f.schur.gemm_tr(-1.0, &border, &border, 1.0);
            f.schur_gradient.gemv_tr(-1.0, &border, &gradient, 1.0);
            f.lower.push(lower);
            f.border.push(border);
            f.gradient.push(gradient);
        }
        Some(f)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// A positive definite system of this structure, and the same as one dense matrix.
    fn random(frames: usize, border: usize) -> (NormalEquations, DMatrix<f64>, DVector<f64>) {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut system = NormalEquations::new(frames, border);
        let size = frames * BLOCK + border;
        let mut dense = DMatrix::zeros(size, size);
        let mut gradient = DVector::zeros(size);
        let mut draw = || rng.random_range(-1.0..1.0);
        for k in 0..frames {
            for i in 0..BLOCK {
                system.diagonal[k][(i, i)] = 20.0 + draw();
                system.gradient[k][i] = draw();
                for j in 0..border {
                    system.border[k][(i, j)] = draw();
                }
                if k + 1 < frames {
                    for j in 0..BLOCK {
                        system.coupling[k][(i, j)] = draw();
                    }
                }
            }
            let at = k * BLOCK;
            dense
                .view_mut((at, at), (BLOCK, BLOCK))
                .copy_from(&system.diagonal[k]);
            gradient.rows_mut(at, BLOCK).copy_from(&system.gradient[k]);
            dense
                .view_mut((at, frames * BLOCK), (BLOCK, border))
                .copy_from(&system.border[k]);
            if k + 1 < frames {
                dense
                    .view_mut((at, at + BLOCK), (BLOCK, BLOCK))
                    .copy_from(&system.coupling[k]);
            }
        }
        for i in 0..border {
            system.corner[(i, i)] = 40.0 + draw();
            system.corner_gradient[i] = draw();
        }
        let at = frames * BLOCK;
        dense
            .view_mut((at, at), (border, border))
            .copy_from(&system.corner);
        gradient
            .rows_mut(at, border)
            .copy_from(&system.corner_gradient);
        dense.fill_lower_triangle_with_upper_triangle();
        (system, dense, gradient)
    }

    #[test]
    fn the_schur_complement_solves_the_dense_system() {
        for frames in [1, 2, 7] {
            let (system, dense, gradient) = random(frames, 5);
            let step = system.solve(0.0).unwrap();
            let expected = dense.clone().lu().solve(&gradient).unwrap();
            for (k, x) in step.frames.iter().enumerate() {
                assert!((x - expected.rows(k * BLOCK, BLOCK)).norm() < 1e-12);
            }
            assert!((&step.border - expected.rows(frames * BLOCK, 5)).norm() < 1e-12);
            let inverse = dense.try_inverse().unwrap();
            let at = frames * BLOCK;
            let found = system.border_covariance().unwrap();
            assert!((found - inverse.view((at, at), (5, 5))).norm() < 1e-12);
        }
    }

    #[test]
    fn a_given_step_is_taken_and_the_rest_follows() {
        let (system, dense, gradient) = random(4, 5);
        let (at, given) = (4 * BLOCK + 2, 0.7);
        let step = system.solve_given(0.0, 2, given).unwrap();
        assert!((step.border[2] - given).abs() < 1e-12);
        // What is left of the dense equations without that unknown's row.
        let rest = (gradient - dense.column(at) * given).remove_row(at);
        let matrix = dense.remove_row(at).remove_column(at);
        let expected = matrix.lu().solve(&rest).unwrap();
        assert!((step.frames[3] - expected.rows(3 * BLOCK, BLOCK)).norm() < 1e-12);
        assert!((step.border[4] - expected[4 * BLOCK + 3]).abs() < 1e-12);
    }

    #[test]
    fn what_is_not_positive_definite_has_no_step() {
        let (mut system, ..) = random(2, 3);
        system.diagonal[1][(4, 4)] = -1.0;
        assert!(system.solve(0.0).is_none() && system.border_covariance().is_none());
    }
}
