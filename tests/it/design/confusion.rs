//! Confusion against brute force over all ordered quadruples, and its slope against differences.

use super::central_difference;
use nalgebra::Matrix3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::design::objective::Confusion;
use spindoe::geometry::{Vec3, random_direction, spiral_directions, tangent_frame};
use spindoe::view::{Noise, ProtocolName, ViewModel};

/// The views of all protocols, and of a small ball in the image, whose noise is far beyond first order.
fn views() -> Vec<(String, ViewModel)> {
    let mut all: Vec<_> = ProtocolName::ALL
        .map(|name| (name.to_string(), name.view()))
        .into();
    let noise = Noise::Pixel {
        sigma_px: 1.0,
        radius_px: 10.0,
    };
    let small = ViewModel {
        noise,
        ..ProtocolName::Image.view()
    };
    all.push(("small image".into(), small));
    all
}

fn confusion(view: &ViewModel) -> Confusion {
    Confusion::of_view(view)
}

/// Random dots, of which the last lies at this angle from the first.
fn with_a_pair(n: usize, separation_rad: f64, seed: u64) -> Vec<Vec3> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut dots: Vec<Vec3> = Vec::new();
    while dots.len() < n - 1 {
        let d = random_direction(&mut rng);
        if dots.iter().all(|p| p.dot(&d) < 0.35f64.cos()) {
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

/// The least sum of squared distances over all rotations, by singular values.
fn distance_squared(dots: &[Vec3], seen: &[usize; 4], other: &[usize; 4]) -> f64 {
    let pairs = seen.iter().zip(other);
    let m: Matrix3<f64> = pairs.map(|(&s, &o)| dots[s] * dots[o].transpose()).sum();
    let mut sigma: Vec<f64> = m.singular_values().iter().copied().collect();
    sigma.sort_by(f64::total_cmp);
    8.0 - 2.0 * (sigma[2] + sigma[1] + sigma[0] * m.determinant().signum())
}

/// The objective as its module's head writes it, over every ordered quadruple, with `fade` of `d / sigma`.
fn brute_force(dots: &[Vec3], config: &Confusion, fade: &dyn Fn(f64) -> f64) -> f64 {
    let n = dots.len();
    let sigma = config.sigma_rad * config.tail_factor;
    let sets: Vec<[usize; 4]> = (0..n.pow(4))
        .map(|k| [k / n.pow(3), k / n.pow(2) % n, k / n % n, k % n])
        .filter(|q| (0..4).all(|x| (0..x).all(|y| q[x] != q[y])))
        .collect();
    let ascending: Vec<&[usize; 4]> = sets.iter().filter(|q| q.is_sorted()).collect();
    let failures: Vec<f64> = ascending
        .iter()
        .map(|seen| {
            let union: f64 = sets
                .iter()
                .filter(|other| other != seen)
                .map(|other| {
                    let d = distance_squared(dots, seen, other).max(0.0).sqrt() / sigma;
                    0.5 * libm::erfc(0.5 * d / 2f64.sqrt()) * fade(d)
                })
                .sum();
            1.0 - (-union).exp()
        })
        .collect();
    let views = 400;
    let mut value = 0.0;
    for v in spiral_directions(views) {
        let seen: Vec<f64> = dots
            .iter()
            .map(|d| 1.0 / (1.0 + (-(d.dot(&v) - config.visibility_limit) / 0.04).exp()))
            .collect();
        let product = |q: &[usize; 4]| q.iter().map(|&i| seen[i]).product::<f64>();
        let all: f64 = ascending.iter().map(|q| product(q)).sum();
        let failed: f64 = ascending
            .iter()
            .zip(&failures)
            .map(|(q, failure)| product(q) * failure)
            .sum();
        value += failed / all.max(1.0) / views as f64;
    }
    value
}

/// From one to zero between 4.5 and 6 sigma, as the objective has it.
fn faded(d: f64) -> f64 {
    let t = ((d - 4.5) / 1.5).clamp(0.0, 1.0);
    1.0 - t * t * (3.0 - 2.0 * t)
}

#[test]
fn confusion_is_the_sum_over_all_ordered_quadruples() {
    let near = 6f64.to_radians();
    let patterns = [
        ("far", with_a_pair(9, 0.6, 1)),
        ("near", with_a_pair(9, near, 2)),
        ("opposite", with_a_pair(8, std::f64::consts::PI - near, 3)),
        ("cube", cube()),
    ];
    for (of, view) in views() {
        let config = confusion(&view);
        for (name, dots) in &patterns {
            let found = config.evaluate(dots).value;
            let expected = brute_force(dots, &config, &faded);
            // Quadruples that are in view with a probability below 1e-6 are skipped.
            assert!(
                (found - expected).abs() < 5e-4 * expected,
                "{of} {name}: {found}, brute force {expected}"
            );
        }
    }
}

#[test]
fn the_fading_tail_is_a_small_part() {
    let dots = with_a_pair(9, 0.4, 5);
    let config = confusion(&ProtocolName::Sparse.view());
    let found = config.evaluate(&dots).value;
    let whole = brute_force(&dots, &config, &|_| 1.0);
    assert!(found < whole && found > 0.7 * whole, "{found} {whole}");
}

#[test]
fn twelve_dots_with_two_near_pairs() {
    let mut dots = with_a_pair(11, 0.12, 7);
    let [axis, _] = tangent_frame(&dots[1]);
    dots.push((dots[1] + 0.1 * axis).normalize());
    let config = confusion(&ProtocolName::Sparse.view());
    let found = config.evaluate(&dots).value;
    let expected = brute_force(&dots, &config, &faded);
    assert!(
        (found - expected).abs() < 5e-4 * expected,
        "{found} {expected}"
    );
}

#[test]
fn confusion_s_slope_matches_central_differences() {
    let h = 1e-6;
    for (of, view) in views() {
        let config = confusion(&view);
        for dots in [with_a_pair(9, 0.12, 2), with_a_pair(10, 0.7, 4)] {
            let gradient = config.evaluate(&dots).gradient;
            let largest = gradient.iter().map(Vec3::norm).fold(0.0, f64::max);
            assert!(largest > 1e-4, "{of}: no slope anywhere");
            for i in 0..dots.len() {
                for axis in tangent_frame(&dots[i]) {
                    let value = |dots: &[Vec3]| config.evaluate(dots).value;
                    let numeric = central_difference(&dots, i, &axis, h, value);
                    let error = (numeric - gradient[i].dot(&axis)).abs();
                    assert!(
                        error < 1e-3 * largest,
                        "{of} dot {i}: {numeric} against {}",
                        gradient[i].dot(&axis)
                    );
                }
            }
        }
    }
}
