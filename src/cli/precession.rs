//! The precession of `spindoe spin` and `spindoe estimate`, in words and as JSON.

use serde_json::{Value, json};

use crate::spin::alias::AliasConfig;
use crate::spin::motion::ConstantSpin;
use crate::spin::precession::{PrecessionFit, PrecessionOutcome, fit_precession};
use crate::spin::robust::SpinConfig;
use crate::spin::summary::SpinSummary;
use crate::spin::{Interval, Measurement, SpinRejection};
use crate::stats::median;

/// A sequence's spin with what it says of a precession.
pub(super) struct Precession {
    outcome: PrecessionOutcome,
    /// Median angle of the orientations from a constant spin and from the precessing one, radians.
    constant_rad: f64,
    precessing_rad: Option<f64>,
}

impl Precession {
    /// The fit to `measurements`, which come from `frames` frames, and its summary: of the mean spin
    /// where the ball precesses.
    pub fn fit(
        measurements: &[Measurement],
        config: &SpinConfig,
        listed: &AliasConfig,
        frames: usize,
    ) -> Result<(SpinSummary, Self), SpinRejection> {
        let outcome = fit_precession(measurements, config)?;
        let median_off = |motion: &dyn Fn(&Measurement) -> f64| {
            median(&mut measurements.iter().map(motion).collect::<Vec<_>>())
        };
        let off_constant =
            |motion: &ConstantSpin| median_off(&|m| motion.at(m.time_s).angle_to(&m.orientation));
        let (summary, constant_rad, precessing_rad) = match &outcome {
            PrecessionOutcome::Found { fit, constant } => (
                fit.summary(measurements, listed, frames),
                off_constant(&constant.map_or(fit.motion.mean(), |c| c.motion)),
                Some(median_off(&|m| {
                    fit.motion.at(m.time_s).angle_to(&m.orientation)
                })),
            ),
            PrecessionOutcome::Constant { fit, .. } => (
                SpinSummary::new(measurements, fit, listed, frames),
                off_constant(&fit.motion),
                None,
            ),
        };
        let found = Self {
            outcome,
            constant_rad,
            precessing_rad,
        };
        Ok((summary, found))
    }

    pub fn to_json(&self) -> Value {
        let degrees = |i: Interval| [i.low.to_degrees(), i.high.to_degrees()];
        let mut json = json!({
            "median_residual_constant_deg": self.constant_rad.to_degrees(),
            "median_residual_deg": self.precessing_rad.map(f64::to_degrees),
        });
        match &self.outcome {
            PrecessionOutcome::Found { fit, .. } => {
                let rate = fit.motion.body_rate;
                json["outcome"] = "precessing".into();
                json["ln_bayes_factor"] = fit.ln_bayes_factor.into();
                json["body_rate_rad_s"] = json!([rate.x, rate.y, rate.z]);
                json["rate_deg_s"] = rate.norm().to_degrees().into();
                json["rate_interval_deg_s"] = json!(fit.rate_interval_rad_s().map(degrees));
                json["drift_deg_s"] = fit.motion.drift_rad_s().to_degrees().into();
                json["drift_interval_deg_s"] = json!(degrees(fit.drift_interval_rad_s()));
                json["decay_per_s"] = fit.motion.decay_per_s.into();
                let decay = fit.decay_interval_per_s();
                json["decay_interval_per_s"] = json!([decay.low, decay.high]);
                json["tilt_deg"] = fit.motion.tilt_rad().to_degrees().into();
            }
            PrecessionOutcome::Constant { rival, .. } => {
                let limit = rival.as_ref().map(PrecessionFit::max_drift_rad_s);
                json["outcome"] = if limit.is_some() { "none" } else { "open" }.into();
                json["ln_bayes_factor"] = json!(rival.map(|r| r.ln_bayes_factor));
                json["max_drift_deg_s"] = json!(limit.map(f64::to_degrees));
            }
        }
        json
    }

    pub fn lines(&self) -> Vec<String> {
        match &self.outcome {
            PrecessionOutcome::Found { fit, .. } => self.found(fit),
            PrecessionOutcome::Constant { rival, .. } => vec![match rival {
                Some(rival) => format!(
                    "  precession no evidence for one: the spin's axis drifts by less than {:.0} deg/s \
                     through the ball (95 %)",
                    rival.max_drift_rad_s().to_degrees()
                ),
                None => {
                    "  precession left open by these orientations (too few, too short, or too slow \
                         a spin): the spin is taken as constant"
                        .to_owned()
                }
            }],
        }
    }

    fn found(&self, fit: &PrecessionFit) -> Vec<String> {
        let axis = fit.motion.body_rate.normalize();
        let within = |i: Interval| {
            let (low, high) = (i.low.to_degrees(), i.high.to_degrees());
            format!("95 % interval [{low:.0}, {high:.0}]")
        };
        let rate = match fit.rate_interval_rad_s() {
            Some(interval) => within(interval),
            None => "the prior's: the axis has not gone far enough".to_owned(),
        };
        let mut lines = vec![
            format!(
                "  precession {:.0} deg/s ({rate}) about [{:.3}, {:.3}, {:.3}] of the ball",
                fit.motion.body_rate.norm().to_degrees(),
                axis.x,
                axis.y,
                axis.z
            ),
            format!(
                "             the spin is the mean one; its axis lies {:.1} deg off that axis and drifts \
                 by {:.0} deg/s ({}) through the ball",
                fit.motion.tilt_rad().to_degrees(),
                fit.motion.drift_rad_s().to_degrees(),
                within(fit.drift_interval_rad_s())
            ),
        ];
        let decay = fit.decay_interval_per_s();
        lines.push(format!(
            "             the spin decays by {:.3} /s (95 % interval [{:.3}, {:.3}])",
            fit.motion.decay_per_s, decay.low, decay.high
        ));
        if let Some(precessing) = self.precessing_rad {
            lines.push(format!(
                "             median residual {:.2} deg, of a constant spin {:.2} deg; odds e^{:.0}",
                precessing.to_degrees(),
                self.constant_rad.to_degrees(),
                fit.ln_bayes_factor
            ));
        }
        lines
    }
}
