//! The spin of two orientations.
//!
//! Two orientations `T` apart determine a spin without checking it: `w = log(R2 R1^-1) / T`, and every faster one about the same axis by
//! whole turns, `w + 2 pi k u / T`. With the covariances `C1`, `C2` of the orientations, rad^2, and the left Jacobian `J` of the rotation
//! vector (J. Sola, "A micro Lie theory", arXiv 1812.01537, eq. 145 and 146), the covariance of the spin is
//!
//! ```text
//! J^-1 (C2 + R C1 R^T) J^-T / T^2,   R = R2 R1^-1
//! ```
//!
//! To it comes what the two share ([`SharedError`]): the error of drawn dots, which differs between the sides that they show by the variance
//! `2 s^2 (1 - c_12)` about every axis and so adds that times `J^-1 J^-T / T^2`, and the turn of the view frame from one to the other.
//!
//! Guaranteed: all spins up to the limit that explain the orientations are listed, and none beyond it. Not guaranteed: that an
//! orientation is right; nothing checks it.

use std::f64::consts::TAU;

use nalgebra::Matrix3;

use super::alias::Alternative;
use super::motion::ConstantSpin;
use super::shared::SharedError;
use super::{Fit, MAX_TURNS, Measurement, SpinRejection, check};
use crate::geometry::Vec3;

/// The slowest spin that leads from one orientation to the other, and the faster ones up to `max_rps`, slower first. `covariances` are
/// those of the orientations, rad^2, in the same frame, without what `shared` says of both.
///
/// # Errors
/// A [`SpinRejection`] where the times do not increase or the measurements are out of their domain, where even the slowest spin is
/// beyond `max_rps`, and where more than [`MAX_TURNS`] turns are open between the two.
pub fn fit_pair(
    pair: &[Measurement; 2],
    covariances: &[Matrix3<f64>; 2],
    shared: Option<&SharedError>,
    max_rps: f64,
) -> Result<(Fit, Vec<Alternative>), SpinRejection> {
    let fit = slowest(pair, covariances, shared, max_rps)?;
    let interval_s = pair[1].time_s - pair[0].time_s;
    let turn = fit.motion.spin * interval_s;
    let axis = turn.try_normalize(1e-12).unwrap_or(Vec3::x());
    let most = (max_rps * interval_s).ceil() as i64 + 1;
    let turns = (-most..=most).filter(|k| *k != 0);
    let mut others: Vec<Alternative> = turns
        .map(|k| Alternative {
            spin: fit.motion.spin + axis * (TAU * k as f64 / interval_s),
            log_likelihood_ratio: 0.0,
        })
        .filter(|a| a.spin.norm() <= TAU * max_rps)
        .collect();
    others.sort_by(|a, b| a.spin.norm().total_cmp(&b.spin.norm()));
    Ok((fit, others))
}

/// The slowest of them alone; no memory is allocated.
///
/// # Errors
/// Those of [`fit_pair`].
pub fn slowest(
    pair: &[Measurement; 2],
    covariances: &[Matrix3<f64>; 2],
    shared: Option<&SharedError>,
    max_rps: f64,
) -> Result<Fit, SpinRejection> {
    check(pair, 2)?;
    let [first, second] = pair;
    let interval_s = second.time_s - first.time_s;
    let turns = 2.0 * interval_s * max_rps;
    if turns.is_nan() || turns > MAX_TURNS as f64 {
        return Err(SpinRejection::Sparse {
            interval_s,
            turns,
            max_rps,
        });
    }
    let relative = second.orientation * first.orientation.inverse();
    let turn = relative.scaled_axis();
    let spin = turn / interval_s;
    if spin.norm() > TAU * max_rps {
        return Err(SpinRejection::NoConsensus {
            agreeing: 1,
            frames: 2,
            max_rps,
        });
    }
    let matrix = *relative.to_rotation_matrix().matrix();
    let own = covariances[1] + matrix * covariances[0] * matrix.transpose();
    let drawn = shared.map_or(0.0, |shared| {
        shared.variance_between(&first.orientation, &second.orientation)
    });
    let both = own + Matrix3::from_diagonal_element(drawn);
    let back = inverse_left_jacobian(&turn);
    let of_poses = back * both * back.transpose() / (interval_s * interval_s);
    let of_view = shared.map_or(Matrix3::zeros(), |shared| shared.of_spin(&spin));
    Ok(Fit {
        motion: ConstantSpin {
            time_s: first.time_s,
            orientation: first.orientation,
            spin,
        },
        spin_covariance: Some(of_poses + of_view),
        sigma_rad: Some((both.trace() / 6.0).sqrt()),
        log_likelihood: None,
        inliers: 2,
        lack_of_fit: None,
    })
}

