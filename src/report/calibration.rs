//! The result of a calibration: the ball's own pattern and table, and what they are worth.
//!
//! The folder holds `pattern.csv` and `table.npz` of the ball as it is drawn, `report.json`,
//! `offsets.csv`, `report.html` and, where the crate is built with the feature `plot`, `offsets.png` and `dots.png`.

mod work;

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::ball::Ball;
use crate::calibrate::{
    Calibration, CalibrationConfig, DotState, HeldOut, MIN_EXPECTED_VIEWS, MarkedSurface,
    MotionResidual, SurfaceMark, held_out_with,
};
use crate::concurrency::StopFlag;
use crate::error::{Result, dots};
use crate::files;
use crate::geometry::{Vec3, angle_between, tangent_frame};
use crate::pattern::Pattern;
use crate::recognize::robust::RobustRecognizer;
use crate::report::dot_set::DotSetReport;
use crate::report::page::CalibrationPage;
use crate::validate::{Trials, Validation};
use crate::view::ProtocolName;
use crate::vision::FrameEstimate;
use work::EvaluationWork;

/// Version of a calibration's `report.json`.
pub const CALIBRATION_REPORT_VERSION: u32 = 4;
/// A dot whose standard deviation is larger needs more views, degrees.
pub(super) const WELL_MEASURED_DEG: f64 = 0.5;
/// Files by which a folder with a calibration is known.
pub const FILES: [&str; 4] = ["pattern.csv", "table.npz", "report.json", "offsets.csv"];

/// A dot of the nominal pattern in the report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DotReport {
    /// Its number in the nominal pattern.
    pub nominal_number: usize,
    /// Its number in the calibrated pattern; none where it is left out.
    pub number: Option<usize>,
    /// What the clip says of it.
    pub state: DotState,
    /// Where it should be.
    pub nominal: [f64; 3],
    /// Where it is.
    pub drawn: [f64; 3],
    /// Angle between the two, degrees.
    pub offset_deg: f64,
    /// Standard deviation per tangent axis, degrees.
    pub sigma_deg: f64,
    /// Frames that saw it.
    pub views: usize,
    /// Frames that it faced well.
    pub facing_frames: usize,
    /// Those of them that saw it.
    pub facing_views: usize,
    /// Those of them that should have, at a cautious estimate of the rate of the other dots.
    pub expected_views: f64,
    /// Its number in `marks.png`, of a ball without a table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mark: Option<usize>,
}

/// A mark in the report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MarkReport {
    /// Where it is, pattern frame.
    pub direction: [f64; 3],
    /// Frames that saw it, of those that it faced.
    pub found: usize,
    /// Frames that it faced.
    pub views: usize,
    /// Its number in the calibrated pattern, where it was taken in.
    pub number: Option<usize>,
    /// Its number in `marks.png`, of a ball without a table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mark: Option<usize>,
}

/// The frames of the clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FramesReport {
    /// Given.
    pub given: usize,
    /// That show a ball.
    pub with_ball: usize,
    /// That show more than one.
    pub with_other_balls: usize,
    /// Used by the fit.
    pub fitted: usize,
}

/// The rates of a protocol by Monte Carlo, all on the robust recognizer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProtocolReport {
    /// The protocol.
    pub protocol: ProtocolName,
    /// A ball drawn exactly as designed.
    pub nominal: Validation,
    /// This ball, identified as if it were drawn as designed.
    pub drawn_uncalibrated: Validation,
    /// This ball, identified with its own table.
    pub drawn_calibrated: Validation,
}

