//! The motion of a spin in `spindoe spin` and `spindoe estimate`, in words and as JSON.

use std::f64::consts::TAU;

use serde_json::{Value, json};

use crate::geometry::Rotation;
use crate::spin::alias::AliasConfig;
use crate::spin::decay::DecayFit;
use crate::spin::estimate::{FittedMotion, MotionModel, Rival, SpinEstimate};
use crate::spin::free::{FreeFit, Knot};
use crate::spin::precession::PrecessionFit;
use crate::spin::robust::standard_deviations;
use crate::spin::summary::SpinSummary;
use crate::spin::windows::WindowFit;
use crate::spin::{Interval, Measurement};
use crate::stats::median;

/// From these odds on their logarithm is printed.
const MAX_LN_ODDS: f64 = 13.8;

/// What is expected of a decay, 1/s.
pub(super) struct Theory {
    pub creeping: f64,
    pub boundary_layer: f64,
}

/// How a ball moves, as far as its orientations say.
pub(super) struct ObservedMotion {
    pub estimate: SpinEstimate,
    asked_for: MotionModel,
    /// The time of the spin that is reported, seconds.
    time_s: f64,
    /// Whether it is the mean over the time.
    is_mean: bool,
    /// Median angle of the orientations from a constant spin and from the motion, radians.
    constant_rad: f64,
    motion_rad: f64,
    theory: Option<Theory>,
}

impl ObservedMotion {
    /// What `estimate` says of `measurements`, which come from `frames` frames, and the summary of the spin: at `time_s`, by
    /// default in the middle.
    pub fn new(
        estimate: SpinEstimate,
        asked_for: MotionModel,
        measurements: &[Measurement],
        time_s: Option<f64>,
        listed: &AliasConfig,
        frames: usize,
    ) -> (SpinSummary, Self) {
        let median_off = |motion: &FittedMotion| {
            let off = |m: &Measurement| motion.predict(m.time_s).angle_to(&m.orientation);
            let followed = estimate.followed(measurements);
            median(&mut followed.iter().map(off).collect::<Vec<_>>())
        };
        // Without a constant spin that holds, the mean one.
        let constant = estimate.constant.unwrap_or_else(|| estimate.overall());
        let summary = estimate.summary(measurements, time_s, listed, frames);
        let is_mean = time_s.is_none() && estimate.motion.model() == MotionModel::Free;
        let found = Self {
            asked_for,
            time_s: summary.fit.motion.time_s,
            is_mean,
            constant_rad: median_off(&FittedMotion::Constant(constant)),
            motion_rad: median_off(&estimate.motion),
            theory: None,
            estimate,
        };
        (summary, found)
    }

    /// With the spins of a free motion in another camera frame, which `turn` leads to.
    pub fn turned(mut self, turn: &Rotation) -> Self {
        if let FittedMotion::Free(fit) = self.estimate.motion {
            self.estimate.motion = FittedMotion::Free(fit.turned(turn));
        }
        self
    }

    /// The spin over time of a free motion, as runs are.
    pub fn over_time(&self) -> Option<Vec<WindowFit>> {
        let FittedMotion::Free(fit) = &self.estimate.motion else {
            return None;
        };
        let at = |knot: &Knot| WindowFit {
            time_s: knot.time_s,
            fit: fit.at(knot.time_s),
        };
        Some(fit.knots.iter().map(at).collect())
    }

    /// With what theory expects of a decay.
    pub fn with_theory(self, theory: Theory) -> Self {
        Self {
            theory: Some(theory),
            ..self
        }
    }

    /// Adds the motion to the JSON of a spin.
    pub fn add_to(&self, json: &mut Value) {
        json["motion"] = self.estimate.motion.model().as_str().into();
        if let Some(decay) = self.decay_json() {
            json["decay"] = decay;
        }
        if let Some(precession) = self.precession_json() {
            json["precession"] = precession;
        }
        if let FittedMotion::Free(fit) = &self.estimate.motion {
            json["is_mean"] = self.is_mean.into();
            json["free"] = free_json(fit);
        }
    }

    fn decay_json(&self) -> Option<Value> {
        let fit = match &self.estimate.decaying {
            Rival::NotFitted => return None,
            rival => rival.fit(),
        };
        let is_taken = matches!(self.estimate.motion, FittedMotion::Decaying(_));
        let taken = fit.filter(|_| is_taken);
        let interval = fit.map(DecayFit::interval_per_s);
        Some(json!({
            "c_per_s": taken.map(|d| d.motion.decay_per_s),
            "std_per_s": taken.map(DecayFit::std_per_s),
            "low_per_s": interval.map(|i| i.low),
            "high_per_s": interval.map(|i| i.high),
            "ln_bayes_factor": fit.map(|d| d.ln_bayes_factor),
            "creeping_flow_per_s": self.theory.as_ref().map(|t| t.creeping),
            "boundary_layer_per_s": self.theory.as_ref().map(|t| t.boundary_layer),
        }))
    }

