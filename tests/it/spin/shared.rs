//! The covariance of a spin whose orientations share an error: the side of the ball that is seen has
//! an error of its own, the same at every turn.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use spindoe::geometry::{Rotation, Vec3, random_rotation};
use spindoe::spin::Measurement;
use spindoe::spin::robust::{RobustEstimator, SpinConfig};
use spindoe::spin::shared::{SharedError, ViewTurn};
use spindoe::spin::simulate::SharedField;

const SHARED: SharedError = SharedError {
    sigma_rad: 0.01,
    correlation_rad: 0.7,
    turning: nalgebra::Matrix6::from_array_storage(nalgebra::ArrayStorage([[0.0; 6]; 6])),
};
/// Independent noise of each frame.
const NOISE: f64 = 0.004;
/// SciPy's `chi2(3).ppf` of 0.5 and 0.99.
const MEDIAN: f64 = 2.366;
const BEYOND: f64 = 11.345;

fn normal(rng: &mut ChaCha8Rng) -> Vec3 {
    Vec3::from_fn(|_, _| rng.sample(StandardNormal))
}

/// Squared Mahalanobis distances of spins from the truth.
fn distances(shared: Option<SharedError>, frames: usize) -> Vec<f64> {
    let config = SpinConfig {
        shared,
        // What the frames' own noise is.
        sigma_rad: NOISE,
        ..SpinConfig::default()
    };
    let mut estimator = RobustEstimator::new(config);
    let mut distances: Vec<f64> = (0..300)
        .map(|k| {
            let mut rng = ChaCha8Rng::seed_from_u64(900 + k);
            let field = SharedField::random(&SHARED, &mut rng);
            let spin = normal(&mut rng).normalize() * rng.random_range(40.0..400.0);
            let start = random_rotation(&mut rng);
            let measurements: Vec<Measurement> = (0..frames)
                .map(|i| {
                    let time_s = i as f64 / 400.0;
                    let truth = Rotation::from_scaled_axis(spin * time_s) * start;
                    let side = truth.inverse() * Vec3::z();
                    let drawn = Rotation::from_scaled_axis(field.at(&side));
                    let seen = Rotation::from_scaled_axis(normal(&mut rng) * NOISE);
                    Measurement::new(time_s, seen * truth * drawn)
                })
                .collect();
            let fit = estimator.fit(&measurements).expect("a spin");
            let off = fit.motion.spin - spin;
            let covariance = fit.spin_covariance.expect("a covariance");
            off.dot(&(covariance.try_inverse().expect("positive definite") * off))
        })
        .collect();
    distances.sort_by(f64::total_cmp);
    distances
}

#[test]
fn the_covariance_covers_what_frames_share() {
    for frames in [8, 30, 200] {
        let with = distances(Some(SHARED), frames);
        let beyond = with.iter().filter(|d| **d > BEYOND).count();
        let without = distances(None, frames);
        // Long sequences are sampled, and slow turns between their frames are smaller than the model's
        // smallest angle: there the tail is heavier.
        let allowed = if frames > 100 { 45 } else { 12 };
        let (with, without) = (with[150], without[150]);
        println!(
            "{frames} frames: median {with:.2} (without {without:.2}), {beyond} of 300 beyond"
        );
        assert!(
            with > 0.4 * MEDIAN && with < 1.25 * MEDIAN,
            "{frames}: {with}"
        );
        assert!(beyond <= allowed, "{frames}: {beyond}");
        // As if frames were independent, the covariance of many is far too small.
        assert!(frames < 30 || without > 2.0 * MEDIAN, "{frames}: {without}");
    }
}

/// Orientations that one standard deviation of a camera's error has turned have a spin that is off by as much as the covariance says.
#[test]
fn a_turn_that_all_share_moves_the_spin_as_its_covariance_says() {
    // A fraction of a turn: over many of them the part of the rate across the spin averages out.
    let spin = Vec3::new(6.0, -3.0, 4.5);
    let (turn, rate) = (Vec3::new(2e-2, -1e-2, 3e-2), Vec3::new(0.05, 0.1, -0.08));
    let (frames, fps) = (40, 400.0);
    let middle_s = 0.5 * f64::from(frames - 1) / fps;
    let off = |time_s: f64| turn + rate * (time_s - middle_s);
    let start = random_rotation(&mut ChaCha8Rng::seed_from_u64(5910));
    let seen = |share: f64| -> Vec<Measurement> {
        let times = (0..frames).map(|i| f64::from(i) / fps);
        let one = |time_s: f64| {
            let truth = Rotation::from_scaled_axis(spin * time_s) * start;
            Measurement::new(
                time_s,
                Rotation::from_scaled_axis(off(time_s) * share) * truth,
            )
        };
        times.map(one).collect()
    };
    let fit = |shared: Option<SharedError>, share: f64| {
        let config = SpinConfig {
            shared,
            sigma_rad: NOISE,
            ..SpinConfig::default()
        };
        let fit = RobustEstimator::new(config).fit(&seen(share));
        fit.expect("a spin")
    };
    let turns = (0..frames).map(|i| {
        let time_s = f64::from(i) / fps;
        let view = ViewTurn {
            shared_rad: [off(time_s), Vec3::zeros(), Vec3::zeros()],
            ..ViewTurn::default()
        };
        (time_s, view)
    });
    let shared = SharedError::with_turns(None, turns);
    let moved = fit(None, 1.0).motion.spin - spin;
    let expected = rate + turn.cross(&spin);
    assert!(
        (moved - expected).norm() < 0.05 * expected.norm(),
        "{moved} {expected}"
    );
    let covariance = |shared| fit(shared, 0.0).spin_covariance.expect("a covariance");
    let added = covariance(shared) - covariance(None);
    let outer = expected * expected.transpose();
    assert!(
        (added - outer).norm() < 1e-3 * outer.norm(),
        "{added} {outer}"
    );
}
