//! What the number of a ball's dots says of its marks.
//!
//! Marks are dots with the probabilities `p_i`, each by itself, and `h` dots are hidden: Poisson, with the mean `l`. Who counts them says
//! `n`, or with the probability `e` one more or less. Then those marks `S` and no others are the dots, and none is hidden, with the probability
//!
//! ```text
//! (1 - e) exp(-l) prod_S p_i prod_others (1 - p_i) / ((1 - e) P(n) + e/2 P(n - 1) + e/2 P(n + 1))
//! ```
//!
//! where `P` is the distribution of the number of dots: that of independent trials with unlike odds (Poisson's binomial distribution;
//! W. Hoeffding, "On the distribution of the number of successes in independent trials", 1956) and of what is hidden. The likeliest `S` has
//! the `n` likeliest marks.

/// Probability that a person miscounts by one.
const MISCOUNTED: f64 = 0.05;
/// A map of evidence is never surer of a mark.
const SUREST: f64 = 1e-4;

/// The probability that of marks with these probabilities the `number` likeliest are the dots and no others, none is hidden of so many on
/// average, and that is their number.
pub(super) fn posterior(probabilities: &[f64], hidden: f64, number: usize) -> f64 {
    let mut known: Vec<f64> = probabilities
        .iter()
        .map(|p| p.clamp(SUREST, 1.0 - SUREST))
        .collect();
    if number > known.len() {
        return 0.0;
    }
    known.sort_unstable_by(|a, b| b.total_cmp(a));
    let all = with_hidden(&numbers(&known, number + 1), hidden);
    let beside = all[number + 1] + number.checked_sub(1).map_or(0.0, |k| all[k]);
    let said = (1.0 - MISCOUNTED) * all[number] + 0.5 * MISCOUNTED * beside;
    let (dots, others) = known.split_at(number);
    let likeliest = dots.iter().copied().chain(others.iter().map(|p| 1.0 - p));
    let likeliest = (1.0 - MISCOUNTED) * (-hidden).exp() * likeliest.product::<f64>();
    if said > 0.0 { likeliest / said } else { 0.0 }
}

/// The probabilities of 0 to `most` dots among marks.
fn numbers(probabilities: &[f64], most: usize) -> Vec<f64> {
    let mut numbers = vec![0.0; most + 1];
    numbers[0] = 1.0;
    for p in probabilities {
        for k in (0..=most).rev() {
            let less = k.checked_sub(1).map_or(0.0, |k| numbers[k]);
            numbers[k] = numbers[k] * (1.0 - p) + less * p;
        }
    }
    numbers
}

/// The same with so many hidden ones on average.
fn with_hidden(seen: &[f64], hidden: f64) -> Vec<f64> {
    let sum = |k: usize| {
        let mut poisson = (-hidden).exp();
        let mut sum = 0.0;
        for h in 0..=k {
            sum += poisson * seen[k - h];
            poisson *= hidden / (h + 1) as f64;
        }
        sum
    };
    (0..seen.len()).map(sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By all subsets of the marks.
    #[test]
    fn the_probability_is_that_of_all_subsets() {
        let p = [0.97, 0.4, 0.9, 0.02, 0.6];
        let hidden = 0.1f64;
        let poisson = |h: usize| {
            let factorial: f64 = (1..=h).map(|k| k as f64).product();
            (-hidden).exp() * hidden.powi(h as i32) / factorial
        };
        let subset = |mask: usize| -> (usize, f64) {
            let of = |i: usize| match mask >> i & 1 {
                1 => p[i],
                _ => 1.0 - p[i],
            };
            (mask.count_ones() as usize, (0..5).map(of).product())
        };
        let number = |n: usize| -> f64 {
            let all = (0..32).map(subset);
            all.filter(|(k, _)| *k <= n)
                .map(|(k, share)| share * poisson(n - k))
                .sum()
        };
        for n in 1..=4usize {
            let said = 0.95 * number(n) + 0.025 * (number(n - 1) + number(n + 1));
            let exact = (0..32).map(subset).filter(|(k, _)| *k == n);
            let best = exact.map(|(_, share)| share).fold(0.0, f64::max);
            let expected = 0.95 * poisson(0) * best / said;
            let found = posterior(&p, hidden, n);
            assert!((found - expected).abs() < 1e-12, "{n}: {found} {expected}");
        }
    }

    #[test]
    fn a_number_settles_what_may_be_a_dot_and_no_more() {
        let dots = [0.99; 18];
        let with = |more: &[f64]| [&dots[..], more].concat();
        // As many look like dots, or as many do with what may be one.
        assert!(posterior(&with(&[0.3]), 0.001, 18) > 0.9);
        assert!(posterior(&with(&[0.3]), 0.001, 19) > 0.9);
        // Which of two is not known.
        assert!(posterior(&with(&[0.3, 0.3]), 0.001, 19) < 0.6);
        // A stain is no dot because someone has counted one more; nor is one that hides.
        assert!(posterior(&with(&[0.001]), 0.001, 19) < 0.1);
        assert!(posterior(&with(&[0.1]), 0.2, 19) < 0.5);
        assert_eq!(posterior(&dots, 0.0, 30), 0.0);
    }
}
