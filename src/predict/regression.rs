//! Smooth functions of a few numbers: generalized linear models with squares and products of two.
//!
//! With the standardized covariates `z_i = (x_i - mean_i) / deviation_i`, held within 2.5
//! deviations, the linear predictor is `eta = b_0 + sum_i b_i z_i + sum_{i <= j} b_ij z_i z_j`;
//! without products only `i = j` is left, which needs fewer observations and is tamer in corners. A
//! probability is `1 / (1 + exp(-eta))`, a rate `exp(eta)`, a mean `eta` itself (P. McCullagh, J. A.
//! Nelder, "Generalized Linear Models", 1989). Coefficients are found by iteratively reweighted
//! least squares with a small ridge.
//!
//! Beyond the range of what they were fitted to, the functions keep the value at its border.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Standardized covariates stay within this.
const REACH: f64 = 2.5;
/// Penalty on a squared coefficient, against the curvature of one observation.
const RIDGE: f64 = 1.0;
/// Steps of the fit.
const STEPS: usize = 30;
/// A shorter step ends it.
const CONVERGED: f64 = 1e-7;
/// Bound of the linear predictor, so that no weight vanishes altogether.
const MAX_ETA: f64 = 15.0;

/// What a linear predictor stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Link {
    /// The mean itself.
    Identity,
    /// A probability.
    Logit,
    /// A rate of counts.
    Log,
}

/// Where covariates lie.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scaling {
    /// Means.
    pub mean: Vec<f64>,
    /// Standard deviations.
    pub deviation: Vec<f64>,
    /// Smallest and largest value that was seen, without a thousandth at either end.
    pub domain: Vec<[f64; 2]>,
    /// Whether products of two different covariates are terms.
    pub with_products: bool,
}

impl Scaling {
    /// The scaling of rows of `columns` covariates, one after another, with products of two.
    ///
    /// # Errors
    /// [`Error::Argument`] where there is no row, or their length does not fit.
    pub fn of(rows: &[f64], columns: usize) -> Result<Self> {
        if columns == 0 || rows.is_empty() || !rows.len().is_multiple_of(columns) {
            return Err(Error::argument("rows", "expected rows of equal length"));
        }
        let mut scaling = Self {
            mean: Vec::new(),
            deviation: Vec::new(),
            domain: Vec::new(),
            with_products: true,
        };
        for k in 0..columns {
            let mut values: Vec<f64> = rows.iter().skip(k).step_by(columns).copied().collect();
            values.sort_unstable_by(f64::total_cmp);
            let n = values.len() as f64;
            let mean = values.iter().sum::<f64>() / n;
            let squares: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
            scaling.mean.push(mean);
            scaling.deviation.push((squares / n).sqrt().max(1e-9));
            scaling.domain.push([
                crate::stats::quantile(&values, 0.001),
                crate::stats::quantile(&values, 0.999),
            ]);
        }
        Ok(scaling)
    }

    /// The same without products of different covariates.
    #[must_use]
    pub fn without_products(self) -> Self {
        Self {
            with_products: false,
            ..self
        }
    }

    /// Number of terms of a predictor: one, each covariate, each square and product.
    pub fn terms(&self) -> usize {
        let k = self.mean.len();
        let products = if self.with_products {
            k * (k - 1) / 2
        } else {
            0
        };
        1 + 2 * k + products
    }

    /// Writes the terms of a row of covariates.
    pub fn expand(&self, x: &[f64], terms: &mut [f64]) {
        let k = self.mean.len();
        terms[0] = 1.0;
        for i in 0..k {
            let held = x[i].clamp(self.domain[i][0], self.domain[i][1]);
            terms[1 + i] = ((held - self.mean[i]) / self.deviation[i]).clamp(-REACH, REACH);
        }
        let mut at = 1 + k;
        for i in 0..k {
            let end = if self.with_products { k } else { i + 1 };
            for j in i..end {
                terms[at] = terms[1 + i] * terms[1 + j];
                at += 1;
            }
        }
    }

    /// Whether every covariate lies within what was seen.
    pub fn contains(&self, x: &[f64]) -> bool {
        let inside = |(x, [low, high]): (&f64, &[f64; 2])| (*low..=*high).contains(x);
        x.iter().zip(&self.domain).all(inside)
    }
}