    fn precession_json(&self) -> Option<Value> {
        let fit = match &self.estimate.precessing {
            Rival::NotFitted => return None,
            rival => rival.fit(),
        };
        let degrees = |i: Interval| [i.low.to_degrees(), i.high.to_degrees()];
        let mut json = json!({
            "median_residual_constant_deg": self.constant_rad.to_degrees(),
            "median_residual_deg": null,
            "ln_bayes_factor": fit.map(|f| f.ln_bayes_factor),
        });
        match (&self.estimate.motion, fit) {
            (FittedMotion::Precessing(fit), _) => {
                let rate = fit.motion.body_rate;
                json["outcome"] = "precessing".into();
                json["median_residual_deg"] = self.motion_rad.to_degrees().into();
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
            (_, fit) => {
                let limit = fit.map(PrecessionFit::max_drift_rad_s);
                json["outcome"] = if limit.is_some() { "none" } else { "open" }.into();
                json["max_drift_deg_s"] = json!(limit.map(f64::to_degrees));
            }
        }
        Some(json)
    }

    /// In lines, below those of the spin.
    pub fn lines(&self) -> Vec<String> {
        let estimate = &self.estimate;
        let when = match (self.is_mean, self.time_s == estimate.middle_s()) {
            (true, _) => "the mean over the time".to_owned(),
            (_, true) => format!("that at {:.4} s, the middle", self.time_s),
            _ => format!("that at {:.4} s", self.time_s),
        };
        let mut lines = vec![format!(
            "  motion    {}{}; the spin is {when}",
            estimate.motion.model(),
            self.reason(),
        )];
        if let FittedMotion::Free(fit) = &estimate.motion {
            lines.push(free_words(fit));
        } else if self.asked_for == MotionModel::Free {
            lines.push("  a free motion is left open by these orientations (too few, or none that is smooth)".to_owned());
        }
        if let FittedMotion::Precessing(fit) = &estimate.motion {
            lines.extend(self.precession(fit));
        } else if self.asked_for == MotionModel::Precessing {
            lines.push(
                "  precession left open by these orientations (too few, too short, or too slow a spin): the spin is taken as constant"
                    .to_owned(),
            );
        }
        let is_decay = matches!(estimate.motion, FittedMotion::Decaying(_));
        if is_decay || self.asked_for == MotionModel::Decaying {
            lines.push(match &estimate.motion {
                FittedMotion::Decaying(fit) => {
                    let Interval { low, high } = fit.interval_per_s();
                    let c = fit.motion.decay_per_s;
                    format!("  decay     c = {c:.4} /s, 95 % interval [{low:.4}, {high:.4}]")
                }
                _ => "  decay     left open by these orientations: the spin is taken as constant"
                    .to_owned(),
            });
            lines.extend(self.theory.as_ref().map(|theory| {
                format!(
                    "  theory    12 pi mu r / m = {:.5} /s (creeping flow); {:.4} /s with a boundary layer",
                    theory.creeping, theory.boundary_layer
                )
            }));
        }
        if let Some(ratio) = estimate.at(self.time_s).lack_of_fit {
            lines.push(format!(
                "  lack of fit: parts of the sequence differ {:.1} times as much as their noise explains; the deviations count it",
                ratio.sqrt()
            ));
        }
        lines
    }

    /// Why this motion was taken.
    fn reason(&self) -> String {
        let (odds, against) = match &self.estimate.motion {
            FittedMotion::Constant(_) if self.asked_for == MotionModel::Auto => {
                return ", there is no evidence for another".to_owned();
            }
            FittedMotion::Constant(_) => return String::new(),
            FittedMotion::Decaying(fit) => (fit.ln_bayes_factor, "a constant spin"),
            FittedMotion::Precessing(fit) => (fit.ln_bayes_factor, "a ball that does not"),
            FittedMotion::Free(fit) => (fit.ln_bayes_factor, "a ball that nothing pushes"),
        };
        let odds = match odds {
            ln if ln.abs() > MAX_LN_ODDS => format!("e^{ln:.0}"),
            ln if ln < 0.0 => format!("1 to {:.0}", (-ln).exp()),
            ln => format!("{:.0} to 1", ln.exp()),
        };
        format!(" (odds {odds} against {against})")
    }

    fn precession(&self, fit: &PrecessionFit) -> Vec<String> {
        let axis = fit.motion.body_rate.normalize();
        let within = |i: Interval| {
            let (low, high) = (i.low.to_degrees(), i.high.to_degrees());
            format!("95 % interval [{low:.0}, {high:.0}]")
        };
        let rate = match fit.rate_interval_rad_s() {
            Some(interval) => within(interval),
            None => "the prior's: the axis has not gone far enough".to_owned(),
        };
        let decay = fit.decay_interval_per_s();
        vec![
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
            format!(
                "             the spin decays by {:.3} /s (95 % interval [{:.3}, {:.3}])",
                fit.motion.decay_per_s, decay.low, decay.high
            ),
            format!(
                "             median residual {:.2} deg, of a constant spin {:.2} deg",
                self.motion_rad.to_degrees(),
                self.constant_rad.to_degrees()
            ),
        ]
    }
}

/// How far a free motion's spin changes, in a line.
fn free_words(fit: &FreeFit) -> String {
    let (low, high) = fit.rates_rad_s();
    format!(
        "            pushed: the spin is {:.3} rps (rms) off its mean, {:.3} to {:.3} rps over the time (--windows)",
        fit.spread_rad_s() / TAU,
        low / TAU,
        high / TAU,
    )
}

/// A free motion as JSON.
fn free_json(fit: &FreeFit) -> Value {
    let over_time = fit.knots.iter().map(|knot| {
        let std = standard_deviations(&knot.spin_covariance);
        json!({
            "time_s": knot.time_s,
            "spin_rad_s": knot.spin.as_slice(),
            "std_rad_s": std.as_slice(),
        })
    });
    json!({
        "ln_bayes_factor": fit.ln_bayes_factor,
        "spread_rad_s": fit.spread_rad_s(),
        "spread_rps": fit.spread_rad_s() / TAU,
        "change_rad2_s3": fit.change,
        "over_time": over_time.collect::<Vec<_>>(),
    })
}
