//! Back-projection: against closed forms, there and back, finite differences, and Monte Carlo.

use nalgebra::{Matrix2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use spindoe::geometry::{Vec3, random_direction_above, tangent_frame};
use spindoe::recognize::DotUncertainty;
use spindoe::synth::view::View;
use spindoe::vision::{BallCircle, BallView, Camera, CameraCalibration, Intrinsics, Lens, Pixel};

const CIRCLE: BallCircle = BallCircle::new(Pixel { u: 31.0, v: 29.5 }, 28.0);
const PINHOLE: Camera = Camera::Perspective(Intrinsics::pinhole(320.0, 320.0, -80.0, 150.0));

const NEAR: Camera = Camera::Near {
    inverse_distance: 0.11,
};

fn views() -> [BallView; 2] {
    [Camera::Orthographic, PINHOLE].map(|c| BallView::new(&c, CIRCLE).expect("valid"))
}

/// All projections, with ellipses for outlines where they are looked at.
fn all_views() -> impl Iterator<Item = BallView> {
    let ellipse = BallCircle {
        eccentricity: Vector2::new(-0.35, 0.22),
        ..CIRCLE
    };
    let eccentric = [Camera::Orthographic, NEAR].map(|c| (c, ellipse));
    let round = [Camera::Orthographic, NEAR, PINHOLE].map(|c| (c, CIRCLE));
    let all = round.into_iter().chain(eccentric);
    all.map(|(camera, circle)| BallView::new(&camera, circle).expect("valid"))
}

/// An ellipse seen without intrinsics is a sphere off a pinhole's axis: `synth` shares no code with the estimator's camera.
#[test]
fn an_ellipse_is_the_outline_of_a_ball_off_the_axis() {
    let mut rng = ChaCha8Rng::seed_from_u64(29_600_001);
    for _ in 0..200 {
        let mut draw = |from: f64, to: f64| rng.random_range(from..to);
        let focal = draw(150.0, 900.0);
        let off = focal * Vector2::new(draw(-0.6, 0.6), draw(-0.6, 0.6));
        let k = Intrinsics::pinhole(focal, focal, 320.0, 240.0);
        let center = Pixel {
            u: k.cx + off.x,
            v: k.cy + off.y,
        };
        let camera = Camera::Perspective(k);
        let radius = draw(0.02, 0.2) * focal;
        let truth = View::new(&camera, BallCircle::new(center, radius)).expect("valid");
        let ellipse = truth.outline();
        let [a, b] = ellipse.half_axes_px;
        let seen = BallCircle {
            center: ellipse.center,
            radius: b,
            eccentricity: off.normalize() * (1.0 - (b / a).powi(2)).sqrt(),
        };
        for k in 0..12 {
            let at = seen.rim(0.5 * f64::from(k));
            let off = Vector2::new(at.u - ellipse.center.u, at.v - ellipse.center.v);
            let (s, c) = ellipse.angle_rad.sin_cos();
            let (x, y) = (c * off.x + s * off.y, c * off.y - s * off.x);
            assert!(
                ((x / a).powi(2) + (y / b).powi(2) - 1.0).abs() < 1e-6,
                "{k}"
            );
        }
        let near = Camera::Near {
            inverse_distance: 1.0 / truth.distance().expect("a pinhole"),
        };
        let view = BallView::new(&near, seen).expect("valid");
        let to_view = truth.to_view();
        let mut check = ChaCha8Rng::seed_from_u64(7);
        for _ in 0..20 {
            let direction = random_direction_above(&mut check, view.horizon());
            let expected = truth.project(&(to_view.inverse() * direction));
            let found = view.project(&direction);
            let apart = (found.u - expected.u).hypot(found.v - expected.v);
            assert!(apart < 1e-7 * radius, "{apart} px at {off}, {radius}");
        }
    }
}

#[test]
fn parallel_rays_follow_the_closed_form() {
    let [view, _] = views();
    let pixel = Pixel {
        u: 31.0 + 14.0,
        v: 29.5 - 7.0,
    };
    let found = view.direction(pixel).expect("on the ball");
    let expected = Vec3::new(0.5, 0.25, (1.0f64 - 0.25 - 0.0625).sqrt());
    assert!((found - expected).norm() < 1e-12);
    let outside = Pixel {
        u: 31.0 + 30.0,
        v: 29.5,
    };
    assert!(view.direction(outside).is_none());
    assert_eq!(view.horizon(), 0.0);
}

#[test]
fn a_pinhole_sees_the_ball_where_geometry_says() {
    // On the optical axis a ball of the half angle a is at the distance 1 / sin a, its outline at f tan a.
    let k = Intrinsics::pinhole(500.0, 500.0, 200.0, 100.0);
    let circle = BallCircle::new(Pixel { u: 200.0, v: 100.0 }, 50.0);
    let view = BallView::new(&Camera::Perspective(k), circle).expect("valid");
    let half_angle = (50.0f64 / 500.0).atan();
    assert!((view.horizon() - half_angle.sin()).abs() < 1e-12);
    let tilt = 0.4f64;
    let direction = Vec3::new(tilt.sin(), 0.0, tilt.cos());
    let distance = 1.0 / half_angle.sin();
    let expected = 200.0 + 500.0 * tilt.sin() / (distance - tilt.cos());
    let found = view.project(&direction);
    assert!((found.u - expected).abs() < 1e-9 && (found.v - 100.0).abs() < 1e-9);
    let middle = view.direction(circle.center).expect("on the ball");
    assert!((middle - Vec3::z()).norm() < 1e-9);
}

#[test]
fn there_and_back_is_the_same() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for view in all_views() {
        for _ in 0..200 {
            let direction = random_direction_above(&mut rng, view.horizon() + 0.02);
            let back = view.direction(view.project(&direction)).expect("in sight");
            assert!((back - direction).norm() < 1e-6, "{direction:?} {back:?}");
        }
    }
}

