//! A ball without a table while it is filmed: what of it is shown so far, and whether that is enough.
//!
//! Frames are looked at as they come; the clip so far is surveyed ([`survey`]) in a thread of its own, again whenever it has grown by a
//! quarter, so that the surveys together cost no more than a few times the last one.

use std::thread::JoinHandle;

use super::config::CalibrationConfig;
use super::identify::identify_frames;
use super::result::Calibration;
use super::unknown::{
    BuiltPattern, KnownDots, SurfaceObserver, Survey, UnknownRejection, calibrate_built, survey,
};
use crate::ball::Ball;
use crate::error::{Error, Result};
use crate::image::Picture;
use crate::surface::PaintedFrame;
use crate::vision::estimator::EstimatorWorkspace;
use crate::vision::{Estimator, FrameEstimate, Prior};

/// Frames before the first survey, and by how much the clip grows between two.
const FIRST: usize = 30;
const GROWTH: f64 = 1.25;
/// The longest clip: two minutes at 30 frames a second, 60 MB of a ball of 100 pixels, 400 MB at most.
pub const MAX_FRAMES: usize = 3600;

/// A clip that grows.
pub struct LiveClip {
    estimator: Estimator,
    workspace: EstimatorWorkspace,
    config: CalibrationConfig,
    known: KnownDots,
    frames: Vec<FrameEstimate>,
    shown: Vec<PaintedFrame>,
    times_s: Vec<f64>,
    /// The survey at work.
    at_work: Option<JoinHandle<Result<Survey>>>,
    /// Frames of the last survey.
    surveyed: usize,
}

/// A clip that is enough.
#[derive(Debug, Clone)]
pub struct LivePattern {
    /// The pattern.
    pub built: BuiltPattern,
    /// Its calibration by these frames.
    pub calibration: Calibration,
    /// The clip's frames, identified with it.
    pub frames: Vec<FrameEstimate>,
    /// Their times.
    pub times_s: Vec<f64>,
}

impl LiveClip {
    /// A clip without frames yet. The estimator's pattern stands in for the ball's: only its detections are used.
    pub fn new(estimator: Estimator, known: KnownDots, config: CalibrationConfig) -> Self {
        Self {
            workspace: estimator.workspace(),
            estimator,
            config,
            known,
            frames: Vec::new(),
            shown: Vec::new(),
            times_s: Vec::new(),
            at_work: None,
            surveyed: 0,
        }
    }

    /// Frames of the ball so far.
    pub fn frames(&self) -> usize {
        self.frames.len()
    }

    /// Whether it has [`MAX_FRAMES`] frames of the ball and takes no more.
    pub fn is_full(&self) -> bool {
        self.frames.len() >= MAX_FRAMES
    }

    /// Takes a frame in, and begins a survey where one is due. Frames without a ball leave nothing.
    ///
    /// # Errors
    /// A picture that cannot be read; [`Error::Argument`] for a clip that is full.
    pub fn push(&mut self, picture: &Picture, prior: &Prior, time_s: f64) -> Result<()> {
        let problem = "expected at most 3600 frames that show the ball";
        if self.is_full() {
            return Err(Error::argument("picture", problem));
        }
        let mut found = FrameEstimate::default();
        let budget = SurfaceObserver::budget();
        let workspace = &mut self.workspace;
        self.estimator
            .estimate(picture.view()?, prior, &budget, workspace, &mut found);
        let Some(outline) = found.outline else {
            return Ok(());
        };
        let gray = picture.to_rgb()?.to_gray();
        self.shown.push(PaintedFrame::take(&gray, &outline));
        self.frames.push(found);
        self.times_s.push(time_s);
        let due = FIRST.max((GROWTH * self.surveyed as f64) as usize);
        if self.at_work.is_none() && self.frames.len() >= due {
            self.surveyed = self.frames.len();
            let (frames, shown) = (self.frames.clone(), self.shown.clone());
            let (known, config) = (self.known.clone(), self.config.clone());
            let work = std::thread::Builder::new()
                .spawn(move || survey(&frames, &shown, &known, &config))
                .map_err(|e| Error::Internal(format!("no thread for a survey: {e}")))?;
            self.at_work = Some(work);
        }
        Ok(())
    }

    /// Whether a survey is at work.
    pub fn is_at_work(&self) -> bool {
        self.at_work.is_some()
    }

    /// The survey that has ended since the last call, if one has.
    ///
    /// # Errors
    /// As [`survey`].
    pub fn poll(&mut self) -> Result<Option<Survey>> {
        match self.at_work.take_if(|work| work.is_finished()) {
            Some(work) => join(work).map(Some),
            None => Ok(None),
        }
    }

    /// A survey of all frames.
    ///
    /// # Errors
    /// As [`survey`].
    pub fn finish(&mut self) -> Result<Survey> {
        if let Some(work) = self.at_work.take() {
            let survey = join(work)?;
            if survey.frames == self.frames.len() {
                return Ok(survey);
            }
        }
        survey(&self.frames, &self.shown, &self.known, &self.config)
    }

    /// The pattern that a survey has built, where a calibration by all frames so far confirms it; else why it does not.
    ///
    /// # Errors
    /// As [`calibrate_built`].
    pub fn confirm(
        &self,
        built: BuiltPattern,
    ) -> Result<std::result::Result<LivePattern, UnknownRejection>> {
        let ball = Ball::new(built.pattern.clone());
        let frames = identify_frames(&ball, &self.config.estimator, &self.frames)?;
        let times = Some(&self.times_s[..]);
        let found = calibrate_built(&built, &frames, &self.shown, times, &self.config)?;
        Ok(found.map(|calibration| LivePattern {
            built,
            calibration,
            frames,
            times_s: self.times_s.clone(),
        }))
    }
}

fn join(work: JoinHandle<Result<Survey>>) -> Result<Survey> {
    let ended = work.join();
    ended.map_err(|_| Error::Internal("the survey of the clip has failed".to_owned()))?
}
