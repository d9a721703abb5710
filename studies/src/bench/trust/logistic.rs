//! Logistic regression by Newton's method.

use nalgebra::{SMatrix, SVector};
use spindoe::vision::pose::{FEATURES, PoseEvidence, PoseSource, TrustMap, TrustWeights};

use super::kinds::Judged;

/// Weight of a prior that keeps what the answers do not settle near 0.
const RIDGE: f64 = 0.1;
/// Steps; it settles in some ten.
const STEPS: usize = 50;

/// The detector's doubt and the misfit, by their place among the features.
pub const DOUBT_AND_MISFIT: [usize; 2] = [FEATURES - 2, FEATURES - 1];

/// The map that makes the answers likeliest, without these features of detections.
pub fn fit(answers: &[Judged], without: &[usize]) -> TrustMap {
    TrustMap {
        detections: weights(answers, |evidence| {
            let mut features = evidence.features();
            without.iter().for_each(|&k| features[k] = 0.0);
            evidence.is_of_detections().then_some(features)
        }),
        places: weights(answers, |evidence| {
            let is_of_places = matches!(evidence.source, PoseSource::Places(_));
            is_of_places.then_some(evidence.features())
        }),
        pixels: TrustMap::IDENTITY.pixels,
    }
}

/// The weights for poses by the pixels of small balls that make the answers likeliest.
pub fn of_pixels(answers: &[Judged]) -> TrustWeights {
    weights(answers, |evidence| {
        let is_of_pixels = matches!(evidence.source, PoseSource::Pixels(_));
        is_of_pixels.then_some(evidence.features())
    })
}

/// Constant and weights for the answers that have these features.
fn weights(
    answers: &[Judged],
    features: impl Fn(&PoseEvidence) -> Option<[f64; FEATURES]>,
) -> TrustWeights {
    let of = |answer: &Judged| Some((features(&answer.evidence)?, answer.is_correct));
    regression(answers.iter().filter_map(of))
}

/// The constant and the weights of `N` features, `SIZE = N + 1`, that make the outcomes likeliest.
pub fn regression<const N: usize, const SIZE: usize>(
    rows: impl Iterator<Item = ([f64; N], bool)>,
) -> [f64; SIZE] {
    let rows: Vec<_> = rows
        .map(|(features, outcome)| {
            let all = std::iter::once(1.0).chain(features);
            let x = SVector::<f64, SIZE>::from_iterator(all);
            (x, f64::from(u8::from(outcome)))
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
    w.into()
}