#[test]
fn derivatives_match_differences() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let step = 1e-6;
    for view in all_views() {
        for _ in 0..50 {
            let direction = random_direction_above(&mut rng, 0.2);
            let jacobian = view.jacobian(&direction);
            for axis in 0..3 {
                let mut shift = Vec3::zeros();
                shift[axis] = step;
                let (a, b) = (
                    view.project(&(direction + shift)),
                    view.project(&(direction - shift)),
                );
                let du = (a.u - b.u) / (2.0 * step);
                let dv = (a.v - b.v) / (2.0 * step);
                assert!((jacobian[(0, axis)] - du).abs() < 1e-4);
                assert!((jacobian[(1, axis)] - dv).abs() < 1e-4);
            }
        }
    }
}

#[test]
fn the_covariance_is_that_of_many_noisy_pixels() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let covariance = Matrix2::new(0.09, 0.03, 0.03, 0.05);
    let root = covariance.cholesky().expect("positive definite").l();
    for view in all_views() {
        for direction in [
            Vec3::new(0.1, -0.2, 0.97).normalize(),
            Vec3::new(-0.6, 0.3, 0.74).normalize(),
        ] {
            let at = view.project(&direction);
            let dot = view.back_project(at, &covariance).expect("on the ball");
            let DotUncertainty::Tangent { covariance: told } = dot.uncertainty else {
                panic!("a tangent covariance");
            };
            let [e1, e2] = tangent_frame(&dot.direction);
            let mut sum = Matrix2::zeros();
            let trials = 20_000;
            for _ in 0..trials {
                let normal = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
                let noise = root * Vector2::new(normal(&mut rng), normal(&mut rng));
                let pixel = Pixel {
                    u: at.u + noise.x,
                    v: at.v + noise.y,
                };
                let seen = view.direction(pixel).expect("on the ball");
                let off = Vector2::new(e1.dot(&seen), e2.dot(&seen));
                sum += off * off.transpose() / f64::from(trials);
            }
            let error = (sum - told).norm() / told.norm();
            assert!(error < 0.06, "{direction:?}: {error}");
        }
    }
}

/// Files that NumPy wrote (2.4, `savez` and `savez_compressed`) of what `cv2.calibrateCamera` and `cv2.fisheye.calibrate` return.
#[test]
fn archives_of_numpy_are_read() {
    let data = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/vision/data");
    let read = |name: &str| CameraCalibration::read(&data.join(name)).expect(name);
    for (name, lens, size) in [
        (
            "numpy.npz",
            Lens::polynomial(&[-0.28, 0.09, 0.0012, -0.0001, 0.0]),
            None,
        ),
        (
            "numpy_fisheye.npz",
            Lens::fisheye(&[-0.02, 0.01, -0.003, 0.001]),
            Some([640.0, 480.0]),
        ),
    ] {
        let found = read(name);
        let k = found.intrinsics;
        assert_eq!(
            [k.fx, k.fy, k.cx, k.cy],
            [650.0, 640.0, 320.5, 240.25],
            "{name}"
        );
        assert_eq!(
            (k.lens, found.size),
            (lens.expect("a lens"), size),
            "{name}"
        );
        assert!(found.notes.is_empty(), "{:?}", found.notes);
    }
}
