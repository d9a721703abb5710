//! Where one constant spin holds within a sequence, and the spin over time: in words, as tables, as JSON.

use std::cell::OnceCell;
use std::fmt::Write;
use std::path::Path;

use serde_json::{Value, json};

use crate::error::Result;
use crate::files;
use crate::geometry::{CameraFrame, Rotation, Vec3};
use crate::spin::decay::{DecayOutcome, fit_decay};
use crate::spin::estimate::MotionModel;
use crate::spin::robust::{SpinConfig, standard_deviations};
use crate::spin::windows::{Stretch, WindowFit, constant_stretches};
use crate::spin::{Fit, Measurement, SpinRejection};

/// Stretches that are named in words, the longest.
const NAMED: usize = 3;

/// The stretches of a sequence, found once they are asked for.
pub(super) struct Holding<'a> {
    measurements: &'a [Measurement],
    config: &'a SpinConfig,
    found: OnceCell<std::result::Result<Vec<Stretch>, SpinRejection>>,
}

impl<'a> Holding<'a> {
    pub fn new(measurements: &'a [Measurement], config: &'a SpinConfig) -> Self {
        Self {
            measurements,
            config,
            found: OnceCell::new(),
        }
    }

    /// The stretches in the order of time.
    pub fn stretches(&self) -> std::result::Result<&[Stretch], SpinRejection> {
        let find = || constant_stretches(self.measurements, self.config);
        match self.found.get_or_init(find) {
            Ok(stretches) => Ok(stretches),
            Err(rejection) => Err(*rejection),
        }
    }

    /// Orientations within the stretches.
    fn held(&self) -> usize {
        let stretches = self.stretches().unwrap_or_default();
        stretches.iter().map(|s| s.orientations.len()).sum()
    }

    /// Whether several spins, one after another, hold where this one is that of a minority.
    pub fn contradicts(&self, fit: &Fit) -> bool {
        2 * fit.inliers < self.measurements.len() && self.held() > fit.inliers
    }

    /// What holds instead of one spin of the motion that was tried, the beginning of a reason's end; nothing where nothing does.
    pub fn words(&self, tried: MotionModel) -> String {
        let mut words = String::new();
        if tried == MotionModel::Constant
            && let Ok(DecayOutcome::Found { .. }) = fit_decay(self.measurements, self.config)
        {
            words += "; a decaying spin holds (--motion decaying)";
        }
        let mut stretches = self.stretches().unwrap_or_default().to_vec();
        if stretches.is_empty() {
            return words;
        }
        stretches.sort_by_key(|s| std::cmp::Reverse(s.orientations.len()));
        let named = stretches.iter().take(NAMED).map(|s| {
            let (from, to) = times_s(self.measurements, s);
            format!("{from:.3} to {to:.3} s at {:.2} rps", s.fit.motion.rps())
        });
        let named: Vec<String> = named.collect();
        words
            + &format!(
                "; constant spins hold over {} stretches with {} of {} orientations (--stretches), the longest: {}",
                stretches.len(),
                self.held(),
                self.measurements.len(),
                named.join(", ")
            )
    }
}

/// Writes stretches as a table; the spins turned into that frame.
pub(super) fn write(
    path: &Path,
    measurements: &[Measurement],
    stretches: &[Stretch],
    (frame, turn): &(CameraFrame, Rotation),
) -> Result<()> {
    let mut text =
        String::from("from_s,to_s,orientations,inliers,rps,wx,wy,wz,sigma_deg,camera_frame\n");
    for stretch in stretches {
        let (from, to) = times_s(measurements, stretch);
        let fit = stretch.fit.turned(turn);
        let spin = fit.motion.spin;
        let sigma = fit.sigma_rad.map(|s| s.to_degrees().to_string());
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{from},{to},{},{},{},{},{},{},{},{frame}",
            stretch.orientations.len(),
            fit.inliers,
            fit.motion.rps(),
            spin.x,
            spin.y,
            spin.z,
            sigma.unwrap_or_default()
        );
    }
    files::write_bytes(path, text.as_bytes())
}

/// The times of the first and the last orientation of a stretch, seconds.
fn times_s(measurements: &[Measurement], stretch: &Stretch) -> (f64, f64) {
    let [first, last] = [stretch.orientations.start, stretch.orientations.end - 1];
    (measurements[first].time_s, measurements[last].time_s)
}

/// Stretches as JSON, the spins turned.
pub(super) fn to_json(
    measurements: &[Measurement],
    stretches: &[Stretch],
    (frame, turn): &(CameraFrame, Rotation),
) -> Value {
    let one = |stretch: &Stretch| {
        let (from, to) = times_s(measurements, stretch);
        let fit = stretch.fit.turned(turn);
        json!({
            "from_s": from,
            "to_s": to,
            "orientations": stretch.orientations.len(),
            "inliers": fit.inliers,
            "rps": fit.motion.rps(),
            "spin_rad_s": fit.motion.spin.as_slice(),
            "sigma_deg": fit.sigma_rad.map(f64::to_degrees),
            "camera_frame": frame,
        })
    };
    stretches.iter().map(one).collect()
}

/// Standard deviations of a fit's spin, rad/s; none where the orientations leave it open.
fn deviations(fit: &Fit) -> Option<Vec3> {
    fit.spin_covariance.as_ref().map(standard_deviations)
}

/// Writes the spins of runs of so many `frames` as a table; the spins turned.
pub(super) fn write_windows(
    path: &Path,
    windows: &[WindowFit],
    frames: usize,
    (frame, turn): &(CameraFrame, Rotation),
) -> Result<()> {
    let mut text =
        String::from("time_s,wx,wy,wz,rps,std_x,std_y,std_z,inliers,frames,camera_frame\n");
    for window in windows {
        let fit = window.fit.turned(turn);
        let [x, y, z] = fit.motion.spin.into();
        let std = deviations(&fit).map_or(",,".to_owned(), |s| format!("{},{},{}", s.x, s.y, s.z));
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{},{x},{y},{z},{},{std},{},{frames},{frame}",
            window.time_s,
            fit.motion.rps(),
            fit.inliers
        );
    }
    files::write_bytes(path, text.as_bytes())
}

/// The spins of runs of so many `frames` as JSON, turned.
pub(super) fn windows_to_json(
    windows: &[WindowFit],
    frames: usize,
    (frame, turn): &(CameraFrame, Rotation),
) -> Value {
    let one = |window: &WindowFit| {
        let fit = window.fit.turned(turn);
        json!({
            "time_s": window.time_s,
            "spin_rad_s": fit.motion.spin.as_slice(),
            "rps": fit.motion.rps(),
            "std_rad_s": deviations(&fit).map(<[f64; 3]>::from),
            "inliers": fit.inliers,
            "frames": frames,
            "camera_frame": frame,
        })
    };
    windows.iter().map(one).collect()
}
