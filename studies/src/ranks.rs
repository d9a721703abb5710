//! Rank correlation.

use crate::table::{Cell, signed};

/// Ranks from 1, ties at their mean.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0.0; values.len()];
    let mut from = 0;
    while from < order.len() {
        let tie = |&&i: &&usize| values[i] == values[order[from]];
        let to = from + order[from..].iter().take_while(tie).count();
        for &i in &order[from..to] {
            ranks[i] = 0.5 * (from + to + 1) as f64;
        }
        from = to;
    }
    ranks
}

/// Spearman's rank correlation of two equally long samples; NaN where one is constant.
pub fn spearman(a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (ranks(a), ranks(b));
    let mean = 0.5 * (a.len() + 1) as f64;
    let product = |x: &[f64], y: &[f64]| -> f64 {
        x.iter().zip(y).map(|(x, y)| (x - mean) * (y - mean)).sum()
    };
    product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt()
}

/// The rank correlation with its 95 % interval: Fisher's, with the variance 1.06 / (n - 3) of rank correlations (E. C.
/// Fieller, H. O. Hartley, E. S. Pearson, "Tests for rank correlation coefficients I", Biometrika 44, 1957).
pub fn correlation(a: &[f64], b: &[f64]) -> Cell {
    let r = spearman(a, b);
    let half = 1.96 * (1.06 / (a.len() as f64 - 3.0)).sqrt();
    signed(r, [-half, half].map(|off| (r.atanh() + off).tanh()), 3)
}

#[cfg(test)]
mod tests {
    use super::spearman;

    /// The values of `scipy.stats.spearmanr`.
    #[test]
    fn ties_count_at_their_mean() {
        let found = spearman(&[1.0, 2.0, 2.0, 4.0], &[1.0, 3.0, 2.0, 4.0]);
        assert!((found - 0.948_683_298_050_513_7).abs() < 1e-12, "{found}");
    }
}
