//! `spindoe spin`: estimates the spin from time-stamped orientations.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::json;

use super::motion::{ObservedMotion, Theory};
use super::output::one_of;
use super::spin_stretches::{self as stretches, Holding};
use super::spin_summary;
use crate::error::{Error, Result};
use crate::files;
use crate::geometry::{CameraFrame, Rotation};
use crate::spin::air::{Air, FlyingBall, boundary_layer_decay, creeping_decay};
use crate::spin::alias::AliasConfig;
use crate::spin::estimate::{FittedMotion, MotionModel, SpinEstimate};
use crate::spin::orientations::{OrientationReader, Orientations};
use crate::spin::quatera::{QuateraConfig, QuateraEstimator};
use crate::spin::robust::{MagnitudePrior, SpinConfig};
use crate::spin::summary::SpinSummary;
use crate::spin::windows::{WindowFit, spin_over_time};
use crate::spin::{Fit, MIN_FRAMES, Measurement, SpinRejection};

/// Standard deviation of a prior magnitude where none is given, as a fraction of the magnitude.
const PRIOR_SPREAD: f64 = 0.2;
/// Ratio of the residuals to the expected ones above which a warning is printed.
const SUSPICIOUS_NOISE: f64 = 3.0;

/// How the spin is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SpinMethod {
    /// The paper's: regression in the plane of the quaternions after RANSAC.
    Quatera,
    /// Maximum likelihood on SO(3) under a mixture of noise and outliers.
    Robust,
}

