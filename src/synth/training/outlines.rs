//! Samples of the outline's net, their targets and its score.
//!
//! A sample's patch is cut around a circle that is up to a third of the radius off. Its target is
//! every cell's signed distance from the true outline, learned near the outline only.

use nalgebra::Vector3;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use super::Symmetry;
use crate::synth::Rendering;
use crate::vision::dots::net::cell_center;
use crate::vision::dots::patch::{Framing, MIDDLE, Patch};
use crate::vision::net::graph::CELLS;
use crate::vision::optics::camera::{BallCircle, Pixel};
use crate::vision::outline::net::{REACH, UNIT, fit_cells, in_patch};

/// Share of the samples that are far off.
const FAR: f64 = 0.5;
/// Largest displacement and logarithm of the size's ratio of those, in radii.
const MAX_OFF: f64 = 0.35;
/// Deviation of the others.
const NEAR_SIGMA: f64 = 0.04;
/// Cells farther from the outline than this, in the patch's values, are not learned.
const LEARNED: f64 = 1.5 * REACH;
/// Outline errors that are counted, parts of the radius.
const WITHIN: [f64; 3] = [0.01, 0.02, 0.05];
/// An error beyond this counts as this, so that single failures do not decide.
const CLIPPED: f64 = 0.2;

/// A patch and the outline in it.
#[derive(Debug, Clone, PartialEq)]
pub struct OutlineSample {
    /// The patch.
    pub patch: Patch,
    /// Center relative to the patch's middle (columns, rows) and radius, values.
    pub circle: Vector3<f64>,
}

/// A patch of a frame, cut around a displaced circle.
pub fn sample<R: Rng + ?Sized>(frame: &Rendering, rng: &mut R) -> OutlineSample {
    let is_far = rng.random_bool(FAR);
    let mut off = || {
        if is_far {
            rng.random_range(-MAX_OFF..MAX_OFF)
        } else {
            NEAR_SIGMA * rng.sample::<f64, _>(StandardNormal)
        }
    };
    let BallCircle { center, radius, .. } = frame.circle;
    let rough = BallCircle::new(
        Pixel {
            u: center.u + radius * off(),
            v: center.v + radius * off(),
        },
        radius * off().exp(),
    );
    let mut patch = Patch::new(Framing::OUTLINE);
    patch.cut_into(&frame.image.to_gray(), &rough);
    let circle = in_patch(&patch, &frame.circle);
    OutlineSample { patch, circle }
}

/// The targets of a sample's outline, rotated and mirrored with its patch, in the order of
/// [`OUTLINE_TARGETS`](super::OUTLINE_TARGETS).
pub fn targets(circle: &Vector3<f64>, symmetry: Symmetry) -> Vec<f32> {
    let center = symmetry.place(Pixel {
        u: MIDDLE + circle.x,
        v: MIDDLE + circle.y,
    });
    let (mut distances, mut weights) = (Vec::new(), Vec::new());
    for row in 0..CELLS {
        for column in 0..CELLS {
            let (u, v) = (cell_center(column), cell_center(row));
            let out = (u - center.u).hypot(v - center.v) - circle.z;
            distances.push((out / UNIT) as f32);
            weights.push(f32::from(u8::from(out.abs() < LEARNED)));
        }
    }
    distances.extend(weights);
    distances
}

/// Errors of the fitted circles on a set of samples.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct OutlineScore {
    /// Samples.
    pub frames: usize,
    /// Of them, with a circle.
    pub found: usize,
    /// Median of the larger of center's and radius' error, in radii, after one patch.
    pub median_error: f64,
    /// Mean of that error, each at most 0.2.
    pub mean_error: f64,
    /// Samples within 1, 2 and 5 % of the radius.
    pub within: [usize; 3],
}

/// A sample's fitted circle minus the true one, in radii, with the covariance as fitted; `None`
/// where the net sees none.
pub type OutlineError = Option<(Vector3<f64>, nalgebra::Matrix3<f64>)>;

/// The error of the circle that a net's cells give.
pub fn error(cells: &[f32], sample: &OutlineSample) -> OutlineError {
    let fit = fit_cells(cells)?;
    let radius = sample.circle.z;
    Some((
        (fit.circle - sample.circle) / radius,
        fit.covariance / (radius * radius),
    ))
}

fn size(error: &Vector3<f64>) -> f64 {
    error.xy().norm().max(error.z.abs())
}

/// The score of a set of errors.
pub fn score(errors: &[OutlineError]) -> OutlineScore {
    let mut sizes: Vec<f64> = errors
        .iter()
        .map(|e| e.as_ref().map_or(f64::INFINITY, |(e, _)| size(e)))
        .collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let clipped: f64 = sizes.iter().map(|e| e.min(CLIPPED)).sum();
    OutlineScore {
        frames: errors.len(),
        found: errors.iter().flatten().count(),
        median_error: sizes.get(sizes.len() / 2).copied().unwrap_or(f64::NAN),
        mean_error: clipped / errors.len().max(1) as f64,
        within: WITHIN.map(|w| sizes.iter().filter(|e| **e <= w).count()),
    }
}

/// The factor on the covariances that makes the median squared Mahalanobis length of the errors that
/// of three Gaussian dimensions, 2.366.
pub fn covariance_factor(errors: &[OutlineError]) -> f64 {
    let mut lengths: Vec<f64> = errors
        .iter()
        .flatten()
        .filter_map(|(e, covariance)| Some(e.dot(&(covariance.try_inverse()? * e))))
        .collect();
    lengths.sort_unstable_by(f64::total_cmp);
    lengths.get(lengths.len() / 2).map_or(1.0, |m| m / 2.366)
}
