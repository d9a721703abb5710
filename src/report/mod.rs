//! The result of a design: the evaluation of the winner on fresh trials, and the folder with
//! everything that a user or an estimator needs. [`DesignJob`] does all of it.
//!
//! The folder holds `pattern.csv`, `table.npz`, `report.json`, `report.html`, `sensitivity.csv`, `timing.json` and `stencil/`,
//! and pictures where they are asked for. For the same arguments every file is identical byte for byte, on any number of
//! threads, except for `timing.json`, which has the measured times.

#[cfg(feature = "vision")]
pub mod calibration;
pub mod compare;
mod dot_place;
#[cfg(feature = "vision")]
pub mod dot_set;
mod folder;
mod job;
pub mod page;
#[cfg(feature = "plot")]
pub mod plots;

use std::path::Path;
use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use crate::ball::{Ball, DesignRecord, ObjectiveRecord};
use crate::concurrency::{self, Stopwatch};
use crate::design::objective::bound::BoundSummary;
use crate::design::{
    CameraRecord, DesignCandidate, DesignConfig, DesignOutcome, Milestone, OrientationBound,
};
use crate::error::{Error, Result};
use crate::files;
use crate::pattern::{Pattern, PatternSummary};
use crate::recognize::RecognizerName;
use crate::recognize::paper::FeatureTree;
use crate::stencil::{Stencil, StencilConfig};
use crate::validate::{
    NamedValidation, SensitivityConfig, SensitivityPoint, ValidationConfig, check_samples,
    sensitivity, sensitivity_csv,
};
use crate::view::{Protocol, ProtocolName};

pub use dot_place::DotPlace;
#[cfg(feature = "cli")]
pub(crate) use job::reject_design;
pub use job::{CHECKPOINT, DesignJob, JobObserver, JobStart, ShardedJob};

/// The report within a folder, the last file to appear.
pub(crate) const REPORT: &str = "report.json";
/// The measured times within a folder.
const TIMING: &str = "timing.json";
/// Version of `report.json`.
pub const REPORT_VERSION: u32 = 6;

/// The seeds of a design: none is used for two purposes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seeds {
    /// Of the random starts.
    pub search: u64,
    /// Of the first trials that selected among the candidates; further stages set higher bits.
    pub selection: u64,
    /// Of the trials that show the progress; they select nothing.
    pub progress: u64,
    /// Of the trials whose rates are reported.
    pub report: u64,
}

/// A pattern in a report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PatternReport {
    /// SHA-256 of the dots.
    pub sha256: String,
    /// Separations and visibility.
    pub summary: PatternSummary,
    /// The unit vectors, in the pattern's frame.
    pub dots: Vec<[f64; 3]>,
}

/// Duration of the stages, seconds of wall-clock time: `timing.json`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Timing {
    /// Descents and selection.
    pub search_s: f64,
    /// Validation of the winner.
    pub validation_s: f64,
    /// The sensitivity sweeps.
    pub sensitivity_s: f64,
    /// Mean time of one identification on one thread, microseconds, in the order of `validation`.
    pub us_per_identification: Vec<Option<f64>>,
    /// Threads used.
    pub threads: usize,
    /// The best rate over the time of the search.
    pub milestones: Vec<Milestone>,
}

/// The evaluation of a design.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DesignReport {
    /// [`REPORT_VERSION`].
    pub format_version: u32,
    /// The version of this crate.
    pub spindoe_version: String,
    /// The command that reproduces this design, where a command made it.
    pub command: Option<String>,
    /// Configuration of the search.
    pub config: DesignConfig,
    /// The seeds.
    pub seeds: Seeds,
    /// Whether the search was stopped before its end; then the command does not reproduce it.
    pub stopped: bool,
    /// Random starts tried.
    pub starts: usize,
    /// The finalists of the last trial, best first, with their rates on the selection's trials.
    pub finalists: Vec<DesignCandidate>,
    /// The objective, and its value.
    pub objective: ObjectiveRecord,
    /// The winner.
    pub pattern: PatternReport,
    /// What it was designed for, as it stands beside the pattern and in the table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub design: Option<DesignRecord>,
    /// The orientation bound of its dots, in units of the dots' noise.
    pub orientation_bound: BoundSummary,
    /// Mean distance from each feature of its table to the nearest other one, without unit: the
    /// value of the SpinDOE paper.
    pub mean_feature_distance: f64,
    /// Rates of the winner on the report's trials: those of [`EvaluationConfig::rates`].
    pub validation: Vec<NamedValidation>,
    /// Of dots added to drawn ones: the rates before, by the default recognizer on the same trials.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub before: Vec<NamedValidation>,
    /// Of dots added to drawn ones: where they are to be drawn.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub added: Vec<DotPlace>,
    /// How the rates depend on noise and alpha.
    pub sensitivity: Vec<SensitivityPoint>,
    /// How the finalists were ranked for a camera, where they were.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraRecord>,
    /// The best rate over the rounds of the search.
    pub milestones: Vec<Milestone>,
}

