//! A sequence's spin, in words and as JSON: the same for `estimate` and `spin`.

use std::f64::consts::TAU;

use serde_json::{Value, json};

use crate::geometry::{CameraFrame, Vec3, to_wxyz};
use crate::spin::Fit;
use crate::spin::robust::standard_deviations;
use crate::spin::summary::SpinSummary;
#[cfg(feature = "vision")]
use crate::spin::{
    SpinRejection,
    alias::AliasConfig,
    estimate::{MotionModel, SpinEstimate},
    orientations::Orientations,
    robust::SpinConfig,
};

/// Alternatives are listed up to this multiple of the largest spin searched.
pub(super) const LISTED_BEYOND: f64 = 2.0;
/// Alternatives printed in words; JSON has them all.
const MAX_PRINTED: usize = 6;

/// The constant spin of rows whose times increase, in their frame.
#[cfg(feature = "vision")]
pub(super) fn of_rows(
    file: &Orientations,
    spin: &SpinConfig,
) -> Result<SpinSummary, SpinRejection> {
    let config = file.spin_config(*spin);
    let measurements = file.measurements();
    let estimate = SpinEstimate::fit(&measurements, MotionModel::Constant, &config)?;
    let listed = AliasConfig {
        max_rps: LISTED_BEYOND * spin.max_rps,
        sigma_rad: config.sigma_rad,
        ..AliasConfig::default()
    };
    let at_s = estimate.middle_s();
    Ok(estimate.summary(&measurements, at_s, &listed, file.rows.len()))
}

/// The summary as JSON; vectors and orientation in `frame`.
pub(super) fn to_json(summary: &SpinSummary, frame: CameraFrame) -> Value {
    let mut json = fit_json(&summary.fit, frame);
    json["residual_deg"] = summary.residual_rad.to_degrees().into();
    json["frames"] = summary.frames.into();
    json["orientations"] = summary.orientations.into();
    json["unique_up_to_rps"] = json!(summary.unique_up_to_rps);
    let alternatives = summary.alternatives.iter().map(|a| {
        let mut entry = vector_json(&a.spin);
        entry["log_likelihood_ratio"] = a.log_likelihood_ratio.into();
        entry
    });
    json["alternatives"] = alternatives.collect();
    json
}

/// A spin alone as JSON; vectors and orientation in `frame`.
pub(super) fn fit_json(fit: &Fit, frame: CameraFrame) -> Value {
    let mut json = vector_json(&fit.motion.spin);
    let std = fit.spin_covariance.as_ref().map(standard_deviations);
    json["std_rad_s"] = json!(std.map(|s| [s.x, s.y, s.z]));
    json["std_rps"] = json!(std_along(fit).map(|s| s / TAU));
    json["covariance_rad2_s2"] = json!(
        fit.spin_covariance
            .map(|c| [0, 1, 2].map(|i| [0, 1, 2].map(|j| c[(i, j)])))
    );
    json["sigma_deg"] = json!(fit.sigma_rad.map(f64::to_degrees));
    json["inliers"] = fit.inliers.into();
    json["lack_of_fit"] = json!(fit.lack_of_fit);
    json["time_s"] = fit.motion.time_s.into();
    json["orientation_wxyz"] = json!(to_wxyz(&fit.motion.orientation));
    json["camera_frame"] = frame.as_str().into();
    json
}

/// The summary in lines, the first of them the spin itself.
pub(super) fn lines(summary: &SpinSummary, frame: CameraFrame) -> Vec<String> {
    let fit = &summary.fit;
    let spin = &fit.motion.spin;
    let along = std_along(fit).map_or(String::new(), |s| format!(" +- {:.3}", s / TAU));
    let [x, y, z] = [spin.x, spin.y, spin.z];
    let mut lines = vec![
        format!(
            "{:.3}{along} rps about {}",
            fit.motion.rps(),
            axis_words(spin)
        ),
        format!(
            "  spin      [{x:.3}, {y:.3}, {z:.3}] rad/s, {}",
            frame.words()
        ),
    ];
    if let Some(s) = fit.spin_covariance.as_ref().map(standard_deviations) {
        lines.push(format!(
            "  std       [{:.3}, {:.3}, {:.3}] rad/s",
            s.x, s.y, s.z
        ));
    }
    lines.push(format!(
        "  {} frames, {} with an orientation, {} of them follow it, {:.2} deg off (rms)",
        summary.frames,
        summary.orientations,
        fit.inliers,
        summary.residual_rad.to_degrees()
    ));
    if let Some(sigma) = fit.sigma_rad {
        lines.push(format!(
            "  noise     {:.2} deg per axis",
            sigma.to_degrees()
        ));
    }
    if let Some(limit) = summary.unique_up_to_rps {
        lines.push(format!(
            "  unique    up to {limit:.2} rps at these times: faster spins have a slower alias"
        ));
    }
    for a in summary.alternatives.iter().take(MAX_PRINTED) {
        let likelihood = match a.log_likelihood_ratio {
            r if r.abs() < 5e-3 => "as likely".to_owned(),
            r => format!("log-likelihood ratio {r:+.2}"),
        };
        lines.push(format!(
            "  also possible: {:.3} rps about {} ({likelihood})",
            a.spin.norm() / TAU,
            axis_words(&a.spin),
        ));
    }
    let more = summary.alternatives.len().saturating_sub(MAX_PRINTED);
    if more > 0 {
        lines.push(format!("  and {more} more"));
    }
    lines
}

/// Standard deviation of a fit's magnitude, rad/s.
pub(super) fn std_along(fit: &Fit) -> Option<f64> {
    let axis = unit(&fit.motion.spin);
    let covariance = fit.spin_covariance?;
    Some(axis.dot(&(covariance * axis)).max(0.0).sqrt())
}

/// A spin's fields; no axis where the ball does not rotate.
fn vector_json(spin: &Vec3) -> Value {
    let axis = unit(spin);
    json!({
        "spin_rad_s": [spin.x, spin.y, spin.z],
        "rps": spin.norm() / TAU,
        "axis": [axis.x, axis.y, axis.z],
    })
}

fn axis_words(spin: &Vec3) -> String {
    let axis = unit(spin);
    format!("[{:.4}, {:.4}, {:.4}]", axis.x, axis.y, axis.z)
}

/// The direction of a spin; zero where it has none.
fn unit(spin: &Vec3) -> Vec3 {
    spin.try_normalize(0.0).unwrap_or_default()
}
