//! Confusion against brute force over all pairs of pairs and all subsets of their matches, its sample
//! against the whole, its slope against differences, and its value against trials.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::design::objective::{Confusion, Detection};
use spindoe::design::{Objective, ObjectiveName};
use spindoe::geometry::{Vec3, pair_rotation, random_direction, spiral_directions, tangent_frame};
use spindoe::recognize::robust::RobustRecognizer;
use spindoe::validate::{Noise, Protocol, ProtocolName, validate};

/// All protocols, and a small ball in the image, whose noise is far beyond first order.
fn protocols() -> Vec<Protocol> {
    let mut all = ProtocolName::ALL.map(Protocol::standard).to_vec();
    all.push(small_ball(10.0, 0.3));
    all
}

fn small_ball(radius_px: f64, miss_probability: f64) -> Protocol {
    Protocol {
        noise: Noise::Pixel {
            sigma_px: 1.0,
            radius_px,
        },
        miss_probability,
        ..Protocol::standard(ProtocolName::Image)
    }
}

fn confusion(protocol: &Protocol) -> Confusion {
    match Objective::for_protocol(ObjectiveName::Confusion, protocol) {
        Objective::Confusion(confusion) => confusion,
        other => panic!("{other:?}"),
    }
}

/// Random dots, of which the last lies at this angle from the first.
fn with_a_pair(n: usize, separation_rad: f64, seed: u64) -> Vec<Vec3> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut dots: Vec<Vec3> = Vec::new();
    while dots.len() < n - 1 {
        let d = random_direction(&mut rng);
        if dots.iter().all(|p| p.dot(&d) < 0.3f64.cos()) {
            dots.push(d);
        }
    }
    let [axis, _] = tangent_frame(&dots[0]);
    dots.push(dots[0] * separation_rad.cos() + axis * separation_rad.sin());
    dots
}

fn cube() -> Vec<Vec3> {
    let s = 1.0 / 3f64.sqrt();
    (0..8)
        .map(|k| {
            let sign = |bit: usize| if k >> bit & 1 == 0 { s } else { -s };
            Vec3::new(sign(0), sign(1), sign(2))
        })
        .collect()
}

/// The likeness of two dots or pairs, faded out between two distances, both in sigma.
fn likeness(squared: f64, sigma: f64, [begin, end]: [f64; 2]) -> f64 {
    let [b, e] = [begin, end].map(|x: f64| (x * sigma).powi(2));
    let t = ((squared - b) / (e - b)).clamp(0.0, 1.0);
    (-squared / (8.0 * sigma * sigma)).exp() * (1.0 - t * t * (3.0 - 2.0 * t))
}

/// The sum of products over all subsets of `size` elements, by bits.
fn subsets(x: &[f64], size: usize) -> f64 {
    (0u32..1 << x.len())
        .filter(|bits| bits.count_ones() as usize == size)
        .map(|bits| {
            let chosen = x.iter().enumerate().filter(|(k, _)| bits >> k & 1 == 1);
            chosen.map(|(_, x)| x).product::<f64>()
        })
        .sum()
}

