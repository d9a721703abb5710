//! Rotations and directions against closed forms and brute force.

use nalgebra::Matrix3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::Error;
use spindoe::geometry::*;

fn rng() -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(7)
}

#[test]
fn spherical_derivatives_match_central_differences() {
    let mut rng = rng();
    for _ in 0..200 {
        let s = Spherical::from_direction(&random_direction(&mut rng));
        let (h, j) = (1e-6, s.jacobian());
        let moved = |dt: f64, dp: f64| {
            Spherical {
                theta: s.theta + dt,
                phi: s.phi + dp,
            }
            .to_unit()
        };
        let dt = (moved(h, 0.0) - moved(-h, 0.0)) / (2.0 * h);
        let dp = (moved(0.0, h) - moved(0.0, -h)) / (2.0 * h);
        assert!((dt - j.d_theta).norm() < 1e-9);
        assert!((dp - j.d_phi).norm() < 1e-9);
    }
}

#[test]
fn kabsch_recovers_noise_free_rotations_from_two_points_on() {
    let mut rng = rng();
    for n in 2..8 {
        for _ in 0..50 {
            let truth = random_rotation(&mut rng);
            let from: Vec<Vec3> = (0..n).map(|_| random_direction(&mut rng)).collect();
            let to: Vec<Vec3> = from.iter().map(|p| truth * p).collect();
            let found = kabsch(&from, &to, None).expect("determined");
            assert!(rotation_angle(&found, &truth) < 1e-6);
        }
    }
}

/// Sets of directions about a random one, `separation` radians wide, and the same ones turned.
fn narrow(n: usize, separation: f64, truth: &Rotation, rng: &mut ChaCha8Rng) -> [Vec<Vec3>; 2] {
    let center = random_direction(rng);
    let [e1, e2] = tangent_frame(&center);
    let turn = std::f64::consts::TAU / n as f64;
    let from = (0..n).map(|i| {
        let (s, c) = (turn * i as f64 + 0.3).sin_cos();
        let (s_half, c_half) = (0.5 * separation).sin_cos();
        center * c_half + (e1 * c + e2 * s) * s_half
    });
    let from: Vec<Vec3> = from.collect();
    let to = from.iter().map(|p| truth * p).collect();
    [from, to]
}

#[test]
fn kabsch_is_as_exact_as_the_separation_allows() {
    let mut rng = rng();
    for exponent in 0..=8 {
        let separation = 10f64.powi(-exponent);
        for n in [2, 3, 7] {
            for _ in 0..100 {
                let truth = random_rotation(&mut rng);
                let [from, to] = narrow(n, separation, &truth, &mut rng);
                let found = kabsch(&from, &to, None).expect("determined");
                // Each coordinate is rounded by 1.1e-16: over the separation, that is the angle's.
                let error = rotation_angle(&found, &truth);
                assert!(
                    error < 2e-15 / separation + 1e-11,
                    "{n} directions {separation:e} apart: {error:e}"
                );
            }
        }
    }
}

#[test]
fn kabsch_refuses_directions_too_close_to_tell_apart() {
    let mut rng = rng();
    for separation in [1e-10, 1e-12, 1e-15] {
        for n in [2, 3, 7] {
            let truth = random_rotation(&mut rng);
            let [from, to] = narrow(n, separation, &truth, &mut rng);
            let refused = kabsch(&from, &to, None);
            assert!(
                matches!(refused, Err(Error::Degenerate(_))),
                "{separation:e}: {refused:?}"
            );
            // Nearly opposite directions lie on one line too.
            let opposite = |v: &[Vec3]| -> Vec<Vec3> {
                let signed = |(i, p): (usize, &Vec3)| if i % 2 == 0 { *p } else { -p };
                v.iter().enumerate().map(signed).collect()
            };
            let refused = kabsch(&opposite(&from), &opposite(&to), None);
            assert!(matches!(refused, Err(Error::Degenerate(_))), "{refused:?}");
        }
    }
}

#[test]
fn kabsch_maximizes_among_all_rotations_of_noisy_close_directions() {
    // The residual is larger than the separation: no rotation fits, and one fits best.
    let mut rng = rng();
    for separation in [1.0, 1e-2, 1e-3, 1e-4] {
        let truth = random_rotation(&mut rng);
        let [from, mut to] = narrow(5, separation, &truth, &mut rng);
        for p in &mut to {
            *p = (*p + random_direction(&mut rng) * (0.3 * separation)).normalize();
        }
        let residual = |r: &Rotation| -> f64 {
            let pairs = from.iter().zip(&to);
            pairs.map(|(a, b)| (b - r * a).norm_squared()).sum()
        };
        let found = kabsch(&from, &to, None).expect("determined");
        let least = residual(&found);
        for _ in 0..2000 {
            let scale = separation.powf(rng.random::<f64>() * 2.0);
            let turn = random_direction(&mut rng) * (scale * rng.random::<f64>());
            let other = Rotation::from_scaled_axis(turn) * found;
            assert!(residual(&other) >= least * (1.0 - 1e-9), "{separation:e}");
        }
    }
}

