//! The ball's outline: to a fraction of a pixel on drawn balls, and refused where there is none.

use crate::common::ball::Scene;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::geometry::{Vec3, random_rotation};
use spindoe::image::GrayImage;
use spindoe::vision::{CircleConfig, NoBall, find_ball};

/// Errors of center and radius, pixels; infinite where no ball is found.
fn errors(scene: &Scene, rng: &mut ChaCha8Rng) -> [f64; 2] {
    let image = scene.render(rng);
    match find_ball(&image, &CircleConfig::default()) {
        Ok(fit) => {
            let (a, b) = (fit.circle, scene.circle);
            let off = (a.center.u - b.center.u).hypot(a.center.v - b.center.v);
            [off, (a.radius - b.radius).abs()]
        }
        Err(why) => {
            println!("{why:?}: {:?} {:?}", scene.circle, scene.light);
            [f64::INFINITY; 2]
        }
    }
}

/// Draws `trials` balls of a kind and returns the sorted errors of the center and the radius.
fn survey(trials: usize, seed: u64, kind: impl Fn(&mut Scene, &mut ChaCha8Rng)) -> [Vec<f64>; 2] {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let pattern = crate::common::random_pattern(20, 3);
    let mut found = [Vec::new(), Vec::new()];
    for _ in 0..trials {
        let mut scene = Scene::new(64, 30.0, pattern.dots(), random_rotation(&mut rng));
        scene.light = spindoe::geometry::random_direction_above(&mut rng, 0.3);
        kind(&mut scene, &mut rng);
        let errors = errors(&scene, &mut rng);
        found[0].push(errors[0]);
        found[1].push(errors[1]);
    }
    for list in &mut found {
        list.sort_by(f64::total_cmp);
    }
    found
}

fn check(name: &str, found: &[Vec<f64>; 2], median: f64, most: f64) {
    let at = |list: &[f64], p: f64| list[((list.len() - 1) as f64 * p) as usize];
    let [c, r] = found;
    println!(
        "{name}: center {:.3} (95 %: {:.3}), radius {:.3} (95 %: {:.3})",
        at(c, 0.5),
        at(c, 0.95),
        at(r, 0.5),
        at(r, 0.95)
    );
    assert!(
        at(c, 0.5) < median && at(r, 0.5) < median,
        "{name}: medians"
    );
    assert!(at(c, 0.95) < most && at(r, 0.95) < most, "{name}: the tail");
}

#[test]
fn outlines_are_found_to_a_fraction_of_a_pixel() {
    let count = crate::common::few_or_all(40, 100);
    let bright = survey(count, 1, |_, _| {});
    check("60 px, bright on dark", &bright, 0.2, 0.6);
    let tight = survey(count, 2, |scene, rng| {
        let side = 60 + (10.0 * rng.random::<f64>()) as usize;
        *scene = Scene {
            width: side,
            height: side,
            ..Scene::new(side, 0.5 * side as f64, &scene.dots, scene.rotation)
        };
    });
    check("touching all borders", &tight, 0.3, 1.0);
    let off = survey(count, 3, |scene, rng| {
        let shift = |x: f64| 9.0 * (2.0 * x - 1.0);
        scene.circle.center.u += shift(rng.random());
        scene.circle.center.v += shift(rng.random());
    });
    check("off-center by up to 15 %, cut", &off, 0.3, 1.0);
    let dark = survey(count, 4, |scene, _| {
        scene.background = 0.95;
        scene.ball = 0.5;
        scene.directed = 0.3;
    });
    check("dark on bright", &dark, 0.3, 1.0);
    let half = survey(count, 5, |scene, rng| {
        (scene.width, scene.height) = (120, 120);
        scene.circle.center.u = 40.0 + 40.0 * rng.random::<f64>();
        scene.circle.center.v = 40.0 + 40.0 * rng.random::<f64>();
    });
    check("half of the crop", &half, 0.2, 0.6);
    let large = survey(crate::common::few_or_all(12, 30), 6, |scene, _| {
        *scene = Scene::new(200, 92.0, &scene.dots, scene.rotation);
    });
    check("200 px", &large, 0.6, 1.8);
    let small = survey(count, 7, |scene, _| {
        *scene = Scene::new(40, 17.0, &scene.dots, scene.rotation);
    });
    check("34 px", &small, 0.3, 1.0);
}

#[test]
fn a_ball_is_found_in_a_full_frame() {
    let frames = survey(6, 8, |scene, rng| {
        (scene.width, scene.height) = (1280, 1024);
        scene.circle.center.u = 100.0 + 1000.0 * rng.random::<f64>();
        scene.circle.center.v = 100.0 + 800.0 * rng.random::<f64>();
        scene.background = 0.2;
    });
    check("1280 x 1024", &frames, 0.3, 1.0);
}

#[test]
fn of_two_balls_the_other_is_told_of() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut scene = Scene::new(160, 30.0, &[], random_rotation(&mut rng));
    scene.circle.center.u = 40.0;
    let left = scene.render(&mut rng);
    scene.circle.center.u = 118.0;
    scene.circle.radius = 34.0;
    let right = scene.render(&mut rng);
    let both = GrayImage::from_fn(160, 160, |u, v| {
        let i = v * 160 + u;
        left.values()[i].max(right.values()[i])
    });
    let fit = find_ball(&both, &CircleConfig::default()).expect("a ball");
    assert!((fit.circle.center.u - 118.0).abs() < 1.0, "{fit:?}");
    assert_eq!(fit.rivals, 1);
}

#[test]
fn no_ball_is_said_so() {
    let config = CircleConfig::default();
    let black = GrayImage::from_fn(64, 64, |_, _| 0.0);
    assert_eq!(find_ball(&black, &config), Err(NoBall::NoContrast));
    let tiny = GrayImage::from_fn(1, 1, |_, _| 0.5);
    let refusal = find_ball(&tiny, &config);
    assert!(matches!(refusal, Err(NoBall::TooSmall { .. })));
    // Noise, a step, stripes, and a checkerboard.
    let mut rng = ChaCha8Rng::seed_from_u64(10);
    let noise: Vec<f32> = (0..64 * 64).map(|_| rng.random()).collect();
    let images = [
        GrayImage::new(64, 64, noise).expect("an image"),
        GrayImage::from_fn(64, 64, |u, _| if u < 32 { 0.1 } else { 0.9 }),
        GrayImage::from_fn(64, 64, |u, _| (u / 8 % 2) as f32),
        GrayImage::from_fn(64, 64, |u, v| ((u / 8 + v / 8) % 2) as f32),
        GrayImage::from_fn(64, 64, |u, v| (u + v) as f32 / 128.0),
    ];
    for (k, image) in images.iter().enumerate() {
        let found = find_ball(image, &config);
        assert!(found.is_err(), "image {k}: {found:?}");
    }
}

#[test]
fn dots_on_the_rim_do_not_move_the_outline() {
    // Eight dots right on the limb.
    let rim: Vec<Vec3> = (0..8)
        .map(|k| {
            let (s, c) = (0.785 * f64::from(k)).sin_cos();
            Vec3::new(c, s, 0.05).normalize()
        })
        .collect();
    let found = survey(50, 11, |scene, _| {
        scene.dots = rim.clone();
        scene.rotation = spindoe::geometry::Rotation::identity();
    });
    check("dots on the rim", &found, 0.4, 1.0);
}