/// Everything that is reported of a calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibrationReport {
    /// [`CALIBRATION_REPORT_VERSION`].
    pub format_version: u32,
    /// The version of this crate.
    pub spindoe_version: String,
    /// The command that made it, where one did.
    pub command: Option<String>,
    /// SHA-256 of the nominal pattern; none where it was built from the clip alone.
    pub nominal_sha256: Option<String>,
    /// SHA-256 of the calibrated pattern.
    pub pattern_sha256: String,
    /// The frames.
    pub frames: FramesReport,
    /// The dots of the nominal pattern.
    pub dots: Vec<DotReport>,
    /// Steady marks that it lacks.
    pub marks: Vec<MarkReport>,
    /// Root mean square offset of the measured dots, degrees.
    pub rms_offset_deg: f64,
    /// Standard deviation of the detections over what the detector states.
    pub noise_scale: f64,
    /// Whether a smooth rotation was used.
    pub smooth: bool,
    /// Ball radii over the camera's distance, where that was fitted.
    pub inverse_distance: Option<f64>,
    /// Mean rate at which a dot is found that faces the camera well.
    pub detection_rate: f64,
    /// Nominal numbers of the dots that need more views, the worst first.
    pub more_views: Vec<usize>,
    /// Residuals of frames that took no part.
    pub held_out: HeldOut,
    /// Residual to one spin, with the nominal and with the calibrated pattern.
    pub motion: Option<[MotionResidual; 2]>,
    /// Rates by Monte Carlo; empty where none were asked for.
    pub monte_carlo: Vec<ProtocolReport>,
    /// Seed of the Monte Carlo trials.
    pub seed: u64,
    /// How good the dots are as a set; none where no trials were asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dot_set: Option<DotSetReport>,
    /// What to do, in words.
    pub advice: Vec<String>,
}

/// A calibrated ball with its report, ready to be written.
#[derive(Debug)]
pub struct CalibrationEvaluation {
    /// The ball as drawn.
    pub ball: Ball,
    /// The report.
    pub report: CalibrationReport,
}

/// What is measured beside the calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CalibrationEvaluationConfig {
    /// Monte Carlo trials for each protocol and pattern; 0 for none.
    pub samples: u64,
    /// Their seed.
    pub seed: u64,
    /// What ends them before, with an error.
    pub stop: Option<StopFlag>,
}

impl Default for CalibrationEvaluationConfig {
    /// 2 000 trials of seed 0.
    fn default() -> Self {
        Self {
            samples: 2000,
            seed: 0,
            stop: None,
        }
    }
}

/// What was calibrated: the arguments of [`crate::calibrate::calibrate`].
#[derive(Debug, Clone, Copy)]
pub struct CalibrationSource<'a> {
    /// The nominal pattern.
    pub nominal: &'a Pattern,
    /// Whether it is a design; else it was built from the clip alone.
    pub is_design: bool,
    /// The frames as first identified.
    pub frames: &'a [FrameEstimate],
    /// Their times, seconds.
    pub times_s: Option<&'a [f64]>,
    /// Angular radius of the dots that are drawn, radians, where it is known.
    pub dot_radius_rad: Option<f64>,
}

/// Evaluates a calibration.
///
/// # Errors
/// As [`held_out_with`] and [`Trials::run`](crate::validate::Trials::run).
pub fn evaluate_calibration(
    calibration: &Calibration,
    source: &CalibrationSource<'_>,
    config: &CalibrationConfig,
    evaluation: &CalibrationEvaluationConfig,
    done: &(dyn Fn(f64) + Sync),
) -> Result<CalibrationEvaluation> {
    let CalibrationSource {
        nominal,
        is_design,
        frames,
        times_s,
        dot_radius_rad,
    } = *source;
    let pattern = calibration.pattern()?;
    let nominal_sha256 = is_design.then(|| nominal.sha256());
    let ball = calibration.ball(nominal_sha256.clone())?;
    let dots = dot_reports(calibration);
    let work = EvaluationWork::new(frames.len(), evaluation.samples, done);
    let monte_carlo = match evaluation.samples {
        0 => Vec::new(),
        _ => monte_carlo(calibration, nominal, &pattern, evaluation, &work)?,
    };
    let trials = (evaluation.samples > 0).then_some((evaluation.samples, evaluation.seed));
    let dot_set = trials
        .map(|trials| DotSetReport::of(calibration, &pattern, dot_radius_rad, trials))
        .transpose()?;
    let mut report = CalibrationReport {
        format_version: CALIBRATION_REPORT_VERSION,
        spindoe_version: env!("CARGO_PKG_VERSION").to_owned(),
        command: None,
        nominal_sha256,
        pattern_sha256: pattern.sha256(),
        frames: FramesReport {
            given: frames.len(),
            with_ball: calibration.with_ball,
            with_other_balls: calibration.with_rivals,
            fitted: calibration.fitted,
        },
        marks: mark_reports(calibration),
        rms_offset_deg: calibration.rms_offset_rad().to_degrees(),
        noise_scale: calibration.noise_scale,
        smooth: calibration.smooth,
        inverse_distance: calibration.inverse_distance,
        detection_rate: calibration.detection_rate,
        more_views: more_views(&dots),
        dots,
        held_out: held_out_with(nominal, frames, times_s, config, &|n| work.frames(n))?,
        motion: times_s.and_then(|t| calibration.motion_residuals(frames, t)),
        monte_carlo,
        dot_set,
        seed: evaluation.seed,
        advice: Vec::new(),
    };
    let far_off: Vec<usize> = calibration.far_off().collect();
    report.advice = advice(&report, &far_off);
    Ok(CalibrationEvaluation { ball, report })
}

