//! Features and what a ball records, against their definitions.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::ball::{Ball, BasisFrame, PairRule, PaperConfig};
use spindoe::geometry::{Vec3, random_direction, random_rotation};
use spindoe::recognize::paper::FeatureTree;

#[test]
fn basis_times_feature_is_the_third_dot() {
    let pattern = crate::common::random_pattern(20, 1);
    let dots = pattern.dots();
    let mut count = 0;
    for f in PairRule::ALL.features(dots) {
        let (i, j) = (usize::from(f.basis.first), usize::from(f.basis.second));
        let frame = BasisFrame::new(&dots[i], &dots[j], 0.0).expect("not singular");
        let third = dots[usize::from(f.dot)];
        let scale = 1.0 / frame.determinant();
        assert!((frame.matrix() * Vec3::from(f.value) - third).norm() < 1e-13 * scale);
        assert!((frame.point(&f.value) - third).norm() < 1e-13 * scale);
        assert!((frame.matrix().determinant() - frame.determinant()).abs() < 1e-14);
        count += 1;
    }
    assert_eq!(count, 20 * 19 * 18);
}

#[test]
fn features_do_not_change_when_the_ball_turns() {
    let pattern = crate::common::random_pattern(12, 2);
    let r = random_rotation(&mut ChaCha8Rng::seed_from_u64(5));
    let turned: Vec<Vec3> = pattern.dots().iter().map(|d| r * d).collect();
    let rule = PairRule::default();
    let (before, after): (Vec<_>, Vec<_>) = (
        rule.features(pattern.dots()).collect(),
        rule.features(&turned).collect(),
    );
    assert_eq!(before.len(), after.len());
    for (a, b) in before.iter().zip(&after) {
        assert_eq!((a.basis, a.dot), (b.basis, b.dot));
        assert!((Vec3::from(a.value) - Vec3::from(b.value)).norm() < 1e-11);
    }
}

#[test]
fn the_pair_rule_leaves_out_close_and_opposite_pairs() {
    let rule = PairRule::default();
    let at = |degrees: f64| {
        let (s, c) = degrees.to_radians().sin_cos();
        rule.frame(&Vec3::x(), &Vec3::new(c, s, 0.0)).is_some()
    };
    assert!(!at(0.0) && !at(5.7) && at(5.8) && at(90.0) && at(169.9) && !at(170.1) && !at(180.0));
    for (min_cross, max_angle_rad) in [
        (0.0, 3.0),
        (1.0, 3.0),
        (f64::NAN, 3.0),
        (0.1, 0.0),
        (0.1, 3.2),
        (0.1, f64::NAN),
    ] {
        let rule = PairRule {
            min_cross,
            max_angle_rad,
        };
        assert!(rule.check().is_err(), "{rule:?}");
    }
    // A rule that leaves nothing is refused, not built.
    let rule = PairRule {
        min_cross: 0.1,
        max_angle_rad: 0.11,
    };
    let ball = Ball::new(crate::common::random_pattern(8, 1));
    assert!(ball.with_pair_rule(rule).is_err());
}

#[test]
fn a_symmetric_pattern_with_many_equal_features_builds() {
    // The cube's corners: features coincide in crowds, pairs are opposite.
    let corners = (0..8)
        .map(|i| {
            let sign = |bit: i32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            Vec3::new(sign(0), sign(1), sign(2)).normalize()
        })
        .collect();
    let pattern = spindoe::pattern::Pattern::new(corners).expect("distinct unit vectors");
    let tree = FeatureTree::new(&Ball::new(pattern)).expect("builds");
    assert_eq!(tree.features().len(), 8 * 6 * 6);
}

#[test]
fn parameters_outside_their_domain_are_refused() {
    let good = PaperConfig::default();
    let bad = [
        PaperConfig {
            sigma_rad: -1.0,
            ..good
        },
        PaperConfig {
            sigma_rad: f64::NAN,
            ..good
        },
        PaperConfig {
            kappa: f64::INFINITY,
            ..good
        },
        PaperConfig {
            beta: 250.0,
            ..good
        },
        PaperConfig { beta: -0.1, ..good },
        PaperConfig { alpha: 0.0, ..good },
        PaperConfig {
            visibility_limit: 1.0,
            ..good
        },
        PaperConfig {
            visibility_limit: f64::NAN,
            ..good
        },
    ];
    for params in bad {
        let ball = Ball::new(crate::common::random_pattern(8, 1));
        let error = ball.with_recognizer(params).expect_err("refused");
        assert!(error.to_string().starts_with("recognizer."), "{error}");
    }
}

#[test]
fn a_pattern_reads_back_bit_for_bit_however_often_it_is_checked() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..500 {
        let dots: Vec<Vec3> = (0..4)
            .map(|_| random_direction(&mut rng) * 1.0004)
            .collect();
        let Ok(once) = spindoe::pattern::Pattern::new(dots) else {
            continue;
        };
        let twice = spindoe::pattern::Pattern::new(once.dots().to_vec()).expect("still valid");
        assert_eq!(once.sha256(), twice.sha256());
    }
}
