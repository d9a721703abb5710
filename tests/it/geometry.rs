//! Rotations and directions against closed forms and brute force.

use nalgebra::Matrix3;
use rand::SeedableRng;
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
