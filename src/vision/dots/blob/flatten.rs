//! Subtracts the ball's shading: dots, marks and noise remain.
//!
//! The brightness of a matt ball under distant light is a polynomial of second degree in the
//! surface's normal (R. Ramamoorthi, P. Hanrahan, "An efficient representation for irradiance
//! environment maps", SIGGRAPH 2001): nine functions `1, x, y, z, xy, xz, yz, x^2 - y^2, z^2`. They
//! are fitted by reweighted least squares that rejects pixels darker than the surface (dots) and,
//! later, brighter ones (glints). The blur of the limb leaves a residual that is the same all
//! around: the median of each ring is subtracted as well.

use nalgebra::{SMatrix, SVector};

use super::in_radii;
use crate::stats::SIGMA_PER_MAD;
use crate::vision::dots::patch::SIZE;

/// Functions of the surface.
pub(crate) const TERMS: usize = 9;
/// Every so many pixels of the ball take part in the fit.
const STRIDE: usize = 3;
/// Reweighted fits.
const ROUNDS: usize = 5;
/// Residuals beyond so many standard deviations, darker and brighter, are no surface.
const DARKER: f32 = 2.0;
const BRIGHTER: f32 = 4.0;
/// Pixels up to here, in radii, belong to the ball.
const OUTLINE: f64 = 0.98;
/// Rings from here outwards, in radii, have their median taken off.
const RINGS_FROM: f64 = 0.8;
/// Rings.
const RINGS: usize = 6;

/// The functions of the surface at a normal.
pub(crate) fn harmonics([x, y, z]: [f64; 3]) -> [f64; TERMS] {
    [1.0, x, y, z, x * y, x * z, y * z, x * x - y * y, z * z]
}

/// A pixel of the ball.
#[derive(Debug, Clone, Copy)]
struct BarePlace {
    index: usize,
    terms: SVector<f32, TERMS>,
    ring: Option<usize>,
}

/// The ball's pixels and the functions of its surface there.
#[derive(Debug, Clone)]
pub(crate) struct Shading {
    places: Vec<BarePlace>,
    mask: Vec<f32>,
}

/// A flattened patch: positive is brighter than the surface, dots are negative.
#[derive(Debug, Default)]
pub(crate) struct Flat {
    values: Vec<f32>,
    noise: f32,
    residuals: Vec<f32>,
    sorted: Vec<f32>,
}

impl Flat {
    /// Differences from the surface, 0 outside the ball.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Standard deviation of the values where there is no dot.
    pub fn noise(&self) -> f32 {
        self.noise
    }
}

impl Shading {
    pub fn new() -> Self {
        let mut mask = vec![0.0; SIZE * SIZE];
        let mut places = Vec::new();
        for (index, on_ball) in mask.iter_mut().enumerate() {
            let (x, y) = in_radii((index % SIZE) as f64, (index / SIZE) as f64);
            let out = x.hypot(y);
            if out > OUTLINE {
                continue;
            }
            *on_ball = 1.0;
            let z = (1.0 - out * out).max(0.0).sqrt();
            let terms = harmonics([x, y, z]);
            let ring = (out - RINGS_FROM) / (OUTLINE - RINGS_FROM) * RINGS as f64;
            places.push(BarePlace {
                index,
                terms: SVector::from(terms.map(|t| t as f32)),
                ring: (ring >= 0.0).then_some((ring as usize).min(RINGS - 1)),
            });
        }
        Self { places, mask }
    }

    /// 1 on the ball, 0 elsewhere.
    pub fn mask(&self) -> &[f32] {
        &self.mask
    }

    /// Flattens a patch's values.
    pub fn flatten(&self, values: &[f32], flat: &mut Flat) {
        let mut surface = SVector::<f32, TERMS>::zeros();
        let mut reach = f32::INFINITY;
        for round in 0..ROUNDS {
            let (mut matrix, mut vector) = (
                SMatrix::<f32, TERMS, TERMS>::identity() * 1e-2,
                SVector::<f32, TERMS>::zeros(),
            );
            for place in self.places.iter().step_by(STRIDE) {
                let value = values[place.index];
                let residual = value - place.terms.dot(&surface);
                let limit = reach * if residual < 0.0 { DARKER } else { BRIGHTER };
                let t = residual / limit;
                let weight = (1.0 - t * t).max(0.0).powi(2);
                if weight > 0.0 {
                    matrix.ger(weight, &place.terms, &place.terms, 1.0);
                    vector.axpy(weight * value, &place.terms, 1.0);
                }
            }
            let Some(factor) = matrix.cholesky() else {
                break;
            };
            surface = factor.solve(&vector);
            // The first fits are drawn down by the dots: what is brighter than they are is the
            // better measure.
            flat.residuals.clear();
            let residual = |p: &BarePlace| values[p.index] - p.terms.dot(&surface);
            flat.residuals
                .extend(self.places.iter().step_by(STRIDE).map(residual));
            let absolute = flat.residuals.iter().map(|r| r.abs());
            flat.sorted.clear();
            flat.sorted.extend(absolute);
            let widening = if round + 1 < ROUNDS / 2 { 1.5 } else { 1.0 };
            reach = (widening * SIGMA_PER_MAD as f32 * median(&mut flat.sorted)).max(1e-3);
        }
        flat.noise = reach;
        flat.values.clear();
        flat.values.resize(SIZE * SIZE, 0.0);
        for place in &self.places {
            flat.values[place.index] = values[place.index] - place.terms.dot(&surface);
        }
        self.level_rings(flat);
    }

    /// Takes off each ring's median.
    fn level_rings(&self, flat: &mut Flat) {
        for ring in 0..RINGS {
            let in_ring = |p: &&BarePlace| p.ring == Some(ring);
            flat.sorted.clear();
            let values = &flat.values;
            flat.sorted
                .extend(self.places.iter().filter(in_ring).map(|p| values[p.index]));
            let level = median(&mut flat.sorted);
            for place in self.places.iter().filter(in_ring) {
                flat.values[place.index] -= level;
            }
        }
    }
}

/// The median, which reorders the values; 0 for none.
fn median(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}
