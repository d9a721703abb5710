//! Sensitivity: how the rates depend on the dots' noise and, for the paper's recognizer, on
//! `alpha`, the standard deviation of a vote's length (SpinDOE, Sec. IV-A).
//!
//! All points of a sweep share their seed and thus their rotations, so a curve shows the
//! parameter's effect and not sampling noise. Points of one curve are therefore correlated; each
//! interval is valid for its own point only.

use std::fmt::Write as _;
use std::sync::atomic::AtomicBool;

use super::{NamedValidation, Trials, Validation, ValidationConfig, check_samples};
use crate::ball::Ball;
use crate::error::Result;
use crate::recognize::{PaperConfig, PaperRecognizer, RecognizerName};
use crate::view::Protocol;

/// What a sweep varies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SweptParameter {
    /// The noise of a dot, degrees.
    SigmaDeg,
    /// The paper's alpha, without unit.
    Alpha,
}

impl SweptParameter {
    /// As written in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::SigmaDeg => "sigma_deg",
            Self::Alpha => "alpha",
        }
    }
}

/// Which values are swept, and on how many trials.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SensitivityConfig {
    /// The recognizers that the noise is swept for.
    pub recognizers: Vec<RecognizerName>,
    /// Noise of a dot, degrees.
    pub sigmas_deg: Vec<f64>,
    /// Values of alpha, for the paper's recognizer at the protocol's own noise.
    pub alphas: Vec<f64>,
    /// Trials a point.
    pub samples: u64,
    /// Seed of the trials.
    pub seed: u64,
}

impl Default for SensitivityConfig {
    /// Both recognizers; 1 to 10 degrees in steps of one; alpha from 0.003 to 1 in half decades; 2 000 trials, seed
    /// 0.
    fn default() -> Self {
        Self {
            recognizers: RecognizerName::ALL.to_vec(),
            sigmas_deg: (1..=10).map(f64::from).collect(),
            alphas: vec![0.003, 0.01, 0.03, 0.1, 0.3, 1.0],
            samples: 2_000,
            seed: 0,
        }
    }
}

impl SensitivityConfig {
    /// How many points [`sensitivity`] measures.
    pub fn points(&self) -> usize {
        self.recognizers.len() * self.sigmas_deg.len() + self.alphas.len()
    }
}

/// A point of a sweep.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SensitivityPoint {
    /// The varied parameter.
    pub parameter: SweptParameter,
    /// Its value.
    pub value: f64,
    /// The result.
    #[serde(flatten)]
    pub result: NamedValidation,
}

impl SensitivityConfig {
    /// Whether all points can be measured.
    fn check(&self, ball: &Ball, protocol: &Protocol) -> Result<()> {
        check_samples(self.samples)?;
        for &sigma in &self.sigmas_deg {
            protocol.with_sigma_rad(sigma.to_radians()).view().check()?;
        }
        for &alpha in &self.alphas {
            PaperConfig {
                alpha,
                ..*ball.recognizer()
            }
            .check()?;
        }
        Ok(())
    }
}

/// Sweeps noise and alpha; `each` receives every point as soon as it is measured. Setting `stop` ends it.
///
/// # Errors
/// As [`ValidationConfig::run`]; [`crate::Error::Stopped`].
pub fn sensitivity(
    ball: &Ball,
    protocol: &Protocol,
    config: &SensitivityConfig,
    stop: Option<&AtomicBool>,
    each: &mut dyn FnMut(&SensitivityPoint) -> Result<()>,
) -> Result<Vec<SensitivityPoint>> {
    config.check(ball, protocol)?;
    let at = |recognizer, protocol| ValidationConfig {
        recognizer,
        protocol,
        seed: config.seed,
        samples: config.samples,
    };
    let mut points = Vec::new();
    let mut keep = |parameter, value, result| -> Result<()> {
        let point = SensitivityPoint {
            parameter,
            value,
            result,
        };
        each(&point)?;
        points.push(point);
        Ok(())
    };
    for &recognizer in &config.recognizers {
        for &sigma in &config.sigmas_deg {
            let own = protocol.with_sigma_rad(sigma.to_radians());
            let found = at(recognizer, own).run_until(ball, stop)?;
            keep(SweptParameter::SigmaDeg, sigma, found)?;
        }
    }
    if config.alphas.is_empty() {
        // Without its features, which take longer than a point of it.
        return Ok(points);
    }
    let trials = Trials {
        stop,
        ..at(RecognizerName::Voting, *protocol).trials(ball.pattern())
    };
    let mut paper = PaperRecognizer::for_ball(ball)?;
    for &alpha in &config.alphas {
        paper = paper.with_config(PaperConfig {
            alpha,
            ..*ball.recognizer()
        })?;
        let results = trials.run(&paper, &|_| {})?;
        let found = NamedValidation {
            recognizer: RecognizerName::Voting,
            validation: Validation::of(&results, protocol.name(), &trials),
        };
        keep(SweptParameter::Alpha, alpha, found)?;
    }
    Ok(points)
}

/// A sweep as CSV: a header, then one point a row.
pub fn sensitivity_csv(points: &[SensitivityPoint]) -> String {
    let mut text = String::from(
        "parameter,value,recognizer,protocol,seed,samples,answered,answered_low,answered_high,trials,skipped,\
         identity,identity_low,identity_high,orientation,orientation_low,orientation_high,\
         mean_error_deg,median_error_deg\n",
    );
    for p in points {
        let v = &p.result.validation;
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
            p.parameter.as_str(),
            p.value,
            p.result.recognizer,
            v.protocol,
            v.seed,
            v.samples,
            v.answered.rate,
            v.answered.low,
            v.answered.high,
            v.identity.trials,
            v.skipped,
            v.identity.rate,
            v.identity.low,
            v.identity.high,
            v.orientation.rate,
            v.orientation.low,
            v.orientation.high,
            v.mean_error_deg,
            v.median_error_deg,
        );
    }
    text
}