/// What is known of each dot.
fn dot_reports(calibration: &Calibration) -> Vec<DotReport> {
    let numbers = calibration.nominal_numbers();
    let number = |j: usize| numbers.iter().position(|n| *n == Some(j as u16));
    let dots = calibration.dots.iter().enumerate();
    dots.map(|(j, dot)| DotReport {
        nominal_number: j,
        number: number(j),
        state: dot.state,
        nominal: dot.nominal.into(),
        drawn: dot.direction.into(),
        offset_deg: dot.offset_rad().to_degrees(),
        sigma_deg: dot.sigma_rad().to_degrees(),
        views: dot.views,
        facing_frames: dot.facing_frames,
        facing_views: dot.facing_views,
        expected_views: dot.expected_views,
        mark: None,
    })
    .collect()
}

/// The marks that are none of the dots; those that are taken in have the numbers after theirs.
fn mark_reports(calibration: &Calibration) -> Vec<MarkReport> {
    let first = calibration.dots.len() - calibration.count(DotState::Missing);
    let marks = calibration.marks.iter().enumerate();
    marks
        .map(|(k, m)| MarkReport {
            direction: m.direction.into(),
            found: m.found,
            views: m.views,
            number: m.covariance.map(|_| first + k),
            mark: None,
        })
        .collect()
}

/// The dots that are not well measured, the worst first.
fn more_views(dots: &[DotReport]) -> Vec<usize> {
    let poor = |d: &&DotReport| {
        let may_be_seen = match d.state {
            DotState::Measured | DotState::Unseen => true,
            DotState::Doubtful => d.is_at_limb(),
            DotState::Missing => false,
        };
        may_be_seen && d.sigma_deg > WELL_MEASURED_DEG
    };
    let mut poor: Vec<&DotReport> = dots.iter().filter(poor).collect();
    poor.sort_by(|a, b| b.sigma_deg.total_cmp(&a.sigma_deg));
    poor.iter().map(|d| d.nominal_number).collect()
}

/// The rates of all protocols; trial by trial the same views of all three.
fn monte_carlo(
    calibration: &Calibration,
    nominal: &Pattern,
    drawn: &Pattern,
    evaluation: &CalibrationEvaluationConfig,
    work: &EvaluationWork<'_>,
) -> Result<Vec<ProtocolReport>> {
    let kept = |missing: bool| {
        let dots = calibration.dots.iter();
        dots.filter(move |d| (d.state == DotState::Missing) == missing)
    };
    // A table of the nominal pattern with the dots in the drawn pattern's order, so that their numbers
    // agree; those that are missing come last. Marks have no place in it.
    let on_ball = Pattern::new(kept(false).map(|d| d.direction).collect())?;
    let expected = kept(false).chain(kept(true)).map(|d| d.nominal);
    let expected = Pattern::new(expected.collect())?;
    let run = |ball: &Pattern, known: &Pattern, protocol: ProtocolName| -> Result<Validation> {
        let CalibrationEvaluationConfig { samples, seed, .. } = *evaluation;
        let mut trials = Trials::first(ball, protocol.view(), seed, samples);
        trials.stop = evaluation.stop.map(StopFlag::flag);
        let recognizer = RobustRecognizer::new(known, trials.view.into())?;
        let results = trials.run(&recognizer, &|n| work.trials(n))?;
        Ok(Validation::of(&results, protocol, &trials).untimed())
    };
    let of_protocol = |protocol| {
        Ok(ProtocolReport {
            protocol,
            nominal: run(nominal, nominal, protocol)?,
            drawn_uncalibrated: run(&on_ball, &expected, protocol)?,
            drawn_calibrated: run(drawn, drawn, protocol)?,
        })
    };
    ProtocolName::ALL.into_iter().map(of_protocol).collect()
}

