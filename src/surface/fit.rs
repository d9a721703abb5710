//! A face laid on the surface by least squares.
//!
//! With `m` the surface, `f` the face's values, and the true rotation `R exp(-w)`,
//!
//! ```text
//! f(R p) - m(p) = w . (p x grad m) + noise
//! ```
//!
//! so that the surface's slopes serve every face (S. Baker, I. Matthews, "Lucas-Kanade 20 years on", IJCV 2004: inverse
//! compositional). Residuals are weighted by Tukey's biweight: what is before the ball
//! is not on it.

use nalgebra::Matrix3;

use super::face::Face;
use super::laid::{ALIGNED, Laid};
use super::surface_map::{PLACES, PlaceGrid, SurfaceMap};
use crate::fit::{Sums, biweight, weighted_sigma};
use crate::geometry::{Rotation, Vec3};

/// Steps of a fit, and the step, radians, at which it ends.
const FIT_STEPS: usize = 20;
const SETTLED: f64 = 2e-4;
/// The standard deviation of residuals in the first step, at least; three quarters of it in each further one.
const COARSE: f64 = 0.6;
/// Residuals beyond so many standard deviations do not count.
pub(crate) const REACH: f64 = 4.0;
/// No residual is known better: the steps of a camera's values, and the surface between its places.
pub(crate) const LEAST_SIGMA: f64 = 0.02;
/// Share of the visible places that are known, at least.
const MIN_KNOWN: f64 = 0.5;
/// No step is longer, radians: slopes reach no farther.
pub(crate) const MAX_STEP: f64 = 0.15;

/// Places that come into sight while the ball turns by no more, radians, are seen from the first step on.
const MARGIN: f64 = 0.1;

/// A steep place that is visible, or nearly.
#[derive(Debug)]
struct NearPlace {
    direction: Vec3,
    turn: Vec3,
    value: f64,
}

/// A visible place.
#[derive(Debug)]
struct VisiblePlace {
    turn: Vec3,
    residual: f64,
    depth: f64,
}

/// Room for fits.
#[derive(Debug, Default)]
pub(crate) struct FitSpace {
    near: Vec<NearPlace>,
    seen: Vec<VisiblePlace>,
    sizes: Vec<[f64; 2]>,
}

impl FitSpace {
    /// Lays a face on the surface, from a rotation on; `None` where too little of it is known.
    pub fn lay(
        &mut self,
        grid: &PlaceGrid,
        surface: &SurfaceMap,
        face: &Face,
        start: &Rotation,
    ) -> Option<Laid> {
        let mut rotation = *start;
        let mut turned = f64::INFINITY;
        for step in 0..FIT_STEPS {
            if turned > MARGIN {
                self.come_near(grid, surface, face, &rotation);
                turned = 0.0;
            }
            let noise = self.see(face, &rotation);
            let floor = (COARSE * 0.75f64.powi(step as i32)).max(LEAST_SIGMA);
            let (matrix, vector) = self.equations(noise.max(floor));
            let turn = matrix.cholesky()?.solve(&vector);
            let turn = turn * (MAX_STEP / turn.norm().max(MAX_STEP));
            rotation *= Rotation::from_scaled_axis(-turn);
            // Starts are products of the frames before: without this, errors of their length multiply by 2.4 with every frame.
            rotation.renormalize();
            turned += turn.norm();
            if turn.norm() < SETTLED {
                break;
            }
        }
        if turned > MARGIN {
            self.come_near(grid, surface, face, &rotation);
        }
        let sigma = self.see(face, &rotation).max(LEAST_SIGMA);
        let (matrix, _) = self.equations(sigma);
        let own = matrix.cholesky()?.inverse();
        let shared = face.places_a_value(PLACES);
        let to_view = rotation.to_rotation_matrix();
        let covariance = to_view.matrix() * own * to_view.matrix().transpose();
        Some(Laid {
            rotation,
            agreement: agreement(grid, surface, face, &rotation)?,
            covariance: covariance * (shared * sigma * sigma),
        })
    }

    /// The steep places that are visible, or are after a turn by [`MARGIN`].
    fn come_near(
        &mut self,
        grid: &PlaceGrid,
        surface: &SurfaceMap,
        face: &Face,
        rotation: &Rotation,
    ) {
        let towards = rotation.inverse() * Vec3::z();
        let least = face.least_z(ALIGNED) - MARGIN;
        let steep = surface.steep.iter().map(|place| *place as usize);
        let near = steep.filter(|place| grid.directions[*place].dot(&towards) >= least);
        self.near.clear();
        self.near.extend(near.map(|place| NearPlace {
            direction: grid.directions[place],
            turn: Vec3::from(surface.turns[place].map(f64::from)),
            value: f64::from(surface.values[place]),
        }));
    }

    /// The visible ones of the near places, and the standard deviation of their residuals.
    fn see(&mut self, face: &Face, rotation: &Rotation) -> f64 {
        self.seen.clear();
        self.sizes.clear();
        let to_view = rotation.to_rotation_matrix();
        for near in &self.near {
            let at = to_view * near.direction;
            let depth = face.depth(&at);
            if depth < ALIGNED {
                continue;
            }
            let residual = face.at(&at) - near.value;
            self.sizes.push([residual.abs(), near.turn.norm_squared()]);
            self.seen.push(VisiblePlace {
                turn: near.turn,
                residual,
                depth,
            });
        }
        weighted_sigma(&mut self.sizes)
    }

    fn equations(&self, sigma: f64) -> (Matrix3<f64>, Vec3) {
        let mut sums = Sums::<3>::default();
        for seen in &self.seen {
            let weight = seen.depth * biweight(seen.residual / (REACH * sigma));
            if weight > 0.0 {
                sums.add(seen.turn.as_ref(), seen.residual, weight);
            }
        }
        (
            sums.symmetric() + Matrix3::identity() * 1e-9,
            sums.gradient.into(),
        )
    }
}

/// The correlation of a face with the surface under a rotation, places weighted by their depths; `None` where too little of what is visible is known.
pub(crate) fn agreement(
    grid: &PlaceGrid,
    surface: &SurfaceMap,
    face: &Face,
    rotation: &Rotation,
) -> Option<f64> {
    let to_view = rotation.to_rotation_matrix();
    let (mut in_sight, mut known, mut sums) = (0, 0, [0.0; 6]);
    let towards = rotation.inverse() * Vec3::z();
    let least = face.least_z(ALIGNED) - 1e-9;
    for (place, direction) in grid.compared() {
        if direction.dot(&towards) < least {
            continue;
        }
        let at = to_view * direction;
        let depth = face.depth(&at);
        if depth < ALIGNED {
            continue;
        }
        in_sight += 1;
        if surface.weights[place] > 0.0 {
            known += 1;
            let [a, b] = [face.at(&at), f64::from(surface.values[place])];
            for (sum, term) in sums.iter_mut().zip([1.0, a, b, a * a, b * b, a * b]) {
                *sum += depth * term;
            }
        }
    }
    let [n, a, b, aa, bb, ab] = sums;
    let spread = ((aa - a * a / n) * (bb - b * b / n)).max(1e-12).sqrt();
    let is_enough = f64::from(known) >= MIN_KNOWN * f64::from(in_sight);
    is_enough.then(|| (ab - a * b / n) / spread)
}
