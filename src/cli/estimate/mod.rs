//! `spindoe estimate`: from images to orientations, and with times to the spin.

mod arguments;
mod asked;
pub(super) mod balls;
pub(super) mod format;
mod output;
#[cfg(feature = "plot")]
mod overlay;
#[cfg(feature = "plot")]
mod page;
pub(super) mod painted;
mod rig;
pub(super) mod verdict;
#[cfg(feature = "plot")]
mod video;
pub(super) mod written;

use std::io::Write;

use clap::ArgMatches;

use super::inputs::{self, Counting};
use crate::calibrate::{CalibrationConfig, calibrate};
use crate::clip::{
    self, BallEstimate, Batch, BatchConfig, BatchFrame, BatchObserver, SequenceEvidence,
    SequenceRows, SequenceSmears, Strobe, Work,
};
use crate::error::{Error, Result};
use crate::files;
use crate::geometry::CameraFrame;
use crate::image::RgbImage;
use crate::vision::{Estimator, FrameEstimate};
pub use arguments::Arguments;
use arguments::AskedBall;
pub(super) use arguments::check_painted;
pub(super) use asked::{Asked, SportPreset};
use output::SequenceReport;

/// Keeps the pictures that overlays need.
struct Pictures {
    #[cfg_attr(not(feature = "plot"), allow(dead_code))]
    wanted: bool,
}

/// A picture, with the corner at which it was cropped.
type Picture = Option<(RgbImage, usize, usize)>;

impl BatchObserver for Pictures {
    type Kept = Picture;

    #[cfg(feature = "plot")]
    fn keep(&self, image: &RgbImage, balls: &[BallEstimate]) -> Result<Picture> {
        overlay::picture(image, balls.iter().filter_map(BallEstimate::circle)).map(Some)
    }

    #[cfg(not(feature = "plot"))]
    fn keep(&self, _: &RgbImage, _: &[BallEstimate]) -> Result<Picture> {
        Ok(None)
    }

    fn wants_images(&self) -> bool {
        self.wanted
    }
}

pub fn run(arguments: &Arguments, given: Option<&ArgMatches>) -> Result<()> {
    let asked = &arguments.asked;
    if let Some(rig) = &arguments.rig {
        return rig::run(arguments, rig);
    }
    let shown = arguments.shown(given)?;
    asked.source.settle_camera(&arguments.images, None)?;
    if let AskedBall::Painted(surface) = &shown {
        return painted::run(arguments, surface.as_ref());
    }
    asked.check()?;
    arguments.check_numbers()?;
    let strobe = balls::strobe(asked)?;
    let mut estimators = asked.estimators(arguments.exposure_ms.is_some())?;
    let several = balls::estimator(asked, &estimators, strobe.as_ref())?;
    let config = arguments.batch()?;
    let wanted = arguments.wants_pictures();
    // What cannot be written is known before the work.
    #[cfg(feature = "plot")]
    let overlay = arguments
        .overlay
        .as_deref()
        .map(overlay::OverlayTarget::new);
    #[cfg(feature = "plot")]
    let overlay = overlay.transpose()?;
    let file = arguments.output.as_deref().map(files::OutputFile::create);
    let file = file.transpose()?;
    let pictures = Counting::new(&arguments.images, Pictures { wanted });
    let work = match &several {
        Some(several) => Work::Balls(several, strobe.as_ref()),
        None => Work::Poses(&estimators),
    };
    let mut batch = clip::run(work, &arguments.images, &config, &pictures)?;
    pictures.finish();
    inputs::say_names(&batch, &config)?;
    let table = batch.judgment.table;
    if arguments.calibrate {
        let chosen = &mut estimators[table];
        *chosen = calibrate_in_place(arguments, chosen, &config, &pictures, &mut batch)?;
    }
    let so = "every frame is estimated independently";
    inputs::say_not_increasing(&batch, &arguments.images, so);
    let written = WrittenClip {
        arguments,
        batch: &batch,
        #[cfg(feature = "plot")]
        overlay,
        file,
    };
    match several {
        Some(_) => written.all_balls(&estimators, strobe.as_ref()),
        None => written.one_ball(&estimators[table], &config),
    }
}

/// A clip, and where what is found of it is written.
struct WrittenClip<'a> {
    arguments: &'a Arguments,
    batch: &'a Batch<Picture>,
    #[cfg(feature = "plot")]
    overlay: Option<overlay::OverlayTarget>,
    file: Option<files::OutputFile>,
}