/// A fitted function of expanded covariates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Regression {
    /// What its predictor stands for.
    pub link: Link,
    /// A coefficient for each term.
    pub coefficients: Vec<f64>,
}

impl Regression {
    /// Fits the coefficients to the rows of `terms` (one after another) and their `values`: 0 or 1
    /// for [`Link::Logit`], counts for [`Link::Log`].
    ///
    /// # Errors
    /// [`Error::Argument`] where lengths disagree or a value is not finite;
    /// [`Error::Internal`] where the equations have no solution.
    pub fn fit(link: Link, terms: &[f64], values: &[f64]) -> Result<Self> {
        let n = values.len();
        if n == 0 || !terms.len().is_multiple_of(n) {
            return Err(Error::argument("terms", "expected a row for every value"));
        }
        if !terms.iter().chain(values).all(|x| x.is_finite()) {
            return Err(Error::argument("terms", "expected finite numbers"));
        }
        let k = terms.len() / n;
        let mut b = DVector::<f64>::zeros(k);
        let mean = values.iter().sum::<f64>() / n as f64;
        b[0] = match link {
            Link::Identity => mean,
            Link::Logit => {
                let p = mean.clamp(1e-4, 1.0 - 1e-4);
                (p / (1.0 - p)).ln()
            }
            Link::Log => mean.max(1e-4).ln(),
        };
        for _ in 0..STEPS {
            let (curvature, gradient) = equations(link, terms, values, &b);
            let step = curvature
                .cholesky()
                .ok_or_else(|| Error::Internal("the regression's equations are singular".into()))?
                .solve(&gradient);
            // A long step of a curved likelihood overshoots.
            let scale = (4.0 / step.amax()).min(1.0);
            b += &step * scale;
            if link == Link::Identity || step.amax() < CONVERGED {
                break;
            }
        }
        Ok(Self {
            link,
            coefficients: b.iter().copied().collect(),
        })
    }

    /// The linear predictor at a row of terms.
    pub fn predictor(&self, terms: &[f64]) -> f64 {
        self.coefficients
            .iter()
            .zip(terms)
            .map(|(b, t)| b * t)
            .sum()
    }

    /// The function's value at a row of terms.
    pub fn value(&self, terms: &[f64]) -> f64 {
        self.value_shifted(terms, 0.0)
    }

    /// The value with the predictor shifted by `by`.
    pub fn value_shifted(&self, terms: &[f64], by: f64) -> f64 {
        let eta = self.predictor(terms) + by;
        mean_of(self.link, eta)
    }
}

fn mean_of(link: Link, eta: f64) -> f64 {
    match link {
        Link::Identity => eta,
        Link::Logit => 1.0 / (1.0 + (-eta).exp()),
        Link::Log => eta.min(MAX_ETA).exp(),
    }
}

/// Curvature and gradient of the penalized likelihood.
fn equations(
    link: Link,
    terms: &[f64],
    values: &[f64],
    b: &DVector<f64>,
) -> (DMatrix<f64>, DVector<f64>) {
    let k = b.len();
    let mut curvature = DMatrix::<f64>::from_diagonal_element(k, k, RIDGE);
    curvature[(0, 0)] = 1e-9;
    let mut gradient = -b * RIDGE;
    gradient[0] = 0.0;
    // Rows are gathered, so that their products are one of matrices.
    const BLOCK: usize = 2048;
    for (rows, values) in terms.chunks(BLOCK * k).zip(values.chunks(BLOCK)) {
        let x = DMatrix::from_column_slice(k, values.len(), rows);
        let mut weighted = x.clone();
        let mut residual = DVector::zeros(values.len());
        for (i, y) in values.iter().enumerate() {
            let eta = x.column(i).dot(b).clamp(-MAX_ETA, MAX_ETA);
            let mean = mean_of(link, eta);
            let weight = match link {
                Link::Identity => 1.0,
                Link::Logit => mean * (1.0 - mean),
                Link::Log => mean,
            };
            residual[i] = y - mean;
            weighted.column_mut(i).scale_mut(weight);
        }
        curvature += &weighted * x.transpose();
        gradient += &x * residual;
    }
    (curvature, gradient)
}
