//! What `spindoe estimate` and `spindoe live` ask alike: the ball, its images, and what of it is written.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::balls;
use super::format::{ForeignFormat, FormatArguments};
use crate::ball::Ball;
use crate::cli::flashes::Flashes;
use crate::cli::images::{ImageArguments, read_balls};
use crate::cli::output::one_of;
use crate::error::{Error, Result, require};
use crate::geometry::CameraFrame;
use crate::spin::golf::{self, GolfFlight};
use crate::spin::robust::SpinConfig;
use crate::surface::SurfaceMap;
use crate::vision::frame::config::CameraModel;
use crate::vision::{Estimator, EstimatorConfig};

/// A sport's ball, camera and words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SportPreset {
    /// A golf ball of 42.67 mm before a launch monitor.
    Golf,
}

#[derive(Debug, Args)]
pub struct Asked {
    /// The ball as a name, table, pattern or folder: the name of a shipped pattern (dots20), a table (.npz), a pattern (CSV of unit vectors
    /// x,y,z), the folder of a design or calibration, or the surface of a painted ball (`estimate --write-surface`). Of
    /// several the one that fits all frames best is chosen.
    #[arg(long, value_name = "TABLE.npz")]
    pub table: Vec<PathBuf>,
    #[command(flatten)]
    pub source: ImageArguments,
    /// Ball's diameter: with --intrinsics it says how far the ball is, millimeters; with --preset golf it is 42.67 by default [default: the table's or 40].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub ball_diameter_mm: Option<f64>,
    /// Axes written. Orientations, positions and spin are in these: camera, x right, y up, z towards the camera; optical, x right, y down,
    /// z forward. Without --intrinsics the frame is the view frame, whose z points from the ball to the camera.
    #[arg(long, value_parser = one_of(&CameraFrame::AXES, CameraFrame::as_str), default_value_t = CameraFrame::Camera)]
    pub frame: CameraFrame,
    /// The images are mirrored: by a flipped camera, or as a selfie video is. Left and right are exchanged first.
    /// Pixels in the output are those of the images so exchanged, and --intrinsics those of a camera that takes such.
    #[arg(long)]
    pub mirrored: bool,
    /// Minimum confidence to report: the probability that an orientation is right, 0 to 1.
    #[arg(
        long,
        value_name = "P",
        default_value_t = EstimatorConfig::default().min_confidence,
        allow_negative_numbers = true
    )]
    pub min_confidence: f64,
    /// Placement error: standard deviation of a drawn dot's place from the pattern's, along one tangent
    /// axis, degrees. The dots of a calibrated table have their own [default: 1.2].
    #[arg(hide = true, long, value_name = "S", allow_negative_numbers = true)]
    pub placement_sigma_deg: Option<f64>,
    /// Maximum spin considered: revolutions per second [default: 175; with --preset golf 250].
    #[arg(long, value_name = "RPS", allow_negative_numbers = true)]
    pub max_spin_rps: Option<f64>,
    /// All balls of every frame: so many, or auto, as many as there are. Each has its own row, with a column ball, whose number it
    /// keeps from frame to frame; of several tables each has the one that fits it, in a column table.
    #[arg(
        long,
        value_name = "N|auto",
        value_parser = balls::count,
        conflicts_with = "circle"
    )]
    pub balls: Option<balls::BallCount>,
    /// Flashes of one exposure, milliseconds: ascending, or PERIODxN, as in 0.7x3. A frame shows one ball once for each flash, and its spin follows from these
    /// images alone. Rows have the times of their flashes and a column flash.
    #[arg(
        long,
        value_name = "MS,MS..",
        allow_hyphen_values = true,
        conflicts_with = "circle"
    )]
    pub strobe_ms: Option<Flashes>,
    /// Direction in which a strobed ball flies across the picture [default: by the images; where they leave it open, both are
    /// reported].
    #[arg(
        hide = true,
        long,
        value_parser = one_of(&GolfFlight::ALL, GolfFlight::as_str),
        requires = "strobe_ms"
    )]
    pub flight: Option<GolfFlight>,
    /// The spin of strobed balls in golf's words: backspin, sidespin, tilt and rpm. The ball, of 42.67 mm, is seen from 0.4 to 0.6 m, unless
    /// --intrinsics or --camera-distance-radii say more, and spins of up to 15 000 rpm are considered.
    #[arg(
        long,
        value_enum,
        value_name = "golf",
        hide_possible_values = true,
        requires = "strobe_ms"
    )]
    pub preset: Option<SportPreset>,
    #[command(flatten)]
    pub format: FormatArguments,
}

