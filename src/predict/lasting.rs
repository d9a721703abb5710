//! What lasts over a sequence: light, lens, print and background are those of the frame before, and so are the
//! errors that come from them.
//!
//! Whatever [`DetectionModel::detect`] draws for a ball as a whole belongs to a standard normal variate. In a
//! sequence each is `sqrt(s) a + sqrt(1 - s) b`: `a` is the sequence's, `b` the frame's own, `s` its share, the
//! correlation between any two frames (a Gaussian copula with one factor; R. B. Nelsen, "An introduction to
//! copulas", 2006). What a single frame draws has the same distribution as before. The shares are learned from pairs
//! of rendered frames of one sequence.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use super::learn::Observation;
use super::model::{DetectionModel, Spread, Terms};
use crate::stats::normal_cdf;

/// Shares between which the likeliest is sought.
const STEP: f64 = 0.02;
/// Variates of the sequence over which a likelihood is averaged.
const NODES: usize = 64;

/// Standard normal variates that stand for what is drawn of a ball as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Variates {
    /// Low where the outline is found.
    pub(super) found: f64,
    /// The outline's center: direction and size of its error.
    pub(super) center: [f64; 2],
    /// The outline's radius: sign and size of its error.
    pub(super) radius: f64,
    /// The stated variances of center and radius.
    pub(super) ln_variance: [f64; 2],
    /// How readily dots are found.
    pub(super) dots: f64,
}

impl Variates {
    /// Draws them for a sequence, or for a single frame.
    pub fn draw<R: Rng + ?Sized>(rng: &mut R) -> Self {
        let mut normal = || rng.sample(StandardNormal);
        Self {
            found: normal(),
            center: [normal(), normal()],
            radius: normal(),
            ln_variance: [normal(), normal()],
            dots: normal(),
        }
    }
}

/// The shares that last, each 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Shares {
    /// Of whether the outline is found.
    pub found: f64,
    /// Of the error of its center.
    pub center: f64,
    /// Of the error of its radius.
    pub radius: f64,
    /// Of the stated variances of center and radius.
    pub ln_variance: [f64; 2],
    /// Of how readily dots are found.
    pub dots: f64,
}

impl Shares {
    /// Whether all are shares.
    pub(super) fn are_valid(&self) -> bool {
        let [of_center, of_radius] = self.ln_variance;
        [
            self.found,
            self.center,
            self.radius,
            of_center,
            of_radius,
            self.dots,
        ]
        .iter()
        .all(|s| (0.0..=1.0).contains(s))
    }

    /// The variates of a frame, partly those of its sequence.
    pub(super) fn mix(&self, sequence: &Variates, own: &Variates) -> Variates {
        let mix = |share: f64, a: f64, b: f64| share.sqrt() * a + (1.0 - share).sqrt() * b;
        Variates {
            found: mix(self.found, sequence.found, own.found),
            center: [0, 1].map(|k| mix(self.center, sequence.center[k], own.center[k])),
            radius: mix(self.radius, sequence.radius, own.radius),
            ln_variance: [0, 1].map(|k| {
                mix(
                    self.ln_variance[k],
                    sequence.ln_variance[k],
                    own.ln_variance[k],
                )
            }),
            dots: mix(self.dots, sequence.dots, own.dots),
        }
    }

    /// Learns the shares from pairs of frames of one sequence each.
    pub(super) fn learn(model: &DetectionModel, pairs: &[[Observation; 2]]) -> Self {
        let mut terms = Terms::default();
        let scores: Vec<[Scores; 2]> = pairs
            .iter()
            .map(|pair| pair.each_ref().map(|o| Scores::of(model, o, &mut terms)))
            .collect();
        let of_outlines = |score: fn(&OutlineScores) -> f64| {
            let outlines = scores.iter().filter_map(|[a, b]| a.outline.zip(b.outline));
            correlation(outlines.map(|(a, b)| (score(&a), score(&b))))
        };
        let [u, v] = [of_outlines(|o| o.center[0]), of_outlines(|o| o.center[1])];
        Self {
            found: likeliest(&scores),
            center: 0.5 * (u + v),
            radius: of_outlines(|o| o.radius),
            ln_variance: [
                of_outlines(|o| o.ln_variance[0]),
                of_outlines(|o| o.ln_variance[1]),
            ],
            dots: of_dots(&scores),
        }
    }
}

/// What was observed of a frame as standard normal variates, as far as it can be.
#[derive(Debug, Clone, Copy)]
struct Scores {
    /// Probability with which the outline is found, and whether it is.
    found: (f64, bool),
    outline: Option<OutlineScores>,
    /// Likely dots beyond those expected.
    more_dots: f64,
    /// What one standard deviation of the shift that a frame's dots share adds to them.
    per_shift: f64,
}

#[derive(Debug, Clone, Copy)]
struct OutlineScores {
    center: [f64; 2],
    radius: f64,
    ln_variance: [f64; 2],
}