#[test]
fn kabsch_does_not_care_for_the_scale_of_its_weights() {
    let mut rng = rng();
    let truth = random_rotation(&mut rng);
    let from: Vec<Vec3> = (0..4).map(|_| random_direction(&mut rng)).collect();
    let to: Vec<Vec3> = from.iter().map(|p| truth * p).collect();
    for scale in [1e-200, 1e-9, 1.0, 1e200] {
        let found = kabsch(&from, &to, Some(&[scale; 4])).expect("determined");
        assert!(rotation_angle(&found, &truth) < 1e-9, "{scale:e}");
    }
    assert!(kabsch(&from, &to, Some(&[0.0; 4])).is_err());
}

#[test]
fn kabsch_never_answers_with_a_reflection() {
    let mut rng = rng();
    let from: Vec<Vec3> = (0..6).map(|_| random_direction(&mut rng)).collect();
    let to: Vec<Vec3> = from.iter().map(|p| Vec3::new(-p.x, p.y, p.z)).collect();
    let found = kabsch(&from, &to, None).expect("determined");
    let m: Matrix3<f64> = *found.to_rotation_matrix().matrix();
    assert!((m.determinant() - 1.0).abs() < 1e-12);
}

#[test]
fn kabsch_refuses_what_leaves_the_rotation_open() {
    let a = Vec3::z();
    for set in [vec![], vec![a], vec![a, a, a], vec![a, -a]] {
        assert!(matches!(
            kabsch(&set, &set, None),
            Err(Error::Degenerate(_))
        ));
    }
    // A mirrored frame fits several rotations equally well.
    let from = [Vec3::x(), Vec3::y(), Vec3::z()];
    let to = [-Vec3::x(), -Vec3::y(), -Vec3::z()];
    assert!(matches!(
        kabsch(&from, &to, None),
        Err(Error::Degenerate(_))
    ));
    let nan = [Vec3::new(f64::NAN, 0.0, 0.0), Vec3::y()];
    assert!(kabsch(&nan, &nan, None).is_err());
    assert!(kabsch(&from, &to, Some(&[1.0, -1.0, 1.0])).is_err());
}

#[test]
fn kabsch_weights_act_as_repetition() {
    let mut rng = rng();
    let from: Vec<Vec3> = (0..4).map(|_| random_direction(&mut rng)).collect();
    let to: Vec<Vec3> = (0..4).map(|_| random_direction(&mut rng)).collect();
    let weights = [1.0, 2.0, 3.0, 1.0];
    let repeat = |v: &[Vec3]| -> Vec<Vec3> {
        v.iter()
            .zip(weights)
            .flat_map(|(p, w)| std::iter::repeat_n(*p, w as usize))
            .collect()
    };
    let a = kabsch(&from, &to, Some(&weights)).expect("determined");
    let b = kabsch(&repeat(&from), &repeat(&to), None).expect("determined");
    assert!(rotation_angle(&a, &b) < 1e-7);
}

#[test]
fn random_rotations_have_the_haar_angle_distribution() {
    // P(angle < t) = (t - sin t) / pi on SO(3).
    let mut rng = rng();
    let n = 20_000;
    let mut angles: Vec<f64> = (0..n).map(|_| random_rotation(&mut rng).angle()).collect();
    angles.sort_by(f64::total_cmp);
    let worst = angles
        .iter()
        .enumerate()
        .map(|(i, t)| ((t - t.sin()) / std::f64::consts::PI - i as f64 / n as f64).abs())
        .fold(0.0, f64::max);
    // Kolmogorov-Smirnov: 1.95 / sqrt(n) is passed once in a thousand seeds.
    assert!(worst < 1.95 / (n as f64).sqrt(), "{worst}");
}

/// By hand: a quarter turn about z takes x to y and y to -x.
#[test]
fn a_position_turns_with_all_that_is_known_of_it() {
    let position = Position {
        center_m: Vec3::new(1.0, 2.0, 3.0),
        covariance: Matrix3::from_diagonal(&Vec3::new(4.0, 5.0, 6.0)),
        with_rotation: Some(Matrix3::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)),
    };
    let quarter = Rotation::from_axis_angle(&Vec3::z_axis(), std::f64::consts::FRAC_PI_2);
    let turned = position.turned(&quarter);
    assert!((turned.center_m - Vec3::new(-2.0, 1.0, 3.0)).amax() < 1e-14);
    let expected = Matrix3::from_diagonal(&Vec3::new(5.0, 4.0, 6.0));
    assert!((turned.covariance - expected).amax() < 1e-14);
    let expected = Matrix3::new(5.0, -4.0, -6.0, -2.0, 1.0, 3.0, -8.0, 7.0, 9.0);
    let found = turned.with_rotation.expect("as before");
    assert!((found - expected).amax() < 1e-14, "{found}");
}