/// The inverse of the left Jacobian of a rotation vector of at most half a turn.
fn inverse_left_jacobian(turn: &Vec3) -> Matrix3<f64> {
    let angle = turn.norm();
    let cross = turn.cross_matrix();
    // To fourth order 1 / 12 (1 + a^2 / 60).
    let factor = match angle < 1e-3 {
        true => 1.0 / 12.0,
        false => (1.0 - 0.5 * angle / (0.5 * angle).tan()) / (angle * angle),
    };
    Matrix3::identity() - cross * 0.5 + cross * cross * factor
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;

    use crate::geometry::{Rotation, random_rotation};
    use crate::spin::simulate::SharedField;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    fn noisy(rng: &mut rand_chacha::ChaCha8Rng, sigma: f64, spin: &Vec3) -> [Measurement; 2] {
        let start = random_rotation(rng);
        [0.0, 0.9e-3].map(|time_s| {
            let error = Vec3::from_fn(|_, _| sigma * rng.sample::<f64, _>(StandardNormal));
            let right = Rotation::from_scaled_axis(spin * time_s) * start;
            Measurement::new(time_s, Rotation::from_scaled_axis(error) * right)
        })
    }

    #[test]
    fn the_covariance_is_that_of_many_pairs() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let spin = Vec3::new(300.0, -200.0, 1100.0);
        let sigma = 0.005;
        let covariances = [Matrix3::identity() * (sigma * sigma); 2];
        let (mut squares, mut stated) = (Matrix3::zeros(), Matrix3::zeros());
        let count = 4_000;
        for _ in 0..count {
            let pair = noisy(&mut rng, sigma, &spin);
            let (fit, _) = fit_pair(&pair, &covariances, None, 200.0).expect("a spin");
            let off = fit.motion.spin - spin;
            squares += off * off.transpose() / f64::from(count);
            stated += fit.spin_covariance.expect("a covariance") / f64::from(count);
        }
        for k in 0..3 {
            let ratio = squares[(k, k)] / stated[(k, k)];
            assert!((ratio - 1.0).abs() < 0.1, "axis {k}: {ratio}");
        }
    }

    /// Covariances that are unlike about the axes, of the earlier and of the later orientation, against differences of the spin.
    #[test]
    fn the_covariance_of_either_orientation_counts_about_its_own_axes() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(61);
        let pair = noisy(&mut rng, 0.0, &Vec3::new(900.0, -700.0, 1100.0));
        let variances = [Vec3::new(1e-6, 9e-6, 4e-6), Vec3::new(25e-6, 1e-6, 2e-6)];
        let covariances = variances.map(|v| Matrix3::from_diagonal(&v));
        let (fit, _) = fit_pair(&pair, &covariances, None, 300.0).expect("a spin");
        let mut expected = Matrix3::zeros();
        for (k, variance) in variances.iter().enumerate() {
            for axis in 0..3 {
                let spin = |angle: f64| {
                    let mut turned = pair;
                    let error = Vec3::from_fn(|i, _| if i == axis { angle } else { 0.0 });
                    turned[k].orientation = Rotation::from_scaled_axis(error) * pair[k].orientation;
                    let found = slowest(&turned, &covariances, None, 300.0);
                    found.expect("a spin").motion.spin
                };
                let slope = (spin(1e-5) - spin(-1e-5)) / 2e-5;
                expected += slope * slope.transpose() * variance[axis];
            }
        }
        let found = fit.spin_covariance.expect("a covariance");
        let off = (found - expected).amax() / expected.amax();
        assert!(off < 1e-6, "{found} {expected}");
    }

    /// Poses that are wrong by a drawn field of errors over the ball's sides, and by a view frame whose turn is wrong.
    #[test]
    fn the_covariance_has_what_two_poses_share() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
        let sigma = 0.004;
        let covariances = [Matrix3::identity() * (sigma * sigma); 2];
        let view = Vec3::new(6.0, -4.0, 0.0);
        // In the middle of the two the frame has turned by half of what it turns in all.
        let half = view * 0.45e-3;
        let line = Vector6::from_iterator(half.iter().chain(view.iter()).copied());
        let shared = SharedError {
            turning: line * line.transpose(),
            ..SharedError::of_residuals([0.03].into_iter()).expect("a residual")
        };
        // From almost one side to sides that share little.
        for rps in [20.0, 100.0, 250.0] {
            let spin = Vec3::new(0.6, 0.64, -0.48) * (TAU * rps);
            let (mut with, mut without) = (0.0, 0.0);
            let count = 2_000;
            for _ in 0..count {
                let field = SharedField::random(&shared, &mut rng);
                let mut pair = noisy(&mut rng, sigma, &spin);
                let off = view * rng.sample::<f64, _>(StandardNormal);
                for m in &mut pair {
                    let side = m.orientation.inverse() * Vec3::z();
                    let drawn = Rotation::from_scaled_axis(field.at(&side));
                    let turn = Rotation::from_scaled_axis(off * m.time_s);
                    m.orientation = turn * m.orientation * drawn;
                }
                let chi2 = |shared: Option<&SharedError>| {
                    let fit = slowest(&pair, &covariances, shared, 600.0).expect("a spin");
                    let off = fit.motion.spin - spin;
                    let covariance = fit.spin_covariance.expect("a covariance");
                    off.dot(&covariance.cholesky().expect("positive").solve(&off))
                };
                with += chi2(Some(&shared)) / (3.0 * f64::from(count));
                without += chi2(None) / (3.0 * f64::from(count));
            }
            assert!((with - 1.0).abs() < 0.15, "{rps} rps: {with}");
            assert!(without > 1.2, "{rps} rps: {without}");
        }
    }

    #[test]
    fn every_spin_that_leads_from_one_to_the_other_is_listed() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let spin = Vec3::new(0.0, 0.0, TAU * 900.0);
        let pair = noisy(&mut rng, 0.0, &spin);
        let (fit, others) = fit_pair(&pair, &[Matrix3::zeros(); 2], None, 2_000.0).expect("a spin");
        // 0.81 turns: the slowest is 0.19 turns the other way.
        let rps = |w: &Vec3| w.z / TAU;
        assert!((rps(&fit.motion.spin) + 0.19 / 0.9e-3).abs() < 1e-6);
        let listed: Vec<f64> = others.iter().map(|a| rps(&a.spin)).collect();
        let expected = [0.81, -1.19, 1.81 - 1e9].map(|turns: f64| turns / 0.9e-3);
        assert_eq!(listed.len(), 2);
        for (a, b) in listed.iter().zip(expected) {
            assert!((a - b).abs() < 1e-6, "{listed:?}");
        }
    }

    #[test]
    fn no_spin_beyond_the_limit_is_an_answer() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(6);
        // 0.36 turns in 0.9 ms: 400 rps.
        let pair = noisy(&mut rng, 0.0, &Vec3::new(0.0, TAU * 400.0, 0.0));
        let fit =
            |pair: &[Measurement; 2], limit| fit_pair(pair, &[Matrix3::zeros(); 2], None, limit);
        assert!(fit(&pair, 401.0).is_ok());
        let beyond = fit(&pair, 399.0);
        assert!(
            matches!(beyond, Err(SpinRejection::NoConsensus { agreeing: 1, .. })),
            "{beyond:?}"
        );
        // A second leaves 250 turns to either side open.
        let mut far = pair;
        far[1].time_s = 1.0;
        for limit in [250.0, f64::INFINITY, f64::NAN] {
            let open = fit(&far, limit);
            assert!(
                matches!(open, Err(SpinRejection::Sparse { .. })),
                "{open:?}"
            );
        }
    }
}
