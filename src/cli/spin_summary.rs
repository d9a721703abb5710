//! A sequence's spin, in words and as JSON: the same for `estimate` and `spin`.

use std::f64::consts::TAU;

use serde_json::{Value, json};

use crate::geometry::{CameraFrame, Vec3, to_wxyz};
use crate::spin::Fit;
use crate::spin::alias::Alternative;
use crate::spin::robust::standard_deviations;
use crate::spin::summary::SpinSummary;

/// Alternatives printed in words where no rule says which they are; JSON has them all.
const MAX_PRINTED: usize = 3;

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
    let clock = &summary.clock;
    json["clock"] = match clock.is_right() {
        true => Value::Null,
        false => json!({
            "repeated": clock.repeated,
            "grid_s": clock.grid_s,
            "slipped": clock.slipped,
            "rate_ratio": clock.rate_ratio,
            "scatter_s": clock.scatter_s,
            "words": clock.words(),
        }),
    };
    json
}

/// A spin alone as JSON; vectors and orientation in `frame`.
pub(super) fn fit_json(fit: &Fit, frame: CameraFrame) -> Value {
    let mut json = vector_json(&fit.motion.spin);
    if fit.is_at_rest() {
        json["axis"] = Value::Null;
    }
    let std = fit.spin_covariance.as_ref().map(standard_deviations);
    json["std_rad_s"] = json!(std.map(|s| [s.x, s.y, s.z]));
    json["std_rps"] = json!(fit.magnitude_std_rad_s().map(|s| s / TAU));
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
    let along = fit
        .magnitude_std_rad_s()
        .map_or(String::new(), |s| format!(" +- {:.3}", s / TAU));
    let [x, y, z] = [spin.x, spin.y, spin.z];
    let mut lines = vec![
        format!(
            "{:.3}{along} rps about {}",
            fit.motion.rps(),
            match fit.is_at_rest() {
                true => "no axis that is known: the ball may be at rest".to_owned(),
                false => axis_words(spin),
            }
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
    let words = summary.clock.words();
    lines.extend(words.iter().map(|words| format!("  clock     {words}")));
    if let Some(limit) = summary.unique_up_to_rps {
        lines.push(format!(
            "  unique    up to {limit:.2} rps at these times; a faster ball would show aliases every {:.2} rps",
            2.0 * limit
        ));
    }
    // Below the limit the line says all of them.
    let is_said = |limit: f64| fit.motion.rps() <= limit;
    if !summary.unique_up_to_rps.is_some_and(is_said) {
        lines.extend(alternative_lines(fit, &summary.alternatives));
    }
    lines
}

/// The first alternatives, and how many more there are.
fn alternative_lines(fit: &Fit, alternatives: &[Alternative]) -> impl Iterator<Item = String> {
    let line = |a: &Alternative| {
        format!(
            "  also possible: {:.3} rps about {}, odds {} against it",
            a.spin.norm() / TAU,
            axis_words(&a.spin),
            odds(fit, a),
        )
    };
    let more = alternatives.len().saturating_sub(MAX_PRINTED);
    let rest = (more > 0).then(|| format!("  and {more} more"));
    alternatives.iter().take(MAX_PRINTED).map(line).chain(rest)
}

/// The odds against an alternative, where all decades of a spin are equally likely beforehand.
fn odds(fit: &Fit, alternative: &Alternative) -> String {
    let slower = alternative.spin.norm() / fit.motion.spin.norm();
    match slower * (-alternative.log_likelihood_ratio).exp() {
        odds if odds >= 1.0 => format!("{odds:.0} to 1"),
        odds => format!("1 to {:.0}", odds.recip()),
    }
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
