//! Logistic regression by Newton's method.

use nalgebra::{SMatrix, SVector};
use spindoe::vision::estimator::{FEATURES, TrustMap};

use super::kinds::Answer;

const SIZE: usize = FEATURES + 1;
/// Weight of a prior that keeps what the answers do not settle near 0.
const RIDGE: f64 = 0.1;
/// Steps; it settles in some ten.
const STEPS: usize = 50;

/// The detector's doubt and the misfit, by their place among the features.
pub const DOUBT_AND_MISFIT: [usize; 2] = [FEATURES - 2, FEATURES - 1];

/// The map that makes the answers likeliest, without these features.
pub fn fit(answers: &[Answer], without: &[usize]) -> TrustMap {
    let rows: Vec<(SVector<f64, SIZE>, f64)> = answers
        .iter()
        .map(|a| {
            let mut x = SVector::<f64, SIZE>::repeat(1.0);
            let mut features = a.evidence.features();
            without.iter().for_each(|&k| features[k] = 0.0);
            x.fixed_rows_mut::<FEATURES>(1).copy_from_slice(&features);
            (x, f64::from(u8::from(a.is_correct)))
        })
        .collect();
    let mut w = SVector::<f64, SIZE>::zeros();
    for _ in 0..STEPS {
        let mut hessian = SMatrix::<f64, SIZE, SIZE>::identity() * RIDGE;
        let mut gradient = -w * RIDGE;
        for (x, y) in &rows {
            let p = 1.0 / (1.0 + (-w.dot(x)).exp());
            hessian += x * x.transpose() * (p * (1.0 - p));
            gradient += x * (y - p);
        }
        let Some(step) = hessian.cholesky().map(|c| c.solve(&gradient)) else {
            break;
        };
        w += step;
    }
    let mut weights = [0.0; FEATURES];
    weights.copy_from_slice(&w.as_slice()[1..]);
    TrustMap {
        constant: w[0],
        weights,
    }
}