impl Scores {
    fn of(model: &DetectionModel, seen: &Observation, terms: &mut Terms) -> Self {
        let (probability, class) = model.outline_chance(seen.ball(), terms);
        let products = terms.products();
        let outline = seen.outline().map(|row| {
            let level = |spread: &Spread, value: f64| {
                // The outermost quantiles are no certainties.
                spread.level(products, class, value).clamp(1e-4, 1.0 - 1e-4)
            };
            let [of_center, of_radius] = &model.outline_ln_error;
            let size = (-2.0 * (1.0 - level(of_center, row.ln_error[0])).ln()).sqrt();
            let along = row.off.xy().try_normalize(0.0).unwrap_or_default();
            let radius = normal_quantile(0.5 + 0.5 * level(of_radius, row.ln_error[1]));
            OutlineScores {
                center: [size * along.x, size * along.y],
                radius: radius * row.off.z.signum(),
                ln_variance: [0, 1].map(|k| {
                    normal_quantile(level(&model.outline_ln_variance[k], row.ln_variance[k]))
                }),
            }
        });
        let (more_dots, variance) = model.more_dots(seen, terms);
        Self {
            found: (probability, outline.is_some()),
            outline,
            more_dots,
            per_shift: model.frame_effect[class] * variance,
        }
    }
}

/// The correlation of pairs whose expected values are 0.
fn correlation(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (mut products, mut squares) = (0.0, 1e-9);
    for (a, b) in pairs {
        products += a * b;
        squares += 0.5 * (a * a + b * b);
    }
    (products / squares).clamp(0.0, 1.0)
}

/// The share of the shift that a frame's dots share: covariance of the numbers of likely dots over their
/// variance beyond that of independent ones.
fn of_dots(scores: &[[Scores; 2]]) -> f64 {
    let (mut products, mut expected) = (0.0, 1e-9);
    for [a, b] in scores {
        if a.outline.is_some() && b.outline.is_some() {
            products += a.more_dots * b.more_dots;
            expected += a.per_shift * b.per_shift;
        }
    }
    (products / expected).clamp(0.0, 1.0)
}

/// The share with which it is likeliest that the outlines of these pairs were found or not (the tetrachoric
/// correlation, K. Pearson 1900, for probabilities that differ from pair to pair).
fn likeliest(scores: &[[Scores; 2]]) -> f64 {
    let nodes: Vec<f64> = (0..NODES)
        .map(|k| normal_quantile((k as f64 + 0.5) / NODES as f64))
        .collect();
    let pairs: Vec<[(f64, bool); 2]> = scores
        .iter()
        .map(|pair| {
            pair.each_ref().map(|s| {
                let (probability, is_found) = s.found;
                (normal_quantile(probability), is_found)
            })
        })
        .collect();
    let log_likelihood = |share: f64| -> f64 {
        let of_pair = |pair: &[(f64, bool); 2]| {
            let given = |a: f64| {
                pair.iter()
                    .map(|&(limit, is_found)| {
                        let p = normal_cdf((limit - share.sqrt() * a) / (1.0 - share).sqrt());
                        if is_found { p } else { 1.0 - p }
                    })
                    .product::<f64>()
            };
            let mean = nodes.iter().map(|a| given(*a)).sum::<f64>() / NODES as f64;
            mean.max(1e-12).ln()
        };
        pairs.iter().map(of_pair).sum()
    };
    let count = (1.0 / STEP) as usize;
    (0..count)
        .map(|k| k as f64 * STEP)
        .map(|share| (share, log_likelihood(share)))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(0.0, |(share, _)| share)
}

/// The inverse of [`normal_cdf`], by bisection: only learning needs it. Between -9 and 9.
fn normal_quantile(probability: f64) -> f64 {
    let (mut low, mut high) = (-9.0, 9.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if normal_cdf(middle) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Abramowitz and Stegun, table 26.5: x for the upper tails 0.025 and 0.001.
    #[test]
    fn quantiles_are_those_of_tables() {
        assert!((normal_quantile(0.975) - 1.959_964).abs() < 1e-6);
        assert!((normal_quantile(0.001) + 3.090_232).abs() < 1e-6);
        assert!(normal_quantile(0.5).abs() < 1e-12);
    }

    #[test]
    fn two_frames_of_a_sequence_correlate_by_the_share_and_each_stays_standard_normal() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let shares = Shares {
            radius: 0.7,
            ..Shares::default()
        };
        let pairs: Vec<(f64, f64)> = (0..40_000)
            .map(|_| {
                let sequence = Variates::draw(&mut rng);
                let mut frame = || shares.mix(&sequence, &Variates::draw(&mut rng)).radius;
                (frame(), frame())
            })
            .collect();
        let variance = pairs.iter().map(|(a, _)| a * a).sum::<f64>() / pairs.len() as f64;
        assert!((variance - 1.0).abs() < 0.03, "{variance}");
        let found = correlation(pairs.iter().copied());
        assert!((found - 0.7).abs() < 0.02, "{found}");
    }

    /// The likeliest share of outlines drawn with a known one.
    #[test]
    fn a_share_of_whether_is_recovered() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let shares = Shares {
            found: 0.8,
            ..Shares::default()
        };
        let scores: Vec<[Scores; 2]> = (0..6000)
            .map(|k| {
                let probability = [0.5, 0.8, 0.95][k % 3];
                let sequence = Variates::draw(&mut rng);
                [0, 1].map(|_| {
                    let variate = shares.mix(&sequence, &Variates::draw(&mut rng)).found;
                    Scores {
                        found: (probability, normal_cdf(variate) < probability),
                        outline: None,
                        more_dots: 0.0,
                        per_shift: 0.0,
                    }
                })
            })
            .collect();
        let found = likeliest(&scores);
        assert!((found - 0.8).abs() < 0.06, "{found}");
    }
}