/// Less than this share of the frames with a ball is used where some show another ball, or hardly any dots.
const EXPECTED_SHARE: f64 = 0.75;

/// Frames that took no part fit worse than by chance from this ratio of the medians on.
const WORSE: f64 = 1.1;

/// What to do, in words.
fn advice(report: &CalibrationReport, far_off: &[usize]) -> Vec<String> {
    let mut advice = Vec::new();
    let FramesReport {
        with_ball, fitted, ..
    } = report.frames;
    if (fitted as f64) < EXPECTED_SHARE * with_ball as f64 {
        advice.push(format!(
            "{} of the {with_ball} frames with a ball could not be used: look whether all show this ball, sharp and \
             not mirrored",
            with_ball - fitted
        ));
    }
    advice.extend(advice_on_dots(report, far_off));
    // What is built from the clip has no places that were meant.
    let is_design = report.nominal_sha256.is_some();
    if is_design {
        advice.extend(advice_on_drawing(&report.monte_carlo));
    }
    let held = &report.held_out;
    if held.frames.is_empty() {
        advice.push("too few frames to judge the calibration on others".to_owned());
    } else if is_design && held.median_deg[1] > WORSE * held.median_deg[0] {
        advice.push(
            "frames that took no part fit worse than before: the clip is too short, keep the nominal table"
                .to_owned(),
        );
    }
    advice
}

/// The dots that a person should look at, with what to do.
fn advice_on_dots(report: &CalibrationReport, far_off: &[usize]) -> Vec<String> {
    let numbers = |is: &dyn Fn(&DotReport) -> bool| -> Vec<usize> {
        let dots = report.dots.iter().filter(|d| is(d));
        dots.map(|d| d.nominal_number).collect()
    };
    let list = |numbers: &[usize]| {
        let words: Vec<String> = numbers.iter().map(usize::to_string).collect();
        words.join(", ")
    };
    let missing = numbers(&|d| d.state == DotState::Missing);
    let doubtful = numbers(&|d| d.state == DotState::Doubtful && !d.is_at_limb());
    let off_design = match report.nominal_sha256 {
        Some(_) => far_off,
        None => &[],
    };
    [
        (
            &report.more_views[..],
            "turn the ball so that these dots face the camera, and film again: ",
            list(&report.more_views),
        ),
        (
            &missing[..],
            "never found where they should be: ",
            dots(&missing),
        ),
        (
            &doubtful[..],
            "what is seen there may be print or a stain; look at ",
            dots(&doubtful),
        ),
        (
            off_design,
            "much farther from their places than the others: look whether these are the dots, or stains beside them: ",
            list(off_design),
        ),
    ]
    .into_iter()
    .filter(|(of, _, _)| !of.is_empty())
    .map(|(_, what, which)| format!("{what}{which}"))
    .collect()
}

/// Whether to draw the ball again.
fn advice_on_drawing(monte_carlo: &[ProtocolReport]) -> Option<String> {
    let is_worse = |p: &&ProtocolReport| p.drawn_calibrated.answered.high < p.nominal.answered.low;
    let worse = monte_carlo.iter().filter(is_worse);
    let worse: Vec<&str> = worse.map(|p| p.protocol.as_str()).collect();
    match worse.is_empty() {
        _ if monte_carlo.is_empty() => None,
        true => Some(
            "with its own table the ball is as good as one drawn exactly: drawing it again is not worth it"
                .to_owned(),
        ),
        false => Some(format!(
            "drawn as it is, the ball is identified less often than as designed ({}): draw it again where that matters",
            worse.join(", ")
        )),
    }
}

impl DotReport {
    /// Whether it never turned away from the limb.
    fn is_at_limb(&self) -> bool {
        self.expected_views < MIN_EXPECTED_VIEWS
    }

    /// Its offset to the north (towards +z along the meridian) and to the east, degrees.
    pub fn compass_deg(&self) -> [f64; 2] {
        let drawn = Vec3::from(self.drawn);
        compass(&Vec3::from(self.nominal)).map(|axis| axis.dot(&drawn).to_degrees())
    }
}

