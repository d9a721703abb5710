//! How a pattern's rates before a camera depend on the camera: one property varied at a time.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::conditions::CameraConditions;
use super::frames::FrameRates;
use super::trials::CameraTrials;
use crate::error::Result;
use crate::pattern::Pattern;

/// What is varied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraParameter {
    /// Diameter of the ball in the image, pixels.
    BallPx,
    /// Exposure, milliseconds.
    ExposureMs,
    /// Standard deviation of a pixel's noise, of 255 levels.
    NoiseLevels,
    /// Standard deviation of the lens' blur, pixels.
    DefocusPx,
    /// Diameter of a dot over that of the ball.
    DotDiameter,
}

impl CameraParameter {
    /// As written in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::BallPx => "ball_px",
            Self::ExposureMs => "exposure_ms",
            Self::NoiseLevels => "noise_levels",
            Self::DefocusPx => "defocus_px",
            Self::DotDiameter => "dot_diameter",
        }
    }

    /// In words, with its unit.
    pub fn words(self) -> &'static str {
        match self {
            Self::BallPx => "diameter of the ball [px]",
            Self::ExposureMs => "exposure [ms]",
            Self::NoiseLevels => "noise of a pixel, of 255 levels",
            Self::DefocusPx => "blur of the lens, standard deviation [px]",
            Self::DotDiameter => "diameter of a dot, of the ball's",
        }
    }
}

/// Factors on what has a value.
const FACTORS: [f64; 5] = [0.5, 0.7, 1.0, 1.4, 2.0];
/// Noise, levels, where none is stated.
const NOISE_LEVELS: [f64; 5] = [1.0, 2.0, 4.0, 8.0, 16.0];
/// Blur, ball diameters, where none is stated.
const DEFOCUS: [f64; 5] = [0.003, 0.006, 0.012, 0.025, 0.05];

/// Exposures of a camera whose own is none, ms.
const EXPOSURES_MS: [f64; 5] = [0.05, 0.1, 0.2, 0.4, 0.8];

/// One camera of a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweptCamera {
    /// The property that is varied.
    pub parameter: CameraParameter,
    /// Its value.
    pub value: f64,
    /// The camera.
    pub conditions: CameraConditions,
}

/// Cameras that differ from one in one property each.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraSweep {
    /// In the order of the properties, their values ascending.
    pub cameras: Vec<SweptCamera>,
}

/// A point of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraPoint {
    /// The property that is varied.
    pub parameter: CameraParameter,
    /// Its value.
    pub value: f64,
    /// The result.
    #[serde(flatten)]
    pub frames: FrameRates,
}

impl CameraSweep {
    /// Half to twice of what a camera has; what is not stated in a usual range. Values outside the
    /// domain are left out.
    pub fn around(conditions: &CameraConditions) -> Self {
        let base = *conditions;
        let around = |value: Option<f64>, usual: [f64; 5]| {
            value
                .filter(|v| *v > 0.0)
                .map_or(usual, |v| FACTORS.map(|f| f * v))
        };
        let pixels = FACTORS.map(|f| f * base.ball_px);
        let exposures = around(Some(1e3 * base.exposure_s), EXPOSURES_MS);
        let noise = around(base.noise_levels, NOISE_LEVELS);
        let blur = around(base.defocus_px, DEFOCUS.map(|b| b * base.ball_px));
        let dots = FACTORS.map(|f| f * base.dot_diameter);
        let all = [
            (CameraParameter::BallPx, pixels),
            (CameraParameter::ExposureMs, exposures),
            (CameraParameter::NoiseLevels, noise),
            (CameraParameter::DefocusPx, blur),
            (CameraParameter::DotDiameter, dots),
        ];
        let cameras = all.into_iter().flat_map(|(parameter, values)| {
            values.map(|value| SweptCamera {
                parameter,
                value,
                conditions: with(base, parameter, value),
            })
        });
        Self {
            cameras: cameras.filter(|c| c.conditions.check().is_ok()).collect(),
        }
    }

    /// The rates of `frames` frames of each of them on the same scenes; `each` receives every point as soon
    /// as it is known, `done` how many more frames are read.
    ///
    /// # Errors
    /// As [`CameraTrials::frames`].
    pub fn run(
        &self,
        pattern: &Pattern,
        seed: u64,
        frames: u64,
        each: &mut dyn FnMut(&CameraPoint),
        done: &(dyn Fn(u64) + Sync),
    ) -> Result<Vec<CameraPoint>> {
        self.cameras
            .iter()
            .map(|camera| {
                let trials = CameraTrials::new(camera.conditions, seed);
                let outcomes = trials.frames(pattern, 0..frames, done)?;
                let point = CameraPoint {
                    parameter: camera.parameter,
                    value: camera.value,
                    frames: FrameRates::of(&outcomes, seed),
                };
                each(&point);
                Ok(point)
            })
            .collect()
    }
}

/// The camera with this value. A larger image of the ball has the same blur of the lens in pixels.
fn with(base: CameraConditions, parameter: CameraParameter, value: f64) -> CameraConditions {
    let mut conditions = base;
    match parameter {
        CameraParameter::BallPx => conditions.ball_px = value,
        CameraParameter::ExposureMs => conditions.exposure_s = 1e-3 * value,
        CameraParameter::NoiseLevels => conditions.noise_levels = Some(value),
        CameraParameter::DefocusPx => conditions.defocus_px = Some(value),
        CameraParameter::DotDiameter => conditions.dot_diameter = value,
    }
    conditions
}

/// A sweep as CSV: a header, then one point a row.
pub fn sweep_csv(points: &[CameraPoint]) -> String {
    let mut text = String::from(
        "parameter,value,seed,frames,right,right_low,right_high,wrong,wrong_low,wrong_high,\
         unanswered,mean_error_deg,median_error_deg,rms_error_deg\n",
    );
    for p in points {
        let r = &p.frames;
        // Empty without a right answer.
        let errors = [r.mean_error_deg, r.median_error_deg, r.rms_error_deg];
        let errors = errors.map(|error| match error.is_nan() {
            true => ",".to_owned(),
            false => format!(",{error}"),
        });
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{}{}",
            p.parameter.as_str(),
            p.value,
            p.frames.seed,
            r.right.trials,
            r.right.rate,
            r.right.low,
            r.right.high,
            r.wrong.rate,
            r.wrong.low,
            r.wrong.high,
            r.unanswered.rate,
            errors.concat()
        );
    }
    text
}