/// The sum `U_k` of each number of matched dots, as the module's head writes it: every pair of dots on
/// every other, every view, every subset of the matches. No index, no inverse poses left out.
fn unions(dots: &[Vec3], config: &Confusion) -> Vec<f64> {
    let n = dots.len();
    let sigma = config.sigma_rad * config.tail_factor;
    let views: Vec<Vec3> = spiral_directions(400).collect();
    let seen =
        |d: &Vec3, v: &Vec3| 1.0 / (1.0 + (-(d.dot(v) - config.visibility_limit) / 0.04).exp());
    // Probability of detection and factor of a dot without a match.
    let model = |d: &Vec3, v: &Vec3| match config.detection {
        Detection::Given { .. } => (seen(d, v), 1.0),
        Detection::Independent {
            probability,
            false_dots,
        } => {
            let p = probability.min(0.98) * seen(d, v);
            let density =
                false_dots / (2.0 * std::f64::consts::PI * (1.0 - config.visibility_limit));
            let by_chance = (density * 8.0 * std::f64::consts::PI).sqrt() * sigma;
            (p, (1.0 - p).sqrt() + by_chance * p.sqrt())
        }
    };
    let weight = |v: &Vec3| match config.detection {
        Detection::Given { dots: given } => {
            let all: Vec<f64> = dots.iter().map(|d| seen(d, v)).collect();
            1.0 / subsets(&all, given).max(1.0)
        }
        Detection::Independent { .. } => dots.iter().map(|d| model(d, v).1).product(),
    };
    let mut unions = vec![0.0; n + 1];
    let pairs = || (0..n).flat_map(move |a| (0..n).filter(move |&b| b != a).map(move |b| [a, b]));
    for [a, b] in pairs().filter(|[a, b]| a < b) {
        for [c, d] in pairs().filter(|other| *other != [a, b]) {
            let Some(turn) = pair_rotation([&dots[a], &dots[b]], [&dots[c], &dots[d]]) else {
                continue;
            };
            let off = (turn * dots[a] - dots[c]).norm_squared()
                + (turn * dots[b] - dots[d]).norm_squared();
            let alike = likeness(off, sigma, [3.0, 4.0]);
            // Where orientations are judged, a small turn is no failure.
            let t = match config.detection {
                Detection::Given { .. } => 1.0,
                Detection::Independent { .. } => {
                    let [begin, end] = [10f64, 20.0].map(|deg| deg.to_radians().cos());
                    ((begin - 0.5 * (turn.trace() - 1.0)) / (begin - end)).clamp(0.0, 1.0)
                }
            };
            let alike = alike * t * t * (3.0 - 2.0 * t);
            if alike == 0.0 {
                continue;
            }
            let matched: Vec<f64> = (0..n)
                .map(|i| {
                    let others = (0..n).filter(|&j| i != a && i != b && j != c && j != d);
                    others
                        .map(|j| {
                            likeness((turn * dots[i] - dots[j]).norm_squared(), sigma, [4.0, 5.5])
                        })
                        .sum()
                })
                .collect();
            for v in &views {
                let factor = |i: usize| {
                    let (p, u) = model(&dots[i], v);
                    p / (u * u)
                };
                let claimed = match config.detection {
                    Detection::Given { .. } => 1.0,
                    Detection::Independent { .. } => weight(&(turn * v)),
                };
                let x: Vec<f64> = (0..n)
                    .map(|i| matched[i] * factor(i))
                    .filter(|x| *x > 0.0)
                    .collect();
                let whole =
                    0.5 * weight(v) * claimed * alike * factor(a) * factor(b) / views.len() as f64;
                for k in 3..=n.min(x.len() + 2) {
                    unions[k] += whole * subsets(&x, k - 2) * 2.0 / (k * (k - 1)) as f64;
                }
            }
        }
    }
    unions
}

/// The probability of each number of detected dots, over all views, by all subsets.
fn counts(dots: &[Vec3], config: &Confusion, probability: f64) -> Vec<f64> {
    let n = dots.len();
    let mut counts = vec![0.0; n + 1];
    for v in spiral_directions(400) {
        let p: Vec<f64> = dots
            .iter()
            .map(|d| {
                probability.min(0.98)
                    / (1.0 + (-(d.dot(&v) - config.visibility_limit) / 0.04).exp())
            })
            .collect();
        let none: f64 = p.iter().map(|p| 1.0 - p).product();
        let odds: Vec<f64> = p.iter().map(|p| p / (1.0 - p)).collect();
        for (k, count) in counts.iter_mut().enumerate() {
            *count += none * subsets(&odds, k) / 400.0;
        }
    }
    counts
}

fn brute_force(dots: &[Vec3], config: &Confusion) -> f64 {
    let unions = unions(dots, config);
    match config.detection {
        Detection::Given { dots: given } => 1.0 - (-unions[given]).exp(),
        Detection::Independent { probability, .. } => {
            let counts = counts(dots, config, probability);
            let terms = counts.iter().zip(&unions).skip(3);
            terms.map(|(p, u)| p * (1.0 - (-u / p).exp())).sum()
        }
    }
}

#[test]
fn confusion_is_the_sum_over_all_pairs_of_pairs_and_subsets() {
    let near = 8f64.to_radians();
    let patterns = [
        ("far", with_a_pair(8, 0.6, 1)),
        ("near", with_a_pair(7, near, 2)),
        ("opposite", with_a_pair(7, std::f64::consts::PI - near, 3)),
        ("cube", cube()),
    ];
    for protocol in protocols() {
        let config = Confusion {
            view_stride: 1,
            ..confusion(&protocol)
        };
        for (name, dots) in &patterns {
            let found = config.evaluate(dots).unwrap().value;
            let expected = brute_force(dots, &config);
            // Skipped: pairs hardly in view, and matches of hardly any weight. The weight of the view
            // that a pose claims is interpolated.
            let tolerance = match config.detection {
                Detection::Given { .. } => 5e-3,
                Detection::Independent { probability, .. } if probability > 0.95 => 0.15,
                Detection::Independent { .. } => 0.06,
            };
            assert!(
                (found - expected).abs() < tolerance * expected,
                "{} {name}: {found}, brute force {expected}",
                protocol.name
            );
        }
    }
}