impl DesignReport {
    /// Reads the `report.json` of a design's folder.
    ///
    /// # Errors
    /// [`Error::Read`] where there is none; [`Error::Input`] where it is no design's report of this version.
    pub fn read(dir: &Path) -> Result<Self> {
        folder::report(&dir.join(REPORT), REPORT_VERSION)
    }

    /// Writes it as `report.json` to a folder.
    ///
    /// # Errors
    /// [`Error::Write`] on an I/O failure.
    pub fn write(&self, dir: &Path) -> Result<()> {
        folder::write_report(&dir.join(REPORT), self)
    }
}

/// Configuration of the winner's evaluation.
#[derive(Debug, Clone, PartialEq)]
pub struct EvaluationConfig {
    /// The rates that are measured.
    pub rates: Vec<RateKind>,
    /// Trials for each of them.
    pub samples: u64,
    /// The sweeps; its seed is replaced by the report's.
    pub sensitivity: SensitivityConfig,
}

/// A recognizer, and the views that it is tried on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RateKind {
    /// The recognizer.
    pub recognizer: RecognizerName,
    /// The views.
    pub protocol: ProtocolName,
}

impl EvaluationConfig {
    /// For the winner of a search: as many trials as each candidate had, and a tenth of that for each point of the
    /// sweeps. The paper's recognizer is tried on the paper's views, and on all others where the search is for it.
    pub fn of_search(config: &DesignConfig) -> Self {
        let of = |recognizer, protocols: &[ProtocolName]| {
            let kind = |&protocol| RateKind {
                recognizer,
                protocol,
            };
            protocols.iter().map(kind).collect::<Vec<_>>()
        };
        let all = &ProtocolName::ALL;
        let usual = SensitivityConfig {
            samples: config.samples.div_ceil(10),
            ..SensitivityConfig::default()
        };
        let ours = of(RecognizerName::Robust, all);
        let (papers, sensitivity) = match config.recognizer {
            RecognizerName::Voting => (of(RecognizerName::Voting, all), usual),
            RecognizerName::Robust => (
                of(RecognizerName::Voting, &[ProtocolName::Paper]),
                SensitivityConfig {
                    recognizers: vec![RecognizerName::Robust],
                    alphas: Vec::new(),
                    ..usual
                },
            ),
        };
        Self {
            rates: [ours, papers].concat(),
            samples: config.samples,
            sensitivity,
        }
    }

    /// How many steps [`evaluate`] names.
    pub fn steps(&self) -> usize {
        self.rates.len() + self.sensitivity.points()
    }

    /// Checks the numbers of trials.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] as [`check_samples`].
    pub fn check(&self) -> Result<()> {
        check_samples(self.samples)?;
        check_samples(self.sensitivity.samples)
    }
}

impl Default for EvaluationConfig {
    /// For the default search: 10 000 trials each, 1 000 for each point of a sweep.
    fn default() -> Self {
        Self::of_search(&DesignConfig::default())
    }
}

/// A design with its evaluation, ready to be written.
#[derive(Debug)]
pub struct DesignEvaluation {
    /// The ball, with the validation that it ships with.
    pub ball: Ball,
    /// The report.
    pub report: DesignReport,
    /// Clock times; they differ from run to run.
    pub timing: Timing,
}