#[derive(Debug, Args)]
pub struct Arguments {
    /// Orientations: CSV with a header,
    /// frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence (seconds; quaternion scalar
    /// first, pattern to camera or to what a column camera_frame says, empty where there is none); - is
    /// standard input.
    orientations: PathBuf,
    /// The ball, of a file of several (`estimate --balls`). Its times are in the file: a ball need not have a row for every frame.
    #[arg(long, value_name = "N", conflicts_with = "fps")]
    ball: Option<usize>,
    /// The exposure, of a file of several with flashes (`estimate --strobe-ms`): the name of its frame. Of exposures whose times
    /// follow each other all are read as one sequence without it.
    #[arg(long, value_name = "FRAME", conflicts_with = "fps")]
    exposure: Option<String>,
    /// How the spin is estimated.
    #[arg(hide = true, long, value_enum, default_value = "robust")]
    method: SpinMethod,
    /// Frames per second, for rows at equal intervals: the times in the file are ignored.
    #[arg(long, value_name = "F", allow_negative_numbers = true)]
    fps: Option<f64>,
    /// The axes that the spin is written in: camera, x right, y up, z towards the camera;
    /// optical, x right, y down, z forward [default: those of the file].
    #[arg(long, value_parser = one_of(&CameraFrame::AXES, CameraFrame::as_str))]
    frame: Option<CameraFrame>,
    /// Maximum spin considered, revolutions per second. At equal times T apart, spins beyond 1/(2
    /// T) appear as slower ones (aliases).
    #[arg(long, default_value_t = 175.0, allow_negative_numbers = true)]
    max_spin_rps: f64,
    /// Expected magnitude of the spin, revolutions per second, where it is known.
    #[arg(hide = true, long, allow_negative_numbers = true)]
    prior_rps: Option<f64>,
    /// Standard deviation of the expected magnitude [default: a fifth of it].
    #[arg(
        hide = true,
        long,
        allow_negative_numbers = true,
        requires = "prior_rps"
    )]
    prior_std_rps: Option<f64>,
    /// Initial estimate of the orientations' noise in degrees per axis; the residuals correct it [default: by the covariances of
    /// the file, else 2].
    #[arg(hide = true, long, allow_negative_numbers = true)]
    orientation_sigma_deg: Option<f64>,
    /// How the ball moves: at a constant spin; at one that decays, |w|(t) = |w0| exp(-c t); precessing, as an uneven ball does:
    /// its spin's axis drifts through the ball and circles the angular momentum, and the spin reported is the mean one; auto,
    /// the one of these for which there is evidence, or free: pushed, by a treadmill or a hand, at a spin that changes smoothly in
    /// whatever way, and the spin reported is the mean over the time.
    #[arg(long, value_parser = one_of(&MotionModel::ALL, MotionModel::as_str), default_value_t)]
    motion: MotionModel,
    /// The time that the spin is reported at, in seconds, within the file's [default: the middle; of a free motion the mean over all].
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    at: Option<f64>,
    /// Write where one constant spin holds, also where none holds over the whole file, as CSV:
    /// from_s,to_s,orientations,inliers,rps,wx,wy,wz,sigma_deg,camera_frame (rad/s).
    #[arg(long, value_name = "FILE")]
    stretches: Option<PathBuf>,
    /// Write the spin over time, of runs of ten orientations that overlap by half, also where no constant spin
    /// holds, as CSV: time_s,wx,wy,wz,rps,std_x,std_y,std_z,inliers,frames,camera_frame (rad/s). Of a free motion it is the spin at
    /// each orientation, by all of them.
    #[arg(long, value_name = "FILE")]
    windows: Option<PathBuf>,
    /// Draw the spin over time, from runs of a few orientations each, as a PNG file.
    #[cfg(feature = "plot")]
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Orientations in a run, within which the spin is taken as constant; for a decaying spin, --picture, --stretches and --windows.
    #[arg(hide = true, long, default_value_t = 10)]
    window: usize,
    /// Diameter of the ball in millimeters, for the theoretical decay.
    #[arg(
        hide = true,
        long,
        default_value_t = 40.0,
        allow_negative_numbers = true
    )]
    ball_diameter_mm: f64,
    /// Mass of the ball in grams, a thin shell, for the theoretical decay.
    #[arg(
        hide = true,
        long,
        default_value_t = 2.7,
        allow_negative_numbers = true
    )]
    ball_mass_g: f64,
    /// Print one JSON object instead of words.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    fn draws(&self) -> bool {
        #[cfg(feature = "plot")]
        return self.picture.is_some();
        #[cfg(not(feature = "plot"))]
        return false;
    }

    /// The files that are written.
    fn written(&self) -> impl Iterator<Item = &PathBuf> {
        let files = self.stretches.iter().chain(&self.windows);
        #[cfg(feature = "plot")]
        let files = files.chain(&self.picture);
        files
    }

    fn check(&self) -> Result<()> {
        let flags = [
            ("--fps", self.fps),
            ("--max-spin-rps", Some(self.max_spin_rps)),
            ("prior_rps", self.prior_rps),
            ("prior_std_rps", self.prior_std_rps),
            ("orientation_sigma_deg", self.orientation_sigma_deg),
            ("ball_diameter_mm", Some(self.ball_diameter_mm)),
            ("ball_mass_g", Some(self.ball_mass_g)),
        ];
        for (name, value) in flags {
            if let Some(x) = value.filter(|x| !(*x > 0.0 && x.is_finite())) {
                let problem = format!("expected a positive number, found {x}");
                return Err(Error::argument(name, problem));
            }
        }
        if self.window < MIN_FRAMES {
            let problem = format!("expected at least {MIN_FRAMES}, found {}", self.window);
            return Err(Error::argument("window", problem));
        }
        let is_constant = matches!(self.motion, MotionModel::Auto | MotionModel::Constant);
        if self.method == SpinMethod::Quatera && (!is_constant || self.draws()) {
            let problem =
                "the paper's method has constant spins only and no --picture, expected robust";
            return Err(Error::argument("--method", problem));
        }
        Ok(())
    }

    /// The settings for a file.
    fn config(&self, file: &Orientations) -> SpinConfig {
        let default = SpinConfig::default();
        let given = self.orientation_sigma_deg.map(f64::to_radians);
        SpinConfig {
            max_rps: self.max_spin_rps,
            sigma_rad: given
                .or_else(|| file.noise_rad())
                .unwrap_or(default.sigma_rad),
            prior: self.prior_rps.map(|rps| MagnitudePrior {
                rps,
                std_rps: self.prior_std_rps.unwrap_or(PRIOR_SPREAD * rps),
            }),
            window: self.window,
            ..default
        }
    }

    fn fit(
        &self,
        measurements: &[Measurement],
        config: SpinConfig,
    ) -> std::result::Result<SpinEstimate, SpinRejection> {
        match self.method {
            SpinMethod::Robust => SpinEstimate::fit(measurements, self.motion, &config),
            SpinMethod::Quatera => {
                let max_rps = self.max_spin_rps;
                let options = QuateraConfig {
                    max_rps,
                    ..QuateraConfig::default()
                };
                let fit = QuateraEstimator::new(options).fit(measurements)?;
                Ok(SpinEstimate::of_constant(fit, measurements))
            }
        }
    }

    /// The file's name, and the orientations of it that are asked for.
    fn read(&self) -> Result<(PathBuf, Orientations)> {
        let input = super::open_input(&self.orientations)?;
        let mut reader = match self.fps {
            None => OrientationReader::new(&input.name, input.reader)?,
            Some(fps) => OrientationReader::at_rate(&input.name, input.reader, fps)?,
        };
        if let Some(number) = self.ball {
            reader = reader.of_ball(number);
        }
        if let Some(frame) = &self.exposure {
            reader = reader.of_exposure(frame);
        }
        let file = Orientations::collect(reader)?;
        let lacking = |column, of: String| {
            Error::input(
                &input.name,
                column,
                format!("expected rows of {of}, found none"),
            )
        };
        match (&self.exposure, self.ball) {
            _ if !file.rows.is_empty() => Ok((input.name, file)),
            (Some(frame), _) => Err(lacking("frame", frame.clone())),
            (None, Some(number)) => Err(lacking("ball", format!("ball {number}"))),
            (None, None) => Ok((input.name, file)),
        }
    }

    /// Notes where the orientations are farther off the motion than expected.
    fn doubt_noise(&self, fit: &Fit, motion: &ObservedMotion) {
        let noise = fit.sigma_rad.unwrap_or(0.0).to_degrees();
        let expected = self
            .orientation_sigma_deg
            .unwrap_or_else(|| SpinConfig::default().sigma_rad.to_degrees());
        if noise > SUSPICIOUS_NOISE * expected {
            errln!(
                "note: the orientations are {noise:.1} deg per axis off a {} spin, expected {expected} deg: is it one?",
                motion.estimate.motion.model(),
            );
        }
    }

    /// What theory expects of the decay of a spin, rad/s.
    fn theory(&self, spin_rad_s: f64) -> Theory {
        let ball = FlyingBall {
            radius_m: 0.5e-3 * self.ball_diameter_mm,
            mass_kg: 1e-3 * self.ball_mass_g,
        };
        let air = Air::default();
        Theory {
            creeping: creeping_decay(&ball, &air),
            boundary_layer: boundary_layer_decay(&ball, &air, spin_rad_s),
        }
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.check()?;
    for path in arguments.written() {
        files::check_writable(path)?;
    }
    let (name, file) = arguments.read()?;
    let measurements = file.measurements();
    let config = arguments.config(&file);
    let frame = file.camera_frame.unwrap_or_default();
    let request = Request {
        arguments,
        name: &name,
        file: &file,
        measurements: &measurements,
        config: &config,
        held: &Holding::new(&measurements, &config),
        shown: frame.in_axes(arguments.frame.unwrap_or(frame)),
    };
    request.write_stretches()?;
    let found = request.summary();
    let runs = request.runs(found.as_ref().ok().map(|(_, motion)| motion))?;
    let (summary, motion) = match found {
        Ok(found) => found,
        Err(error) => {
            if let (Error::NoAnswer { reason, .. }, true) = (&error, arguments.json) {
                let mut json = json!({
                    "spin_rad_s": null,
                    "rps": null,
                    "reason": reason,
                    "frames": file.rows.len(),
                    "orientations": measurements.len(),
                });
                request.add_parts(&mut json, true, runs.as_ref());
                super::print_json(&json)?;
            }
            return Err(error);
        }
    };
    arguments.doubt_noise(&summary.fit, &motion);
    let (written, turn) = request.shown;
    let found = SpinAnswer {
        method: arguments.method,
        summary: summary.turned(&turn),
        camera_frame: written,
        motion: motion.turned(&turn),
    };
    #[cfg(feature = "plot")]
    if let Some(path) = &arguments.picture {
        let runs = spin_over_time(&measurements, config.window, &config);
        let runs = runs.map_err(|r| request.rejected(r))?;
        super::spin_plot::plot_over_time(path, &runs, &found.motion.estimate)?;
    }
    if arguments.json {
        let mut json = found.to_json();
        request.add_parts(&mut json, arguments.stretches.is_some(), runs.as_ref());
        return super::print_json(&json);
    }
    found.print();
    Ok(())
}

