//! The refinement of a spin on all dots of all frames: better than orientations alone, and honest
//! about it.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use spindoe::geometry::{Rotation, Vec3, kabsch, random_direction, random_rotation, tangent_frame};
use spindoe::pattern::Pattern;
use spindoe::spin::dots::{DotFrame, DotRefineConfig, SeenDot, refine_on_dots};
use spindoe::spin::robust::{RobustEstimator, RobustSpinConfig};
use spindoe::spin::simulate::stream;
use spindoe::spin::{Fit, Measurement, Motion, SpinRejection};

const FRAMES: usize = 10;
const FPS: f64 = 350.0;
/// Noise of a dot per tangential axis, radians.
const SIGMA: f64 = 0.035;

/// Ten frames of identified dots, at most `most` of those the camera sees; a share of them has the
/// wrong identity.
fn views(pattern: &Pattern, truth: &Motion, most: usize, wrong: f64, seed: u64) -> Vec<DotFrame> {
    let mut rng = stream(seed, 1);
    let times = (0..FRAMES).map(|k| k as f64 / FPS);
    let frames = times.map(|time_s| {
        let mut dots = Vec::new();
        for (dot, d) in pattern.dots().iter().enumerate() {
            let p = truth.at(time_s) * d;
            if p.z < 0.15 {
                continue;
            }
            let [e1, e2] = tangent_frame(&p);
            let (a, b): (f64, f64) = (
                StandardNormal.sample(&mut rng),
                StandardNormal.sample(&mut rng),
            );
            let direction = (p + (e1 * a + e2 * b) * SIGMA).normalize();
            let confused = rng.random::<f64>() < wrong;
            let dot = if confused {
                rng.random_range(0..pattern.len())
            } else {
                dot
            };
            dots.push(SeenDot { dot, direction });
        }
        dots.truncate(most);
        DotFrame { time_s, dots }
    });
    frames.collect()
}

/// The spin from one orientation a frame.
fn from_orientations(pattern: &Pattern, frames: &[DotFrame]) -> Fit {
    let measurements: Vec<Measurement> = frames
        .iter()
        .map(|f| {
            let from: Vec<Vec3> = f.dots.iter().map(|d| pattern.dots()[d.dot]).collect();
            let to: Vec<Vec3> = f.dots.iter().map(|d| d.direction).collect();
            Measurement::new(f.time_s, kabsch(&from, &to, None).unwrap())
        })
        .collect();
    RobustEstimator::new(RobustSpinConfig::default())
        .fit(&measurements)
        .unwrap()
}

fn truth(seed: u64) -> Motion {
    let mut rng = stream(seed, 0);
    let rps = 10.0 + 100.0 * rng.random::<f64>();
    Motion {
        time_s: 0.0,
        orientation: random_rotation(&mut rng),
        spin: random_direction(&mut rng) * (rps * TAU),
    }
}

/// Squared errors before and after, and the squared normalized error after.
fn errors(pattern: &Pattern, most: usize, wrong: f64, seed: u64) -> [f64; 3] {
    let truth = truth(seed);
    let frames = views(pattern, &truth, most, wrong, seed);
    let start = from_orientations(pattern, &frames);
    let fit = refine_on_dots(pattern, &frames, &start, &DotRefineConfig::default()).unwrap();
    assert_eq!(fit.inliers, FRAMES);
    let error = fit.motion.spin - truth.spin;
    let solved = fit
        .spin_covariance
        .unwrap()
        .cholesky()
        .unwrap()
        .solve(&error);
    let before = (start.motion.spin - truth.spin).norm_squared();
    [before, error.norm_squared(), solved.dot(&error) / 3.0]
}

fn means(pattern: &Pattern, most: usize, wrong: f64, seeds: std::ops::Range<u64>) -> [f64; 3] {
    let all: Vec<[f64; 3]> = seeds
        .into_par_iter()
        .map(|s| errors(pattern, most, wrong, s))
        .collect();
    [0, 1, 2].map(|i| all.iter().map(|e| e[i]).sum::<f64>() / all.len() as f64)
}

#[test]
fn dots_beat_orientations_and_their_errors_are_as_stated() {
    let pattern = crate::common::random_pattern(20, 81);
    for (most, gain) in [(20, 0.98), (4, 0.95)] {
        let [before, after, normalized] = means(&pattern, most, 0.0, 0..1000);
        assert!(after < gain * before, "{most} dots: {after} of {before}");
        assert!((normalized - 1.0).abs() < 0.1, "{most} dots: {normalized}");
    }
}

#[test]
fn wrong_identities_hurt_orientations_more() {
    let pattern = crate::common::random_pattern(20, 81);
    let [before, after, normalized] = means(&pattern, 20, 0.05, 1000..1300);
    assert!(after < 0.5 * before, "{after} of {before}");
    assert!((normalized - 1.0).abs() < 0.2, "{normalized}");
}

#[test]
fn exact_dots_give_the_exact_motion() {
    let pattern = crate::common::random_pattern(20, 82);
    let truth = truth(7);
    let frames: Vec<DotFrame> = (0..5)
        .map(|k| {
            let time_s = k as f64 / FPS;
            let dots = pattern.dots().iter().enumerate();
            let seen = dots.map(|(dot, d)| SeenDot {
                dot,
                direction: truth.at(time_s) * d,
            });
            DotFrame {
                time_s,
                dots: seen.collect(),
            }
        })
        .collect();
    let start = Fit {
        motion: Motion {
            orientation: Rotation::from_scaled_axis(Vec3::new(0.03, -0.02, 0.03))
                * truth.orientation,
            spin: truth.spin + Vec3::new(3.0, -4.0, 2.0),
            ..truth
        },
        spin_covariance: None,
        sigma_rad: None,
        log_likelihood: None,
        inliers: 0,
    };
    let fit = refine_on_dots(&pattern, &frames, &start, &DotRefineConfig::default()).unwrap();
    assert!((fit.motion.spin - truth.spin).norm() < 1e-6, "{fit:?}");
    assert!(fit.motion.orientation.angle_to(&truth.orientation) < 1e-8);
}

#[test]
fn what_cannot_be_used_is_refused() {
    let pattern = crate::common::random_pattern(20, 83);
    let truth = truth(8);
    let good = views(&pattern, &truth, 20, 0.0, 8);
    let start = from_orientations(&pattern, &good);
    let refine =
        |frames: &[DotFrame]| refine_on_dots(&pattern, frames, &start, &DotRefineConfig::default());
    let few = refine(&good[..2]).unwrap_err();
    assert_eq!(
        few,
        SpinRejection::TooFewFrames {
            found: 2,
            needed: 3
        }
    );
    let mut bad = good.clone();
    bad[1].dots[0].dot = 20;
    assert!(matches!(
        refine(&bad),
        Err(SpinRejection::Measurement { index: 1, .. })
    ));
    let mut bad = good.clone();
    bad[2].dots[0].direction *= 2.0;
    assert!(matches!(
        refine(&bad),
        Err(SpinRejection::Measurement { index: 2, .. })
    ));
    let mut bad = good;
    bad[3].time_s = f64::INFINITY;
    assert!(matches!(
        refine(&bad),
        Err(SpinRejection::Times { index: 3, .. })
    ));
}
