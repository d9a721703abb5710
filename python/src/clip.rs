//! Clips in memory and in files: both go through the library's one pipeline.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use spindoe::Error;
use spindoe::clip::{BallEstimate, BatchConfig, BatchFrame, BatchObserver, FocalDoubt, Judgment};
use spindoe::image::{Picture, RawPixel, RgbImage, Roi};
use spindoe::source::files::SourceList;
use spindoe::source::held::{HeldFrames, HeldPictures};

use crate::errors::{OrRaise, value_error, warn};
use crate::estimator::{check_times, outline, sequence_config};
use crate::image::{Copied, Pixels, raw_pixel};
use crate::work::abandonable;

/// Frames between two calls of `progress`.
const FRAMES_AT_ONCE: usize = 64;

/// What is asked of a clip, by Python's keywords.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Asked {
    circle: Option<[f64; 3]>,
    /// Left, top, width, height.
    roi: Option<[usize; 4]>,
    mirrored: bool,
    independent: bool,
    judge: bool,
    readout_s: f64,
    max_rps: f64,
}

impl Asked {
    /// The library's settings.
    pub fn config(&self) -> PyResult<BatchConfig> {
        if !(self.readout_s >= 0.0 && self.readout_s.is_finite()) {
            let problem = format!(
                "expected a number of seconds of 0 or more, found {}",
                self.readout_s
            );
            return Err(value_error("readout_s", problem));
        }
        Ok(BatchConfig {
            outline: outline(self.circle)?,
            roi: self.roi.map(|[left, top, width, height]| Roi {
                left,
                top,
                width,
                height,
            }),
            mirrored: self.mirrored,
            independent: self.independent,
            verdict: self.judge,
            readout_s: self.readout_s,
            sequence: sequence_config(self.max_rps)?,
            ..BatchConfig::default()
        })
    }
}

/// Python's arrays, which outlive the call.
struct Images {
    images: Vec<Py<PyAny>>,
    pixel: RawPixel,
    /// Set where nobody waits for them any more.
    ended: Arc<AtomicBool>,
}

impl HeldPictures for Images {
    fn count(&self) -> usize {
        self.images.len()
    }

    fn picture(&self, number: usize) -> spindoe::Result<Picture> {
        if self.ended.load(Ordering::Relaxed) {
            return Err(Error::Stopped);
        }
        let copied = Python::attach(|py| {
            let pixels = Pixels::new("images", self.images[number].bind(py))?;
            let mut copied = Copied::default();
            pixels.samples("images", self.pixel)?.copy_to(&mut copied);
            Ok(copied)
        });
        let copied = copied.map_err(|e: PyErr| Error::argument("images", e.to_string()))?;
        copied.into_picture()
    }
}

/// Counts frames, and reports them to Python's `progress`.
#[derive(Default)]
pub struct Listener {
    heard: Option<Py<PyAny>>,
    done: AtomicUsize,
    total: usize,
    raised: Mutex<Option<PyErr>>,
    ended: Arc<AtomicBool>,
}

impl Listener {
    /// Counts one frame more.
    pub fn count(&self) {
        let done = 1 + self.done.fetch_add(1, Ordering::Relaxed);
        // Frames that are read once more were reported.
        let is_due = done.is_multiple_of(FRAMES_AT_ONCE) || done == self.total;
        let Some(heard) = self.heard.as_ref().filter(|_| is_due && done <= self.total) else {
            return;
        };
        if let Err(error) = Python::attach(|py| heard.call1(py, (done, self.total))) {
            let mut raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner);
            raised.get_or_insert(error);
            self.ended.store(true, Ordering::Relaxed);
        }
    }
}

impl BatchObserver for Listener {
    type Kept = ();

    fn keep(&self, _: &RgbImage, _: &[BallEstimate]) -> spindoe::Result<()> {
        Ok(())
    }

    fn wants_images(&self) -> bool {
        false
    }

    fn progress(&self, _: &[BatchFrame]) {
        self.count();
    }
}

