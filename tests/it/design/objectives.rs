//! Objectives: their values against brute force and Monte Carlo, their gradients against differences.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use spindoe::design::objective::align::align;
use spindoe::design::objective::basis;
use spindoe::design::objective::{Confusion, WhitenedNearestNeighbor};
use spindoe::design::{Objective, ObjectiveName, OrientationBound};
use spindoe::geometry::{
    Rotation, Spherical, Vec3, kabsch, random_direction, random_rotation, tangent_frame,
};
use spindoe::pattern::Pattern;
use spindoe::view::ProtocolName;

fn objectives() -> [Objective; 3] {
    let views = [ProtocolName::Sparse.view(), ProtocolName::Image.view()];
    ObjectiveName::ALL.map(|name| Objective::for_views(name, &views, 14).unwrap())
}

fn at(coordinates: &[f64]) -> Vec<Vec3> {
    coordinates
        .chunks_exact(2)
        .map(|c| {
            Spherical {
                theta: c[0],
                phi: c[1],
            }
            .to_unit()
        })
        .collect()
}

fn coordinates(dots: &[Vec3]) -> Vec<f64> {
    dots.iter()
        .flat_map(|d| {
            let s = Spherical::from_direction(d);
            [s.theta, s.phi]
        })
        .collect()
}

#[test]
fn gradients_in_spherical_coordinates_match_central_differences() {
    let h = 1e-6;
    for seed in 0..2 {
        let pattern = crate::common::random_pattern(14, seed);
        let x = coordinates(pattern.dots());
        for objective in objectives() {
            let gradient = objective
                .evaluate_at(pattern.dots())
                .unwrap()
                .spherical_gradient(pattern.dots());
            let largest = gradient.iter().fold(0.0f64, |a, g| a.max(g.abs()));
            assert!(largest > 1e-4, "{}: no slope anywhere", objective.name());
            for k in 0..x.len() {
                let value = |d: f64| {
                    let mut y = x.clone();
                    y[k] += d;
                    objective.evaluate_at(&at(&y)).unwrap().value
                };
                let numeric = (value(h) - value(-h)) / (2.0 * h);
                let error = (numeric - gradient[k]).abs();
                assert!(
                    error < 2e-3 * largest,
                    "{} {k}: {numeric} against {}",
                    objective.name(),
                    gradient[k]
                );
            }
        }
    }
}

#[test]
fn no_objective_changes_when_the_ball_turns() {
    let pattern = crate::common::random_pattern(14, 3);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let r: Rotation = random_rotation(&mut rng);
    let turned: Vec<Vec3> = pattern.dots().iter().map(|d| r * d).collect();
    for objective in objectives() {
        let value = |dots: &[Vec3]| objective.evaluate_at(dots).unwrap().value;
        let (a, b) = (value(pattern.dots()), value(&turned));
        // The failure rate samples viewing directions, which do not turn along.
        let tolerance = match objective.name() {
            ObjectiveName::FailureRate => 0.02,
            _ => 1e-9,
        };
        assert!(
            (a - b).abs() < tolerance * a,
            "{}: {a} {b}",
            objective.name()
        );
    }
}

#[test]
fn alignment_is_kabsch() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..200 {
        let r: Rotation = random_rotation(&mut rng);
        let other: Vec<Vec3> = (0..4).map(|_| random_direction(&mut rng)).collect();
        let seen: Vec<Vec3> = other
            .iter()
            .map(|d| (r * d + 0.1 * random_direction(&mut rng)).normalize())
            .collect();
        let best = kabsch(&other, &seen, None).unwrap();
        let expected: f64 = seen
            .iter()
            .zip(&other)
            .map(|(s, o)| (s - best * o).norm_squared())
            .sum();
        let all: Vec<Vec3> = seen.iter().chain(&other).copied().collect();
        let start = *r.to_rotation_matrix().matrix();
        let found = align(&all, &[0, 1, 2, 3], &[4, 5, 6, 7], &start).unwrap();
        assert!((found.distance_squared - expected).abs() < 1e-7 * (1.0 + expected));
    }
}

#[test]
fn whitened_distance_matches_brute_force() {
    let pattern = crate::common::random_pattern(7, 2);
    let dots = pattern.dots();
    let triples: Vec<[usize; 3]> = (0..7 * 7 * 7)
        .map(|k| [k / 49, k / 7 % 7, k % 7])
        .filter(|[i, j, k]| i != j && j != k && i != k)
        .collect();
    let distance = |a: &[usize; 3], b: &[usize; 3]| {
        let (to, from) = (a.map(|i| dots[i]), b.map(|i| dots[i]));
        let r = kabsch(&from, &to, None).unwrap();
        let d2: f64 = to
            .iter()
            .zip(&from)
            .map(|(t, f)| (t - r * f).norm_squared())
            .sum();
        d2.sqrt()
    };
    let sorted: Vec<_> = triples.iter().filter(|t| t.is_sorted()).collect();
    let sum: f64 = sorted
        .iter()
        .map(|t| {
            triples
                .iter()
                .filter(|other| other != t)
                .map(|other| distance(t, other))
                .fold(f64::INFINITY, f64::min)
        })
        .sum();
    let expected = sum / sorted.len() as f64;
    let found = WhitenedNearestNeighbor { sigma_rad: 1.0 }
        .evaluate(dots)
        .unwrap();
    assert!(
        (found.value - expected).abs() < 0.01 * expected,
        "{} {expected}",
        found.value
    );
}

