//! Weights that are known in steps: between the steps their logarithms are the cubic through the four nearest
//! ones (Lagrange). Weights narrower than a step would otherwise leave the mean at one.

/// Parts of a step between which the scale's mean is taken.
const PARTS: usize = 16;

/// ln of the integral of weights by their logarithms at four steps or more, and the step that is their mean.
pub(super) fn over_steps(ln_weights: &[f64]) -> (f64, f64) {
    let max = ln_weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let last = ln_weights.len() - 1;
    let (mut sum, mut mean) = (0.0, 0.0);
    for k in 0..=last * PARTS {
        let at = k as f64 / PARTS as f64;
        let first = (k / PARTS).saturating_sub(1).min(last - 3);
        let cubic = lagrange(at - first as f64);
        let terms = cubic.iter().zip(&ln_weights[first..]);
        let ln_weight: f64 = terms.map(|(c, w)| c * w).sum();
        let weight = (ln_weight - max).exp();
        sum += weight;
        mean += weight * at;
    }
    (max + (sum / PARTS as f64).ln(), mean / sum)
}

/// What the values at 0, 1, 2 and 3 have in that of their cubic at `x` (Lagrange).
fn lagrange(x: f64) -> [f64; 4] {
    let [a, b, c, d] = [x, x - 1.0, x - 2.0, x - 3.0];
    [
        -b * c * d / 6.0,
        a * c * d / 2.0,
        -a * b * d / 2.0,
        a * b * c / 6.0,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_its_own() {
        let cubic = |x: f64| 2.0 - x + 0.5 * x * x - 0.25 * x.powi(3);
        let at = lagrange(1.3);
        let found: f64 = (0..4).map(|k| at[k] * cubic(k as f64)).sum();
        assert!((found - cubic(1.3)).abs() < 1e-12);
        // A normal distribution much narrower than a step, and one that is wider.
        for (center, sigma) in [(7.37, 0.2), (9.8, 1.5)] {
            let weights: Vec<f64> = (0..21)
                .map(|k| -0.5 * ((f64::from(k) - center) / sigma).powi(2))
                .collect();
            let (ln_sum, mean) = over_steps(&weights);
            assert!((mean - center).abs() < 1e-3, "{mean}");
            let expected = (sigma * std::f64::consts::TAU.sqrt()).ln();
            assert!((ln_sum - expected).abs() < 1e-3, "{ln_sum} {expected}");
        }
    }
}
