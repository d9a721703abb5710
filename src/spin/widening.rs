//! How much less a motion is known than independent noise says: errors that frames share, and a lack of fit.
//!
//! # Lack of fit
//! A sequence is cut into `B` parts of equally many orientations. Each part alone would turn the motion's orientation and
//! change its spin, six parameters, and that takes `L_b` from the sum of its weighted squared errors. Were the motion
//! right, `L = sum L_b` would have the mean `6 B - p` for a motion with `p` parameters, as what is left has `3 n - 6 B`; the
//! test of a lack of fit compares both (N. R. Draper, H. Smith, "Applied Regression Analysis", 3rd ed. 1998, Sec. 2.1; the
//! normal deviate of the ratio by E. Paulson, Ann. Math. Stat. 13, 1942). Where the parts differ by more than noise would let
//! them once in a hundred sequences, the covariance is that of a quasi-likelihood with the dispersion `W = L / (6 B - p)` (P.
//! McCullagh, J. A. Nelder, "Generalized Linear Models", 2nd ed. 1989, Sec. 9.2): all of it is multiplied by `W`. Of 2, 4, 8
//! and 16 parts those with the largest dispersion count: what drifts slowly shows in few parts.
//!
//! # Shared errors
//! What [`super::shared`] adds covers the same errors, if it is known: the larger of the two counts.
//!
//! Not guaranteed: that a motion without a lack of fit is right.

use nalgebra::{Matrix3, SMatrix};

use super::Measurement;
use super::mixture::{Blocks, Mixture, SettledMotion, WeightedNormal, inlier_probability};
use super::motion::Motion;
use super::robust::SpinConfig;
use super::shared::{FrameTerm, shared_covariance};

/// Most parts; fewer ones are made by joining neighbors.
const PARTS: usize = 16;
/// Orientations of a part: four times its six parameters in errors.
const MIN_ORIENTATIONS: usize = 8;
/// Parameters of a part.
const PARAMETERS: f64 = 6.0;
/// Deviate that noise exceeds once in four hundred times: there are up to four numbers of parts.
const EVIDENT: f64 = 2.807;

/// How much more the parts of a sequence differ from a motion than their noise explains, a ratio of variances; `None`
/// where that is not evident, or the orientations are too few to say.
pub(super) fn lack_of_fit<M: Motion<P>, const P: usize>(
    measurements: &[Measurement],
    motion: &M,
    sigma_rad: f64,
) -> Option<f64> {
    let most = (measurements.len() / MIN_ORIENTATIONS).min(PARTS);
    // The largest power of two.
    let mut count = 1 << most.checked_ilog2().filter(|log| *log > 0)?;
    let mut parts = [WeightedNormal::<3>::new(); PARTS];
    let (mut support, mut squares) = (0.0, 0.0);
    let jacobian = motion.jacobian();
    for (k, m) in measurements.iter().enumerate() {
        let (error, jacobian) = jacobian(m);
        let variance = (sigma_rad * m.sigma_scale).powi(2);
        let square = error.norm_squared();
        let inlier = inlier_probability(m.confidence, square, variance);
        let spin: Matrix3<f64> = jacobian.fixed_columns::<3>(0).into_owned();
        parts[k * count / measurements.len()].add(inlier / variance, &error, &spin);
        support += inlier;
        squares += inlier * square / variance;
    }
    let mut largest: Option<f64> = None;
    while count > 1 {
        let (mut explained, mut solved) = (0.0, 0.0);
        for part in &parts[..count] {
            // A part of outliers says nothing.
            if let Some(length) = part.reduction() {
                explained += length;
                solved += PARAMETERS;
            }
        }
        let apart = solved - (3 + P) as f64;
        let within = 3.0 * support - solved;
        if apart >= 1.0 && within >= 1.0 {
            let dispersion = explained / apart;
            let ratio = dispersion / ((squares - explained) / within).max(f64::MIN_POSITIVE);
            if deviate(ratio, apart, within) > EVIDENT && dispersion > 1.0 {
                largest = Some(largest.unwrap_or(1.0).max(dispersion));
            }
        }
        count /= 2;
        for k in 0..count {
            parts[k] = parts[2 * k].joined(&parts[2 * k + 1]);
        }
    }
    largest
}

/// The normal deviate of a ratio of variances with so many degrees of freedom (Paulson 1942).
fn deviate(ratio: f64, above: f64, below: f64) -> f64 {
    let [a, b] = [above, below].map(|degrees| 2.0 / (9.0 * degrees));
    let root = ratio.cbrt();
    ((1.0 - b) * root - (1.0 - a)) / (b * root * root + a).sqrt()
}

/// The covariance of a maximum's parameters, widened, and the lack of fit.
///
/// `probabilities` are those of the frames to be inliers, `parts` is working memory. `None` where the shared errors leave
/// the rates undetermined.
pub(super) fn widened<M: Motion<P>, const P: usize>(
    covariance: &Blocks<P>,
    mixture: &Mixture<'_, P>,
    at: &SettledMotion<M>,
    probabilities: &[f64],
    config: &SpinConfig,
    parts: &mut Vec<FrameTerm<P>>,
) -> Option<(Blocks<P>, Option<f64>)> {
    let measurements = mixture.measurements;
    let lack_of_fit = lack_of_fit(measurements, &at.motion, at.sigma_rad);
    let mut widened = covariance.scaled(lack_of_fit.unwrap_or(1.0));
    // A clock that is off by a share makes the spin longer or shorter by as much; the axis is the frame's last.
    let off = config.clock_rate_std * at.motion.local_frame().rate;
    let clock = off * off;
    let Some(shared) = &config.shared else {
        widened.rates[(2, 2)] += clock;
        return Some((widened, lack_of_fit));
    };
    let added = shared_covariance(
        measurements,
        &at.motion,
        at.sigma_rad,
        probabilities,
        (shared, &mixture.prior.weight),
        parts,
    )?;
    let with_shared = covariance.rates + added;
    let of_spin = |rates: &SMatrix<f64, P, P>| rates.diagonal().fixed_rows::<3>(0).sum();
    if of_spin(&with_shared) > of_spin(&widened.rates) {
        widened = Blocks {
            rates: with_shared,
            ..*covariance
        };
    }
    let by_frame = at.motion.by_frame();
    widened.rates += by_frame * shared.turning * by_frame.transpose();
    widened.rates[(2, 2)] += clock;
    Some((widened, lack_of_fit))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviates_are_those_of_the_f_distribution() {
        // SciPy's f(a, b).ppf(norm.cdf(2.807)).
        for (above, below, ratio) in [
            (3.0, 60.0, 5.3424),
            (6.0, 200.0, 3.5151),
            (84.0, 369.0, 1.5734),
        ] {
            let z = deviate(ratio, above, below);
            assert!((z - 2.807).abs() < 0.02, "{above} {below}: {z}");
        }
    }
}