/// Evaluates the winner of a search on the report's own trials; `says` receives the name of each
/// measurement. Setting `stop` ends it.
///
/// # Errors
/// As [`ValidationConfig::run`]; [`crate::Error::Stopped`].
pub fn evaluate(
    outcome: &DesignOutcome,
    config: &DesignConfig,
    evaluation: &EvaluationConfig,
    stop: &AtomicBool,
    says: &mut dyn FnMut(&str) -> Result<()>,
) -> Result<DesignEvaluation> {
    let best = &outcome.best;
    let zones = config.constraints.keep_out.clone();
    let pattern = &best.pattern()?.with_keep_out(zones)?;
    let mut ball = Ball::new(pattern.clone());
    let clock = Stopwatch::start();
    let rates = &evaluation.rates;
    let mut validation = validate_all(&ball, config, evaluation, rates, (stop, says))?;
    let mut timing = Timing {
        validation_s: clock.elapsed().as_secs_f64(),
        us_per_identification: validation
            .iter()
            .map(|v| v.validation.us_per_identification)
            .collect(),
        threads: concurrency::threads(),
        milestones: outcome.milestones.clone(),
        ..Timing::default()
    };
    let mut before = before_added(pattern, config, evaluation, stop)?;
    for v in validation.iter_mut().chain(&mut before) {
        v.validation = v.validation.clone().untimed();
    }
    let clock = Stopwatch::start();
    let sensitivity = sweep(&ball, config, evaluation, (stop, says))?;
    timing.sensitivity_s = clock.elapsed().as_secs_f64();
    let objective = ObjectiveRecord {
        name: config.objective.name().to_string(),
        value: best.value,
    };
    let shipped = serde_json::to_value(&validation)
        .map_err(|e| Error::Internal(format!("validation as JSON: {e}")))?;
    ball.set_objective(Some(objective.clone()));
    ball.set_validation(Some(shipped));
    let report = DesignReport {
        validation,
        before,
        sensitivity,
        ..DesignReport::of_outcome(outcome, config, objective, &ball)?
    };
    Ok(DesignEvaluation {
        ball,
        report,
        timing,
    })
}

impl DesignReport {
    /// What a search says of its winner, without any trial.
    fn of_outcome(
        outcome: &DesignOutcome,
        config: &DesignConfig,
        objective: ObjectiveRecord,
        ball: &Ball,
    ) -> Result<Self> {
        let pattern = ball.pattern();
        Ok(Self {
            format_version: REPORT_VERSION,
            spindoe_version: env!("CARGO_PKG_VERSION").to_owned(),
            command: None,
            config: config.clone(),
            seeds: Seeds::of(config),
            stopped: outcome.stopped,
            starts: outcome.starts,
            finalists: outcome.finalists.clone(),
            objective,
            orientation_bound: OrientationBound::default().summary(pattern.dots()),
            mean_feature_distance: FeatureTree::new(ball)?.mean_nearest_distance(),
            pattern: PatternReport {
                sha256: pattern.sha256(),
                summary: pattern.summary(),
                dots: pattern.dots().iter().map(|d| [d.x, d.y, d.z]).collect(),
            },
            design: None,
            validation: Vec::new(),
            before: Vec::new(),
            added: Vec::new(),
            sensitivity: Vec::new(),
            camera: None,
            milestones: outcome.milestones.iter().map(untimed).collect(),
        })
    }
}

/// The rates of the dots that were drawn before others came to them; none where all are new.
fn before_added(
    pattern: &Pattern,
    config: &DesignConfig,
    evaluation: &EvaluationConfig,
    stop: &AtomicBool,
) -> Result<Vec<NamedValidation>> {
    let drawn = pattern.dots().split_at(config.constraints.drawn).0;
    if drawn.is_empty() {
        return Ok(Vec::new());
    }
    let ball = Ball::new(Pattern::new(drawn.to_vec())?);
    let ours = evaluation.rates.iter().copied();
    let ours: Vec<RateKind> = ours
        .filter(|kind| kind.recognizer == RecognizerName::Robust)
        .collect();
    let silent = &mut |_: &str| Ok(());
    validate_all(&ball, config, evaluation, &ours, (stop, silent))
}

fn untimed(milestone: &Milestone) -> Milestone {
    Milestone {
        elapsed_s: None,
        ..*milestone
    }
}

impl Seeds {
    fn of(config: &DesignConfig) -> Self {
        Self {
            search: config.seed,
            selection: config.selection_seed(1, 0),
            progress: config.progress_seed(),
            report: config.report_seed(),
        }
    }
}