/// Two quadruples that look alike, far apart on the ball, and nothing else: the rate at which the one is
/// taken for the other is a matter of the normal distribution, and can be drawn.
#[test]
fn the_rate_of_confusion_is_what_is_drawn() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let sigma = 0.03;
    let first = [[0.0, 0.0], [0.7, 0.3], [0.6, 2.4], [0.8, 4.1]]
        .map(|[theta, phi]: [f64; 2]| Spherical { theta, phi }.to_unit());
    let turn = Rotation::from_scaled_axis(Vec3::new(3.0, 0.4, 0.2));
    let second = first.map(|d| {
        let [a, b] = tangent_frame(&d);
        let mut z = || -> f64 { StandardNormal.sample(&mut rng) };
        turn * (d + 1.2 * sigma * (z() * a + z() * b)).normalize()
    });
    let dots: Vec<Vec3> = first.into_iter().chain(second).collect();
    let confusion = Confusion {
        sigma_rad: sigma,
        tail_factor: 1.0,
        visibility_limit: 0.5,
    };
    let worked_out = confusion.evaluate(&dots).value;
    // Draw: which of the two explanations lies nearer, after the best rotation?
    let residual = |seen: &[Vec3; 4], of: &[Vec3; 4]| -> f64 {
        let r = kabsch(of, seen, None).unwrap();
        of.iter()
            .zip(seen)
            .map(|(o, s)| (s - r * o).norm_squared())
            .sum()
    };
    let (mut wrong, trials) = (0, 40_000);
    for _ in 0..trials {
        let seen = first.map(|d| {
            let [a, b] = tangent_frame(&d);
            let mut z = || -> f64 { StandardNormal.sample(&mut rng) };
            (d + sigma * (z() * a + z() * b)).normalize()
        });
        wrong += usize::from(residual(&seen, &second) < residual(&seen, &first));
    }
    let drawn = wrong as f64 / f64::from(trials);
    // The weights: views that give all four dots of one side. The others hardly see four dots at all.
    let views = spindoe::geometry::spiral_directions(4000)
        .filter(|v| dots.iter().filter(|d| d.dot(v) > 0.5).count() >= 4)
        .count() as f64
        / 4000.0;
    assert!(drawn > 0.02 && views > 0.02, "{drawn} {views}");
    let expected = drawn * views;
    assert!(
        (worked_out - expected).abs() < 0.15 * expected,
        "worked out {worked_out}, drawn {expected} ({drawn} of {views})"
    );
}

#[test]
fn the_orientation_bound_has_its_closed_forms() {
    // Six dots on the axes: from a general direction three are in view, at right angles, and
    // H = 3 I - I = 2 I: the bound is sqrt(3 / 2) everywhere.
    // Turned at random, since some of the sampled directions would have dots just on the limb.
    let r: Rotation = random_rotation(&mut ChaCha8Rng::seed_from_u64(3));
    let dots: Vec<Vec3> = [Vec3::x(), Vec3::y(), Vec3::z()]
        .into_iter()
        .flat_map(|a| [r * a, -(r * a)])
        .collect();
    let found = OrientationBound::default().summary(&dots);
    assert!((found.mean - 1.5f64.sqrt()).abs() < 1e-9, "{found:?}");
    assert!((found.worst - 1.5f64.sqrt()).abs() < 1e-9, "{found:?}");
}

#[test]
fn the_bound_s_gradient_matches_central_differences() {
    let bound = OrientationBound::default();
    let pattern: Pattern = crate::common::random_pattern(12, 1);
    let x = coordinates(pattern.dots());
    let gradient = bound
        .cost(pattern.dots())
        .spherical_gradient(pattern.dots());
    let h = 1e-6;
    for k in 0..x.len() {
        let value = |d: f64| {
            let mut y = x.clone();
            y[k] += d;
            bound.cost(&at(&y)).value
        };
        let numeric = (value(h) - value(-h)) / (2.0 * h);
        assert!(
            (numeric - gradient[k]).abs() < 1e-6,
            "{k}: {numeric} {}",
            gradient[k]
        );
    }
}

#[test]
fn the_worth_of_bases_has_its_closed_form_and_slope() {
    // An octahedron: its twelve pairs at right angles are all alike, its three of opposite dots are never
    // both in view.
    let mut octahedron = Vec::new();
    for axis in [Vec3::x(), Vec3::y(), Vec3::z()] {
        octahedron.extend([axis, -axis]);
    }
    let value = basis::evaluate(&octahedron).value;
    assert!((value - (-6.0f64).exp()).abs() < 1e-12, "{value}");
    let pattern = crate::common::random_pattern(12, 4);
    let x = coordinates(pattern.dots());
    let gradient = basis::evaluate(pattern.dots()).spherical_gradient(pattern.dots());
    let h = 1e-6;
    for k in 0..x.len() {
        let value = |d: f64| {
            let mut y = x.clone();
            y[k] += d;
            basis::evaluate(&at(&y)).value
        };
        let numeric = (value(h) - value(-h)) / (2.0 * h);
        assert!((numeric - gradient[k]).abs() < 1e-7, "{k}: {numeric}");
    }
}
