//! Numbers that follow from the nets and the synthetic world, as `models/derived.json` has them.
//!
//! `bench derive` in `studies/` computes them; the file names the command and the SHA-256 of each input, and a test
//! fails where an input has changed since.

include!(concat!(env!("OUT_DIR"), "/derived.rs"));

/// The probability by a fitted map: its constant, and the weight of each feature.
pub(crate) fn probability<const N: usize>(map: &[f64], features: [f64; N]) -> f64 {
    let (constant, weights) = map.split_first().unwrap_or((&0.0, &[]));
    let terms = weights.iter().zip(features).map(|(w, f)| w * f);
    let ln_odds = constant + terms.sum::<f64>();
    1.0 / (1.0 + (-ln_odds).exp())
}