/// What ends a measurement, and what hears its name.
type Ends<'a> = (&'a AtomicBool, &'a mut dyn FnMut(&str) -> Result<()>);

/// These rates; the search's own protocols with the search's own values.
fn validate_all(
    ball: &Ball,
    config: &DesignConfig,
    evaluation: &EvaluationConfig,
    rates: &[RateKind],
    (stop, says): Ends<'_>,
) -> Result<Vec<NamedValidation>> {
    let mut found = Vec::new();
    for &RateKind {
        recognizer,
        protocol: name,
    } in rates
    {
        says(&format!("validating: {name}, recognizer {recognizer}"))?;
        let own = config.protocols.iter().find(|own| own.name() == name);
        let part = ValidationConfig {
            recognizer,
            protocol: own.copied().unwrap_or(Protocol::standard(name)),
            seed: config.report_seed(),
            samples: evaluation.samples,
        };
        found.push(part.run_until(ball, Some(stop))?);
    }
    Ok(found)
}

/// The sensitivity sweeps in the search's own protocol, of several in the first, without times.
fn sweep(
    ball: &Ball,
    config: &DesignConfig,
    evaluation: &EvaluationConfig,
    (stop, says): Ends<'_>,
) -> Result<Vec<SensitivityPoint>> {
    let sweep = SensitivityConfig {
        seed: config.report_seed(),
        ..evaluation.sensitivity.clone()
    };
    // A check has refused a search for no views.
    let protocol = config.protocols.first().copied();
    let protocol = protocol.unwrap_or(Protocol::standard(ProtocolName::Sparse));
    let mut points = sensitivity(ball, &protocol, &sweep, Some(stop), &mut |p| {
        says(&format!(
            "sensitivity, {} recognizer: {} = {}",
            p.result.recognizer,
            p.parameter.as_str(),
            p.value
        ))
    })?;
    for p in &mut points {
        p.result.validation = p.result.validation.clone().untimed();
    }
    Ok(points)
}

impl DesignEvaluation {
    /// Records in ball and report what the pattern was designed for.
    ///
    /// # Errors
    /// As [`DesignRecord::check`].
    pub fn with_design(mut self, design: DesignRecord) -> Result<Self> {
        self.report.design = Some(design.clone());
        self.ball = self.ball.with_design(Some(design))?;
        Ok(self)
    }

    /// Writes everything but the stencil to `dir`, each file atomically.
    ///
    /// # Errors
    /// [`Error::Write`] on an I/O failure.
    pub fn write(&self, dir: &Path) -> Result<()> {
        files::create_dir(dir)?;
        let ball = &self.ball;
        ball.write_csv(&dir.join("pattern.csv"))?;
        ball.write_npz(&dir.join("table.npz"))?;
        let csv = sensitivity_csv(&self.report.sensitivity);
        files::write_bytes(&dir.join("sensitivity.csv"), csv.as_bytes())?;
        folder::write_report(&dir.join(TIMING), &self.timing)?;
        self.report.write(dir)
    }

    /// Makes the stencil and writes it to `dir/stencil`, with its picture where the crate is built with
    /// the feature `plot`, and its drawing (A4) with `mark`.
    ///
    /// # Errors
    /// As [`Stencil::build`] and [`Stencil::write`].
    pub fn write_stencil(&self, dir: &Path, config: &StencilConfig) -> Result<()> {
        let stencil = Stencil::build(self.ball.pattern(), config)?;
        let dir = dir.join("stencil");
        stencil.write(&dir)?;
        #[cfg(feature = "plot")]
        {
            let title = format!("Stencil of pattern {:.8}", stencil.pattern_sha256());
            plots::in_each_format(&dir, "stencil", &plots::PictureFormat::ALL, |path| {
                crate::plot::stencil_views(path, &stencil, &title)
            })?;
        }
        #[cfg(feature = "mark")]
        {
            // Without a date: the folder is the same for the same arguments.
            let sheet = crate::mark::stencil_sheet(&stencil, crate::mark::PageSize::A4, None);
            files::write_bytes(&dir.join("drawing.pdf"), &crate::mark::pdf_bytes(&sheet))?;
        }
        Ok(())
    }
}