impl CalibrationEvaluation {
    /// Writes the folder's files to `dir`, each atomically.
    ///
    /// # Errors
    /// [`crate::Error::Write`] on an I/O failure.
    pub fn write(&self, dir: &Path) -> Result<()> {
        files::create_dir(dir)?;
        self.ball.write_csv(&dir.join("pattern.csv"))?;
        self.ball.write_npz(&dir.join("table.npz"))?;
        files::write_bytes(
            &dir.join("offsets.csv"),
            self.report.offsets_csv().as_bytes(),
        )?;
        #[cfg(feature = "plot")]
        {
            self.report.draw(&dir.join("offsets.png"))?;
            let dot_set = self.report.dot_set.as_ref();
            let add = dot_set.and_then(|set| set.add.as_ref());
            super::dot_set::draw(&dir.join("dots.png"), &self.ball, add)?;
        }
        super::folder::write_report(&dir.join(super::REPORT), &self.report)?;
        CalibrationPage::read(dir)?.write(dir)
    }
}

impl CalibrationReport {
    /// Notes which dots and marks have which numbers in `marks.png`, which shows `surface`.
    pub fn number_marks(&mut self, surface: &MarkedSurface) {
        let marks: Vec<&SurfaceMark> = surface.worth_a_look().collect();
        let number = |direction: [f64; 3]| {
            let off = |mark: &SurfaceMark| angle_between(&mark.direction, &direction.into());
            let nearest =
                (0..marks.len()).min_by(|a, b| off(marks[*a]).total_cmp(&off(marks[*b])))?;
            (off(marks[nearest]) < marks[nearest].radius_rad).then_some(nearest)
        };
        for dot in &mut self.dots {
            dot.mark = number(dot.drawn);
        }
        for mark in &mut self.marks {
            mark.mark = number(mark.direction);
        }
    }

    /// The offsets of the dots as CSV: along the meridian towards +z, and to the east of it.
    pub fn offsets_csv(&self) -> String {
        let mut text =
            "dot,number,state,offset_deg,north_deg,east_deg,sigma_deg,views,facing_frames,facing_views,expected_views\n"
                .to_owned();
        for dot in &self.dots {
            let [north, east] = dot.compass_deg();
            let number = dot.number.map_or(String::new(), |n| n.to_string());
            let state = dot.state.as_str();
            text += &format!(
                "{},{number},{state},{:.4},{north:.4},{east:.4},{:.4},{},{},{},{:.1}\n",
                dot.nominal_number,
                dot.offset_deg,
                dot.sigma_deg,
                dot.views,
                dot.facing_frames,
                dot.facing_views,
                dot.expected_views
            );
        }
        text
    }

    #[cfg(feature = "plot")]
    fn draw(&self, path: &Path) -> Result<()> {
        use crate::plot::{OffsetDot, OffsetMark, offset_views};
        let dots = self.dots.iter().map(|dot| OffsetDot {
            nominal: dot.nominal.into(),
            mark: match dot.state {
                DotState::Measured | DotState::Doubtful => OffsetMark::Drawn(dot.drawn.into()),
                DotState::Missing => OffsetMark::Missing,
                DotState::Unseen => OffsetMark::Unseen,
            },
            label: dot.nominal_number.to_string(),
        });
        let marks = self.marks.iter().map(|mark| OffsetDot {
            nominal: mark.direction.into(),
            mark: OffsetMark::Drawn(mark.direction.into()),
            label: mark.mark.map_or("mark".to_owned(), |n| format!("mark {n}")),
        });
        let measured = self.dots.iter().filter(|d| d.state == DotState::Measured);
        let measured = crate::error::counted(measured.count(), "dot");
        // What is built from the clip has no places that were meant.
        let title = match self.nominal_sha256 {
            Some(_) => format!(
                "Drawn minus nominal: {:.2} deg rms over {measured}",
                self.rms_offset_deg
            ),
            None => format!("{measured} as measured"),
        };
        offset_views(path, &dots.chain(marks).collect::<Vec<_>>(), &title)
    }
}

/// North (towards +z along the meridian) and east at a direction.
fn compass(direction: &Vec3) -> [Vec3; 2] {
    match Vec3::z().cross(direction).try_normalize(1e-9) {
        Some(east) => [direction.cross(&east), east],
        None => tangent_frame(direction),
    }
}
