//! How much of a calibration's evaluation is done, for who waits for it.

use std::sync::{Mutex, PoisonError};

use crate::view::ProtocolName;

/// What the parts of an evaluation take on one core, ms, of a clip of 60 frames of `dots20`: each frame held out, each trial, and of the dots
/// as a set each trial and all else. Only their ratios matter, for the time left.
const FRAME_MS: f64 = 40.0;
const TRIAL_MS: f64 = 0.04;
const SET_MS: (f64, f64) = (3.4, 3400.0);

/// How much of an evaluation is done.
pub(super) struct EvaluationWork<'a> {
    total_ms: f64,
    done_ms: Mutex<f64>,
    says: &'a (dyn Fn(f64) + Sync),
}

impl<'a> EvaluationWork<'a> {
    pub fn new(frames: usize, samples: u64, says: &'a (dyn Fn(f64) + Sync)) -> Self {
        let runs = 3 * ProtocolName::ALL.len();
        let trials = match samples {
            0 => 0.0,
            n => n as f64 * (TRIAL_MS * runs as f64 + SET_MS.0) + SET_MS.1,
        };
        Self {
            total_ms: FRAME_MS * frames as f64 + trials,
            done_ms: Mutex::new(0.0),
            says,
        }
    }

    /// So many more frames are judged.
    pub fn frames(&self, more: usize) {
        self.add(FRAME_MS * more as f64);
    }

    /// So many more trials are done.
    pub fn trials(&self, more: u64) {
        self.add(TRIAL_MS * more as f64);
    }

    fn add(&self, more_ms: f64) {
        let mut done_ms = self.done_ms.lock().unwrap_or_else(PoisonError::into_inner);
        *done_ms += more_ms;
        (self.says)((*done_ms / self.total_ms).min(1.0));
    }
}