impl WrittenClip<'_> {
    fn all_balls(self, estimators: &[Estimator], strobe: Option<&Strobe>) -> Result<()> {
        let (arguments, batch) = (self.arguments, self.batch);
        let asked = &arguments.asked;
        let report = balls::BallsReport::new(asked, batch, strobe, arguments.motion)?;
        #[cfg(feature = "plot")]
        if let Some(target) = self.overlay {
            let frame = |k: usize| report.drawn(k, estimators);
            target.draw(&batch.times, batch.frames.len(), frame)?;
        }
        let text = report.text()?;
        #[cfg(feature = "plot")]
        if let Some(path) = &arguments.report {
            page::write_balls(path, estimators, batch, &report)?;
        }
        arguments.write(self.file, &text, || report.to_json())?;
        report.say();
        asked.say_format()?;
        arguments.answered(report.no_answer())
    }

    fn one_ball(self, estimator: &Estimator, config: &BatchConfig) -> Result<()> {
        let (arguments, batch) = (self.arguments, self.batch);
        let asked = &arguments.asked;
        let frame = asked.frame()?;
        let smears = arguments.smears(estimator, frame, batch);
        let named = batch.named();
        let row_s = config.row_s(&batch.frames);
        let rows = SequenceRows::new(estimator, row_s, &named, frame);
        let evidence = SequenceEvidence {
            smears: smears.as_ref(),
            rows: rows.as_ref(),
        };
        let report = SequenceReport::new(arguments, frame, batch, &evidence);
        // Rows that another program's format refuses leave nothing written.
        let text = report.rows().text()?;
        #[cfg(feature = "plot")]
        if let Some(target) = self.overlay {
            let frame = |k: usize| overlay::one_ball(estimator, &batch.frames[k]);
            target.draw(&batch.times, batch.frames.len(), frame)?;
        }
        #[cfg(feature = "plot")]
        if let Some(path) = &arguments.report {
            page::write(path, estimator, batch, &report)?;
        }
        arguments.write(self.file, &text, || report.to_json())?;
        report.say();
        asked.say_format()?;
        arguments.answered(report.no_answer())
    }
}

/// The second pass: the ball is calibrated on the frames, which are then estimated again with its own
/// pattern. A clip that cannot be calibrated keeps the estimates of the first, and that is said.
fn calibrate_in_place(
    arguments: &Arguments,
    estimator: &Estimator,
    config: &BatchConfig,
    pictures: &Counting<Pictures>,
    batch: &mut Batch<Picture>,
) -> Result<Estimator> {
    let frames = batch.frames.iter().map(BatchFrame::estimate);
    let frames: Vec<FrameEstimate> = frames.cloned().collect();
    let times = batch.times_s();
    let settings = CalibrationConfig {
        estimator: *estimator.config(),
        ..CalibrationConfig::default()
    };
    let found = calibrate(estimator.pattern(), &frames, times.as_deref(), &settings)?;
    let calibration = match found {
        Ok(calibration) => calibration,
        Err(rejection) => {
            errln!("note: not calibrated: {rejection}");
            return Ok(estimator.clone());
        }
    };
    let ball = calibration.ball(Some(estimator.pattern().sha256()))?;
    // It is as large as it was designed.
    let ball = ball.with_design(estimator.ball().design().cloned())?;
    let measures_blur = arguments.exposure_ms.is_some();
    let calibrated = arguments.asked.estimator(&ball, measures_blur)?;
    for (frame, estimate) in batch.frames.iter_mut().zip(calibration.frames) {
        frame.set_estimate(estimate);
    }
    batch.estimate_again(&calibrated, config, pictures)?;
    Ok(calibrated)
}

impl Arguments {
    /// Writes the rows to the file where there is one, and what standard output has: JSON where it is asked for, else the rows that no
    /// file has.
    fn write(
        &self,
        file: Option<files::OutputFile>,
        rows: &str,
        json: impl FnOnce() -> serde_json::Value,
    ) -> Result<()> {
        if let (Some(mut file), Some(path)) = (file, &self.output) {
            file.write_all(rows.as_bytes())
                .map_err(|e| Error::write(path, e))?;
            file.finish()?;
        }
        match (self.json, &self.output) {
            (true, _) => super::print_json(&json()),
            (false, None) => super::write_stdout(rows.as_bytes()),
            (false, Some(_)) => Ok(()),
        }
    }

    /// Refuses where there is a reason why nothing is answered.
    fn answered(&self, no_answer: Option<String>) -> Result<()> {
        match no_answer {
            None => Ok(()),
            Some(reason) => Err(Error::NoAnswer {
                path: inputs::named(&self.images),
                reason,
            }),
        }
    }

    /// The smears of the frames that have times, for spins in `frame`.
    fn smears(
        &self,
        estimator: &Estimator,
        frame: CameraFrame,
        batch: &Batch<Picture>,
    ) -> Option<SequenceSmears> {
        let exposure_s = 1e-3 * self.exposure_ms?;
        SequenceSmears::new(estimator, &batch.named(), exposure_s, frame)
    }
}
