//! A face laid on the surface by least squares.
//!
//! With `m` the surface, `f` the face's values, and the true rotation `R exp(-w)`,
//!
//! ```text
//! f(R p) - m(p) = w . (p x grad m) + noise
//! ```
//!
//! so that the surface's slopes serve every face (S. Baker, I. Matthews, "Lucas-Kanade 20 years on", IJCV 2004: inverse
//! compositional), as in [`albedo::map`](crate::vision::albedo::map). Residuals are weighted by Tukey's biweight: what is before the ball
//! is not on it.

use nalgebra::Matrix3;

use super::face::Face;
use super::surface::{Grid, Surface};
use crate::geometry::{Rotation, Vec3};
use crate::stats::{SIGMA_PER_MAD, biweight, median};

/// Depth from which a place takes part.
pub(super) const ALIGNED: f64 = 0.4;
/// Steps of a fit, and the step, radians, at which it ends.
const FIT_STEPS: usize = 20;
const SETTLED: f64 = 2e-4;
/// The standard deviation of residuals in the first step, at least; three quarters of it in each further one.
const COARSE: f64 = 0.6;
/// Residuals beyond so many standard deviations do not count.
pub(super) const REACH: f64 = 4.0;
/// No residual is known better: the steps of a camera's values, and the surface between its places.
pub(super) const LEAST_SIGMA: f64 = 0.02;
/// Share of the places in sight that are known, at least.
const MIN_KNOWN: f64 = 0.5;
/// No step is longer, radians: slopes reach no farther.
pub(super) const MAX_STEP: f64 = 0.15;

/// A face on the surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Laid {
    /// Surface to view frame.
    pub rotation: Rotation,
    /// Correlation of what is seen with the surface.
    pub agreement: f64,
    /// Covariance of the rotation by the noise of the pixels, view frame, rad^2.
    pub covariance: Matrix3<f64>,
}

impl Laid {
    /// The first face, whose view frame is that of the surface.
    pub(super) fn first() -> Self {
        Self {
            rotation: Rotation::identity(),
            agreement: 1.0,
            covariance: Matrix3::zeros(),
        }
    }
}

/// A place in sight.
#[derive(Debug)]
struct Seen {
    place: usize,
    residual: f64,
    value: f64,
    depth: f64,
}

/// Room for fits.
#[derive(Debug, Default)]
pub(super) struct FitSpace {
    seen: Vec<Seen>,
    sorted: Vec<f64>,
}

impl FitSpace {
    /// Lays a face on the surface, from a rotation on; `None` where too little of it is known.
    pub fn lay(
        &mut self,
        grid: &Grid,
        surface: &Surface,
        face: &Face,
        start: &Rotation,
    ) -> Option<Laid> {
        let mut rotation = *start;
        for step in 0..FIT_STEPS {
            let noise = self.see(grid, surface, face, &rotation)?;
            let floor = (COARSE * 0.75f64.powi(step as i32)).max(LEAST_SIGMA);
            let (matrix, vector) = self.equations(surface, noise.max(floor));
            let turn = matrix.cholesky()?.solve(&vector);
            let turn = turn * (MAX_STEP / turn.norm().max(MAX_STEP));
            rotation *= Rotation::from_scaled_axis(-turn);
            // Starts are products of the frames before: without this, errors of their length multiply by 2.4 with every frame.
            rotation.renormalize();
            if turn.norm() < SETTLED {
                break;
            }
        }
        let sigma = self.see(grid, surface, face, &rotation)?.max(LEAST_SIGMA);
        let (matrix, _) = self.equations(surface, sigma);
        let own = matrix.cholesky()?.inverse();
        let shared = face.places_a_value(self.seen.len());
        let to_view = rotation.to_rotation_matrix();
        let covariance = to_view.matrix() * own * to_view.matrix().transpose();
        Some(Laid {
            rotation,
            agreement: self.agreement(surface),
            covariance: covariance * (shared * sigma * sigma),
        })
    }

    /// The known places in sight, and the standard deviation of their residuals; `None` where they are too few.
    fn see(
        &mut self,
        grid: &Grid,
        surface: &Surface,
        face: &Face,
        rotation: &Rotation,
    ) -> Option<f64> {
        self.seen.clear();
        self.sorted.clear();
        let turn = rotation.to_rotation_matrix();
        let mut in_sight = 0;
        for (place, direction) in grid.directions.iter().enumerate() {
            let at = turn * direction;
            let depth = face.depth(&at);
            if depth < ALIGNED {
                continue;
            }
            in_sight += 1;
            if surface.weights[place] > 0.0 {
                let value = face.at(&at);
                let residual = value - f64::from(surface.values[place]);
                self.sorted.push(residual.abs());
                self.seen.push(Seen {
                    place,
                    residual,
                    value,
                    depth,
                });
            }
        }
        let is_enough = self.seen.len() as f64 >= MIN_KNOWN * f64::from(in_sight);
        is_enough.then(|| SIGMA_PER_MAD * median(&mut self.sorted))
    }

    fn equations(&self, surface: &Surface, sigma: f64) -> (Matrix3<f64>, Vec3) {
        let mut matrix = Matrix3::identity() * 1e-9;
        let mut vector = Vec3::zeros();
        for seen in &self.seen {
            let weight = seen.depth * biweight(seen.residual / (REACH * sigma));
            if weight > 0.0 {
                let row = Vec3::from(surface.turns[seen.place].map(f64::from));
                matrix.ger(weight, &row, &row, 1.0);
                vector.axpy(weight * seen.residual, &row, 1.0);
            }
        }
        (matrix, vector)
    }

    fn agreement(&self, surface: &Surface) -> f64 {
        let mut sums = [0.0; 6];
        for seen in &self.seen {
            let [a, b] = [seen.value, f64::from(surface.values[seen.place])];
            for (sum, term) in sums.iter_mut().zip([1.0, a, b, a * a, b * b, a * b]) {
                *sum += seen.depth * term;
            }
        }
        let [n, a, b, aa, bb, ab] = sums;
        let spread = ((aa - a * a / n) * (bb - b * b / n)).max(1e-12).sqrt();
        (ab - a * b / n) / spread
    }
}