/// What a spin is asked of.
struct Request<'a> {
    arguments: &'a Arguments,
    name: &'a Path,
    file: &'a Orientations,
    measurements: &'a [Measurement],
    config: &'a SpinConfig,
    held: &'a Holding<'a>,
    /// The frame that is written, and the turn to it.
    shown: (CameraFrame, Rotation),
}

/// The spin over time.
struct Runs {
    /// By how many orientations each is.
    by: usize,
    fits: Vec<WindowFit>,
}

impl Request<'_> {
    /// Writes the parts of the sequence in which a spin holds, where they are asked for.
    fn write_stretches(&self) -> Result<()> {
        let Some(path) = &self.arguments.stretches else {
            return Ok(());
        };
        let held = self.held.stretches().map_err(|r| r.in_file(self.name))?;
        stretches::write(path, self.measurements, held, &self.shown)
    }

    /// The spin over time, written, where it is asked for: a free motion's own, or that of runs of orientations.
    fn runs(&self, motion: Option<&ObservedMotion>) -> Result<Option<Runs>> {
        let Some(path) = &self.arguments.windows else {
            return Ok(None);
        };
        let runs = match motion.and_then(ObservedMotion::over_time) {
            Some(fits) => Runs {
                by: fits.len(),
                fits,
            },
            None => {
                let by = self.config.window;
                let fits = spin_over_time(self.measurements, by, self.config);
                let fits = fits.map_err(|r| r.in_file(self.name))?;
                Runs { by, fits }
            }
        };
        stretches::write_windows(path, &runs.fits, runs.by, &self.shown)?;
        Ok(Some(runs))
    }

    /// What holds in parts is said beside the answer, or instead of it.
    fn add_parts(&self, json: &mut serde_json::Value, with_stretches: bool, runs: Option<&Runs>) {
        if with_stretches {
            let held = self.held.stretches().unwrap_or_default();
            json["stretches"] = stretches::to_json(self.measurements, held, &self.shown);
        }
        if let Some(runs) = runs {
            json["windows"] = stretches::windows_to_json(&runs.fits, runs.by, &self.shown);
        }
    }

    /// The spin, and the motion.
    fn summary(&self) -> Result<(SpinSummary, ObservedMotion)> {
        let (arguments, measurements) = (self.arguments, self.measurements);
        let config = SpinConfig {
            shared: self.file.shared_error(),
            ..*self.config
        };
        let listed = AliasConfig::of(&config);
        let estimate = arguments
            .fit(measurements, config)
            .map_err(|r| self.rejected(r))?;
        if let FittedMotion::Constant(fit) = &estimate.motion
            && estimate.clock.is_right()
            && self.held.contradicts(fit)
        {
            let reason = format!(
                "no constant spin holds over the {} orientations (best: {}){}",
                measurements.len(),
                fit.inliers,
                self.held.words(self.arguments.motion)
            );
            let path = self.name.to_path_buf();
            return Err(Error::NoAnswer { path, reason });
        }
        let [from, to] = estimate.span_s();
        if let Some(at) = arguments.at.filter(|at| !(from..=to).contains(at)) {
            let problem =
                format!("expected a time within the orientations' {from} to {to} s, found {at}");
            return Err(Error::argument("--at", problem));
        }
        let frames = self.file.rows.len();
        let asked_for = arguments.motion;
        let (summary, motion) = ObservedMotion::new(
            estimate,
            asked_for,
            measurements,
            arguments.at,
            &listed,
            frames,
        );
        let theory = arguments.theory(summary.fit.motion.spin.norm());
        Ok((summary, motion.with_theory(theory)))
    }

    /// A rejection as this file's error.
    fn rejected(&self, rejection: SpinRejection) -> Error {
        let (rows, path) = (self.file.rows.len(), self.name.to_path_buf());
        match rejection {
            _ if rejection.is_no_spin() => Error::NoAnswer {
                path,
                reason: format!("{rejection}{}", self.held.words(self.arguments.motion)),
            },
            SpinRejection::TooFewFrames { .. } if rows > 0 && self.measurements.is_empty() => {
                Error::NoAnswer {
                    path,
                    reason: format!("no spin: none of {rows} frames has an orientation"),
                }
            }
            _ => rejection.in_file(self.name),
        }
    }
}

/// Everything that is reported.
pub(super) struct SpinAnswer {
    method: SpinMethod,
    pub(super) summary: SpinSummary,
    camera_frame: CameraFrame,
    pub(super) motion: ObservedMotion,
}

impl SpinAnswer {
    fn to_json(&self) -> serde_json::Value {
        let mut json = spin_summary::to_json(&self.summary, self.camera_frame);
        json["method"] = match self.method {
            SpinMethod::Quatera => "quatera",
            SpinMethod::Robust => "robust",
        }
        .into();
        self.motion.add_to(&mut json);
        json
    }

    fn print(&self) {
        let lines = spin_summary::lines(&self.summary, self.camera_frame);
        for line in lines.iter().chain(&self.motion.lines()) {
            outln!("{line}");
        }
    }
}