/// The clips of one camera or several, and where their progress is reported.
pub struct Clips {
    pub listed: Vec<SourceList>,
    listener: Listener,
}

impl Clips {
    /// Of arrays, one list a camera, with their times.
    pub fn held(
        images: &[Vec<Bound<'_, PyAny>>],
        color: &str,
        times_s: Option<&[Vec<f64>]>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let pixel = raw_pixel(color)?;
        let ended = Arc::new(AtomicBool::new(false));
        let one = |(camera, images): (usize, &Vec<Bound<'_, PyAny>>)| -> PyResult<SourceList> {
            for (k, image) in images.iter().enumerate() {
                let name = format!("images[{k}]");
                Pixels::new(&name, image)?.samples(&name, pixel)?;
            }
            let held = HeldFrames::new(Images {
                images: images.iter().map(|image| image.clone().unbind()).collect(),
                pixel,
                ended: Arc::clone(&ended),
            });
            let held = match times_s.and_then(|times| times.get(camera)) {
                Some(times) => {
                    check_times(times, images.len())?;
                    held.at(times).or_raise()?
                }
                None => held,
            };
            Ok(SourceList::from(held))
        };
        let listed = images.iter().enumerate().map(one);
        Ok(Self {
            listed: listed.collect::<PyResult<_>>()?,
            listener: Listener {
                heard: progress,
                total: images.iter().map(Vec::len).sum(),
                ended,
                ..Listener::default()
            },
        })
    }

    /// Of one camera's arrays.
    pub fn one(
        images: Vec<Bound<'_, PyAny>>,
        color: &str,
        times_s: Option<Vec<f64>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let times_s = times_s.map(|times| vec![times]);
        Self::held(&[images], color, times_s.as_deref(), progress)
    }

    /// Of files.
    pub fn files(listed: SourceList) -> Self {
        Self {
            listed: vec![listed],
            listener: Listener::default(),
        }
    }

    /// Does the library's work on them, on its pool; Ctrl-C and what `progress` raises end it.
    pub fn run<T: Send + 'static>(
        self,
        py: Python<'_>,
        mut config: BatchConfig,
        work: impl FnOnce(&[SourceList], &BatchConfig, &Listener) -> spindoe::Result<T> + Send + 'static,
    ) -> PyResult<T> {
        abandonable(py, move |stop| {
            (config.budget.stop, config.sequence.stop) = (Some(stop), Some(stop));
            let found = work(&self.listed, &config, &self.listener);
            let raised = self.listener.raised.into_inner();
            match raised.unwrap_or_else(PoisonError::into_inner) {
                Some(error) => Err(error),
                None => found.or_raise(),
            }
        })?
    }
}

/// Warns where the outlines of a clip's balls contradict the camera.
pub fn warn_of(py: Python<'_>, doubt: Option<&FocalDoubt>) -> PyResult<()> {
    match doubt {
        Some(doubt) => warn(py, &format!("camera: {doubt}")),
        None => Ok(()),
    }
}

/// The verdict in a word, the table in use, ln of its odds; and of each hypothesis table, whether it is mirrored, frames, those that were
/// answered, whether they have a common motion, ln of the evidence for it.
pub type VerdictTuple = (
    &'static str,
    usize,
    Option<f64>,
    Vec<(usize, bool, usize, usize, bool, f64)>,
);

/// The judgment of a clip; none where none was asked for.
pub fn verdict_tuple(judgment: &Judgment) -> Option<VerdictTuple> {
    let hypotheses = judgment.hypotheses.iter().map(|h| {
        (
            h.table,
            h.is_mirrored,
            h.frames.len(),
            h.answered(),
            h.has_common_motion,
            h.ln_evidence(),
        )
    });
    let hypotheses: Vec<_> = hypotheses.collect();
    (!hypotheses.is_empty()).then(|| {
        (
            judgment.as_str(),
            judgment.table,
            judgment.ln_odds(),
            hypotheses,
        )
    })
}