impl Asked {
    /// One for each table; `measures_blur` where a frame's exposure is known.
    pub fn estimators(&self, measures_blur: bool) -> Result<Vec<Estimator>> {
        let balls = read_balls(&self.table)?;
        let estimator = |ball: &Ball| self.estimator(ball, measures_blur);
        balls.iter().map(estimator).collect()
    }

    /// The surface of a painted ball, where the table is one.
    pub fn surface(&self) -> Result<Option<SurfaceMap>> {
        match &self.table[..] {
            [path] => SurfaceMap::read_if_one(path),
            _ => Ok(None),
        }
    }

    /// That of a ball.
    pub fn estimator(&self, ball: &Ball, measures_blur: bool) -> Result<Estimator> {
        self.estimator_of(ball, self.camera()?, measures_blur)
    }

    /// The same of a ball that this camera sees.
    pub fn estimator_of(
        &self,
        ball: &Ball,
        camera: CameraModel,
        measures_blur: bool,
    ) -> Result<Estimator> {
        self.check_numbers()?;
        let mut config = EstimatorConfig {
            camera,
            outline: self.source.outline,
            min_confidence: self.min_confidence,
            ball_radius_m: self.ball_radius_m()?,
            measures_blur,
            ..EstimatorConfig::default()
        };
        if let Some(degrees) = self.placement_sigma_deg {
            if ball.dot_covariances().is_some() {
                let problem = "expected none: the table is calibrated and has each dot's own error";
                return Err(Error::argument("--placement-sigma-deg", problem));
            }
            let inside = degrees > 0.0 && degrees < 25.0;
            require(
                inside,
                "--placement-sigma-deg",
                "more than 0 and less than 25",
                degrees,
            )?;
            config.placement_sigma_rad = degrees.to_radians();
        }
        Estimator::for_ball(ball, config, self.source.detector()?)
    }

    /// Rejects numbers outside their domains, and a ball that is not given.
    pub fn check(&self) -> Result<()> {
        if self.table.is_empty() {
            let problem = "expected the ball, as in --table dots20 or --table my-ball";
            return Err(Error::argument("table", problem));
        }
        self.check_numbers()
    }

    /// Rejects numbers outside their domains.
    pub fn check_numbers(&self) -> Result<()> {
        if !(0.0..=1.0).contains(&self.min_confidence) {
            let problem = format!("expected 0 to 1, found {}", self.min_confidence);
            return Err(Error::argument("--min-confidence", problem));
        }
        self.source.check_rate()?;
        self.check_format()?;
        self.ball_radius_m()?;
        let max_rps = self.max_rps();
        if !(max_rps > 0.0 && max_rps.is_finite()) {
            let problem = format!("expected a positive number, found {max_rps}");
            return Err(Error::argument("--max-spin-rps", problem));
        }
        Ok(())
    }

    /// Radius of the ball where it is stated, m.
    pub fn ball_radius_m(&self) -> Result<Option<f64>> {
        let golf = self.is_golf().then_some(golf::BALL_MM);
        let Some(mm) = self.ball_diameter_mm.or(golf) else {
            return Ok(None);
        };
        let inside = (1.0..=1000.0).contains(&mm);
        require(inside, "--ball-diameter-mm", "1 to 1000 mm", mm)?;
        Ok(Some(0.5e-3 * mm))
    }

    /// Whether spins are said in golf's words.
    pub fn is_golf(&self) -> bool {
        self.preset == Some(SportPreset::Golf)
    }

    /// Whether a frame shows several images of balls.
    pub fn is_several(&self) -> bool {
        self.balls.is_some() || self.strobe_ms.is_some()
    }

    /// The maximum spin considered, revolutions per second.
    pub fn max_rps(&self) -> f64 {
        let usual = if self.is_golf() { golf::MAX_RPS } else { 175.0 };
        self.max_spin_rps.unwrap_or(usual)
    }

    /// The spins considered.
    pub fn spin(&self) -> SpinConfig {
        SpinConfig {
            max_rps: self.max_rps(),
            ..SpinConfig::default()
        }
    }

    /// What is known of the camera.
    pub fn camera(&self) -> Result<CameraModel> {
        let given = self.source.camera()?;
        let is_open = self.is_golf() && given == CameraModel::default();
        Ok(if is_open { balls::golf_camera() } else { given })
    }

    /// The frame of orientations and spin.
    pub fn frame(&self) -> Result<CameraFrame> {
        Ok(self.axes().of_view(self.source.camera()?.is_view()))
    }

    /// The same of a camera whose intrinsics are known.
    pub fn axes(&self) -> CameraFrame {
        match self.is_as(ForeignFormat::Fictrac) {
            true => CameraFrame::Optical,
            false => self.frame,
        }
    }
}
