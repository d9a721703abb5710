//! `spindoe report`: the folder of a design or a calibration as one page to look at.

use std::path::PathBuf;

use clap::Args;

#[cfg(feature = "plot")]
use super::output::one_of;
use crate::error::{Error, Result, require};
use crate::files::Replacement;
#[cfg(feature = "vision")]
use crate::report::page::CalibrationPage;
use crate::report::page::{CameraFigures, DesignPage, PAGE};
#[cfg(feature = "plot")]
use crate::report::plots::PictureFormat;

#[derive(Debug, Args)]
#[command(after_help = "\
The page shows the ball and the stencil to turn, rates with their intervals, sensitivity with a mark at your
camera's noise, what the camera can expect, the search, the dots, print settings and the command that repeats
the design. It is one file and needs no network; the browser's print makes a PDF of it.

The page of a calibration shows each dot where it was drawn and where it should be, how well that is known,
residuals and rates with the nominal table and with its own, and what to do.

`spindoe design` and `spindoe calibrate` write the same pages. `spindoe validate A B -o DIR` and `spindoe estimate
--report FILE` write pages of their own.

Example:
  spindoe report my-ball --ball-px 45 --fps 380")]
pub struct Arguments {
    /// A folder that `spindoe design` or `spindoe calibrate` wrote.
    dir: PathBuf,
    /// Diameter of the ball in your camera's image, pixels.
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    ball_px: Option<f64>,
    /// Error of a detected dot per image axis, pixels.
    #[arg(hide = true, long, value_name = "PX", allow_negative_numbers = true)]
    pixel_noise: Option<f64>,
    /// Frames per second.
    #[arg(long, value_name = "F", allow_negative_numbers = true)]
    fps: Option<f64>,
    /// Frames from which a spin is estimated.
    #[arg(hide = true, long, value_name = "N")]
    frames: Option<usize>,
    /// Draw a design's ball, features, rates and search into the folder too, in these formats.
    #[cfg(feature = "plot")]
    #[arg(long, value_name = "png,svg", value_delimiter = ',', value_parser = one_of(&PictureFormat::ALL, PictureFormat::as_str))]
    pictures: Vec<PictureFormat>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let dir = &arguments.dir;
    if !dir.join("report.json").exists() {
        return Err(Error::input(
            dir,
            "report.json",
            "expected a folder that `spindoe design` or `spindoe calibrate` wrote",
        ));
    }
    #[cfg(feature = "vision")]
    if CalibrationPage::is_in(dir)? {
        arguments.reject_camera()?;
        let page = CalibrationPage::read(dir)?;
        let set = Replacement::begin(dir)?;
        page.write(set.path())?;
        set.publish(&[], PAGE)?;
        outln!("{}", dir.join(PAGE).display());
        return Ok(());
    }
    let mut page = DesignPage::read(dir)?;
    arguments.apply(page.camera_mut())?;
    let set = Replacement::begin(dir)?;
    page.write(set.path())?;
    #[cfg(feature = "plot")]
    if !arguments.pictures.is_empty() {
        crate::report::plots::redraw(dir, set.path(), &arguments.pictures)?;
    }
    set.publish(&[], PAGE)?;
    outln!("{}", dir.join(PAGE).display());
    Ok(())
}

impl Arguments {
    /// Rejects what only a design's page shows.
    #[cfg(feature = "vision")]
    fn reject_camera(&self) -> Result<()> {
        for (name, given) in [
            ("ball_px", self.ball_px.is_some()),
            ("pixel_noise", self.pixel_noise.is_some()),
            ("fps", self.fps.is_some()),
            ("frames", self.frames.is_some()),
            #[cfg(feature = "plot")]
            ("pictures", !self.pictures.is_empty()),
        ] {
            if given {
                let problem = "the folder holds a calibration, whose page shows no camera and has no such pictures";
                return Err(Error::argument(name, problem));
            }
        }
        Ok(())
    }

    /// Sets the values that were given.
    fn apply(&self, camera: &mut CameraFigures) -> Result<()> {
        for (name, given, low, field) in [
            ("ball_px", self.ball_px, 4.0, &mut camera.pixels),
            ("pixel_noise", self.pixel_noise, 0.01, &mut camera.noise),
            ("fps", self.fps, 1.0, &mut camera.rate),
        ] {
            if let Some(value) = given {
                let inside = value.is_finite() && value >= low;
                require(inside, name, &format!("at least {low}"), value)?;
                *field = value;
            }
        }
        if let Some(frames) = self.frames {
            require(frames >= 3, "frames", "at least 3", frames)?;
            camera.frames = frames;
        }
        Ok(())
    }
}