#[test]
fn a_sample_of_poses_and_views_stands_for_all() {
    let dots = crate::common::random_pattern(16, 5).dots().to_vec();
    for protocol in [
        Protocol::standard(ProtocolName::Sparse),
        small_ball(15.0, 0.3),
    ] {
        let whole = Confusion {
            poses_per_square: 1e9,
            view_stride: 1,
            ..confusion(&protocol)
        };
        let expected = whole.evaluate(&dots).unwrap().value;
        let values: Vec<f64> = (0..40)
            .map(|sample_seed| {
                let sample = Confusion {
                    poses_per_square: 3.0,
                    view_stride: 16,
                    sample_seed,
                    ..whole
                };
                sample.evaluate(&dots).unwrap().value
            })
            .collect();
        let mean = values.iter().sum::<f64>() / 40.0;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 39.0;
        let error = (variance / 40.0).sqrt();
        // The saturation bends the mean a little.
        assert!(
            (mean - expected).abs() < 4.0 * error + 0.01 * expected && error < 0.1 * expected,
            "{}: mean {mean} +- {error}, all {expected}",
            protocol.name
        );
    }
}

#[test]
fn confusion_s_slope_matches_central_differences() {
    let h = 1e-6;
    let many = crate::common::random_pattern(40, 6).dots().to_vec();
    for protocol in protocols() {
        let config = confusion(&protocol);
        for dots in [
            with_a_pair(9, 0.14, 2),
            with_a_pair(12, 0.7, 4),
            many.clone(),
        ] {
            let gradient = config.evaluate(&dots).unwrap().gradient;
            let largest = gradient.iter().map(Vec3::norm).fold(0.0, f64::max);
            for i in (0..dots.len()).step_by(dots.len() / 8) {
                for axis in tangent_frame(&dots[i]) {
                    let value = |step: f64| {
                        let mut moved = dots.clone();
                        moved[i] = (moved[i] + step * axis).normalize();
                        config.evaluate(&moved).unwrap().value
                    };
                    let numeric = (value(h) - value(-h)) / (2.0 * h);
                    let error = (numeric - gradient[i].dot(&axis)).abs();
                    assert!(
                        error < 0.01 * largest + 1e-9,
                        "{} {} dots, dot {i}: {numeric} against {}",
                        protocol.name,
                        dots.len(),
                        gradient[i].dot(&axis)
                    );
                }
            }
        }
    }
}

/// The value is a bound on a rate that trials measure: it must lie within a small factor of it, and
/// order a symmetric pattern behind a good one.
#[test]
fn confusion_is_near_the_rate_of_trials() {
    let protocol = small_ball(15.0, 0.3);
    let config = confusion(&protocol);
    for n in [12, 16, 20] {
        let pattern = crate::common::random_pattern(n, 9);
        let robust = RobustRecognizer::new(&pattern, protocol.recognizer_config()).unwrap();
        let measured = validate(&pattern, &robust, &protocol, 17, 2_000).unwrap();
        let failures = 1.0 - measured.orientation.rate;
        let found = config.evaluate(pattern.dots()).unwrap().value;
        assert!(
            found > 0.2 * failures && found < 6.0 * failures + 2e-3,
            "{n} dots: {found}, measured {failures}"
        );
    }
    assert!(config.evaluate(&cube()).unwrap().value > 0.4);
}

#[test]
fn confusion_rejects_parameters_outside_their_domains() {
    let dots = cube();
    let rejected = |config: Confusion, name: &str| {
        let error = config.evaluate(&dots).unwrap_err().to_string();
        assert!(error.starts_with(name), "{error}");
    };
    let given = |dots| Detection::Given { dots };
    let base = Confusion::default();
    rejected(
        Confusion {
            sigma_rad: 0.0,
            ..base
        },
        "sigma_rad",
    );
    rejected(
        Confusion {
            view_stride: 0,
            ..base
        },
        "view_stride",
    );
    rejected(
        Confusion {
            detection: given(2),
            ..base
        },
        "dots_given",
    );
    rejected(
        Confusion {
            detection: given(10),
            ..base
        },
        "dots_given",
    );
    let all = vec![Vec3::x(); 65];
    assert!(base.evaluate(&all).is_err());
}
