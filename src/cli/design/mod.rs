//! `spindoe design`: searches a pattern, evaluates it and writes its folder.

mod arguments;
#[cfg(feature = "vision")]
mod camera;
mod progress;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::interrupt::{keeps, stop_on_interrupt};
use super::output::{degrees_or_dash, quoted};
use super::print_json;
use crate::design::Shard;
use crate::error::Result;
use crate::files;
use crate::recognize::RecognizerName;
use crate::report::{CHECKPOINT, DesignEvaluation, DesignJob, DesignReport, JobStart};
use crate::validate::NamedValidation;

pub use arguments::Arguments;
#[cfg(feature = "mark")]
pub(super) use arguments::cone;
use progress::DesignProgress;

/// The answer to the first Ctrl-C.
pub(super) const STOPPING: &str = "stopping: what was found is evaluated and written, which takes some seconds; \
                                   Ctrl-C again quits at once and keeps the search for --resume";
/// The answer where a part of a search is asked for, or several.
const STOPPING_SHARD: &str = "stopping: the search is kept for --resume once its work in hand is done; Ctrl-C again quits at once";
/// Which number of dots suits which camera (docs/camera.md, "How many dots?").
const NUMBER_OF_DOTS: &str = "20 dots: readable from 40 pixels before a dark background; --dots 40: any background from 50 pixels. \
                              `spindoe advise` says it for your camera; `spindoe stencil dots40` needs no search.";
/// The default folder's name; a number is added where it is taken.
const FOLDER: &str = "spindoe-design";

pub fn run(arguments: &Arguments) -> Result<()> {
    let clock = Instant::now();
    if let (Some(dir), false) = (&arguments.output, arguments.resume) {
        // Before thousands of trials, or minutes of frames, for a folder that is taken or cannot be.
        DesignJob::new(dir).reject_taken()?;
        files::check_writable_dir(dir)?;
    }
    #[cfg(feature = "vision")]
    let settled = camera::settled(arguments)?;
    #[cfg(feature = "vision")]
    let arguments = &settled.arguments;
    #[cfg_attr(not(feature = "vision"), expect(unused_mut))]
    let (job, mut start) = arguments.job()?;
    let in_parts = arguments.shard.is_some() || arguments.shards.is_some();
    let stop = stop_on_interrupt(if in_parts { STOPPING_SHARD } else { STOPPING })?;
    let resume = arguments.resume_command(&job);
    let kept = format!("the search is kept; this continues it: {resume}");
    keeps(job.dir.join(CHECKPOINT), kept.clone());
    let mut progress = DesignProgress::new(&job, arguments);
    #[cfg(feature = "vision")]
    {
        progress = progress.with_forecast(settled.forecast);
        if settled.leave(&job)? {
            start = JobStart::Resume;
            stop.store(true, std::sync::atomic::Ordering::Relaxed);
        }
    }
    if let Some(shard) = arguments.shard {
        let done = job.run_shard(shard, start, &stop, &mut progress)?;
        progress.finish();
        let words = if done {
            "done"
        } else {
            &format!("cut short; this continues it: {resume}")
        };
        errln!("shard {shard}: {words}");
        outln!("{}", job.dir.display());
        return Ok(());
    }
    let found = match arguments.shards {
        Some(count) => {
            let Some(found) = run_all_shards(&job, count, start, &stop, &mut progress, &kept)?
            else {
                progress.finish();
                errln!("The search was cut short; this continues it: {resume}");
                outln!("{}", job.dir.display());
                return Ok(());
            };
            found
        }
        None => job.run(start, &stop, &mut progress)?,
    };
    progress.finish();
    if arguments.json {
        return print_json(&found.report);
    }
    print_words(&found, clock.elapsed().as_secs_f64());
    print_added(&found);
    print_next(arguments, &job, &found);
    outln!("{}", job.dir.display());
    Ok(())
}

/// Which number of dots suits which camera, where none was chosen.
fn number_of_dots(arguments: &Arguments) -> Option<&'static str> {
    #[cfg(feature = "vision")]
    let has_camera = arguments.camera.is_some();
    #[cfg(not(feature = "vision"))]
    let has_camera = false;
    let is_chosen = arguments.dots.is_some() || arguments.pattern.is_some() || has_camera;
    (!is_chosen && arguments.shard.is_none() && !arguments.json).then_some(NUMBER_OF_DOTS)
}

/// What was left, and what to do with the folder.
fn print_next(arguments: &Arguments, job: &DesignJob, found: &DesignEvaluation) {
    let dir = quoted(&job.dir.to_string_lossy());
    let report = &found.report;
    if report.stopped {
        let resume = arguments.resume_command(job);
        errln!("The search was cut short; this continues it: {resume}");
    }
    if arguments.add.is_some() {
        errln!(
            "Next: draw the rings of {dir}/added.png, film the ball, and measure it by \
             `spindoe calibrate --table {dir}/table.npz CLIP`."
        );
        return;
    }
    errln!(
        "Next: look at {dir}/report.html, print {dir}/stencil/stencil.3mf, draw, and read your images by \
         `spindoe estimate --table {dir}/table.npz IMAGES`."
    );
}

/// The folder of the shards within that of the design.
const SHARDS: &str = "shards";

/// Runs the shards one after another, each in a folder within the design's, and merges them; `None` if
/// stopped before all have ended.
fn run_all_shards(
    job: &DesignJob,
    count: usize,
    start: JobStart,
    stop: &AtomicBool,
    progress: &mut DesignProgress<'_>,
    kept: &str,
) -> Result<Option<DesignEvaluation>> {
    if start == JobStart::Fresh {
        job.reject_taken()?;
    }
    let mut dirs = Vec::new();
    for shard in Shard::all(count)? {
        let dir = job.dir.join(SHARDS).join(shard.index.to_string());
        let part = DesignJob {
            dir: dir.clone(),
            ..job.clone()
        };
        // Of a search that was stopped, later shards have not begun.
        let begun = start == JobStart::Resume && dir.join(CHECKPOINT).exists();
        let start = if begun {
            JobStart::Resume
        } else {
            JobStart::Fresh
        };
        progress.begin_shard(shard);
        keeps(dir.join(CHECKPOINT), kept.to_owned());
        if !part.run_shard(shard, start, stop, progress)? {
            return Ok(None);
        }
        dirs.push(dir);
    }
    job.merge(&dirs, start, stop, progress).map(Some)
}

impl Arguments {
    /// The job that these arguments describe.
    pub(super) fn job(&self) -> Result<(DesignJob, JobStart)> {
        let dir = self.output.clone().unwrap_or_else(free_folder);
        #[cfg_attr(not(any(feature = "plot", feature = "vision")), expect(unused_mut))]
        let mut job = DesignJob::of(self.config()?, dir);
        #[cfg(feature = "vision")]
        {
            job.camera = camera::ranking(self)?;
        }
        #[cfg(feature = "plot")]
        job.pictures.clone_from(&self.pictures);
        let start = if self.resume {
            JobStart::Resume
        } else {
            JobStart::Fresh
        };
        Ok((job, start))
    }
}

/// The first of `spindoe-design`, `spindoe-design-2`, ... that does not exist.
fn free_folder() -> PathBuf {
    let numbered = (2..).map(|k| PathBuf::from(format!("{FOLDER}-{k}")));
    std::iter::once(PathBuf::from(FOLDER))
        .chain(numbered)
        .find(|p| !p.exists())
        .unwrap_or_else(|| PathBuf::from(FOLDER))
}

/// What dots that come to drawn ones are worth, and where they are to be drawn.
fn print_added(found: &DesignEvaluation) {
    let report = &found.report;
    if report.added.is_empty() {
        return;
    }
    outln!("right orientations of all views, before and with the added dots:");
    let with = |name| {
        let robust = report
            .validation
            .iter()
            .filter(|v| v.recognizer == RecognizerName::Robust);
        robust.map(|v| &v.validation).find(|v| v.protocol == name)
    };
    for before in report.before.iter().map(|v| &v.validation) {
        if let Some(after) = with(before.protocol) {
            outln!(
                "{:<8} {:>24} {:>24}",
                before.protocol,
                before.answered.to_string(),
                after.answered.to_string()
            );
        }
    }
    outln!("where to draw them, straight distances as a caliper takes them:");
    for place in &report.added {
        outln!("  {place}");
    }
}

pub(super) fn print_words(found: &DesignEvaluation, seconds: f64) {
    let report = &found.report;
    let summary = &report.pattern.summary;
    outln!(
        "{} dots, minimum separation {:.1} deg, {} visible from anywhere; best of {} starts; {seconds:.1} s",
        summary.dots,
        summary.min_separation_rad.to_degrees(),
        summary.min_visible,
        report.starts,
    );
    outln!(
        "mean nearest-neighbor distance of the features {:.4}",
        report.mean_feature_distance,
    );
    outln!(
        "{:<8} {:>24} {:>8} {:>24} {:>10}",
        "protocol",
        "right, of all views",
        "too few",
        "all dots, of the rest",
        "mean error"
    );
    let ours = |v: &&NamedValidation| v.recognizer == report.config.recognizer;
    for rates in report.validation.iter().filter(ours).map(|v| &v.validation) {
        outln!(
            "{:<8} {:>24} {:>6.1} % {:>24} {:>10}",
            rates.protocol,
            rates.answered.to_string(),
            100.0 * rates.skipped_share(),
            match rates.identity.trials {
                0 => "-".to_owned(),
                _ => rates.identity.to_string(),
            },
            degrees_or_dash(rates.mean_error_deg, 2),
        );
    }
    if let Some(first) = report.validation.first() {
        outln!(
            "{} trials each, on seed {}, which the search never used; {} recognizer, 95 % intervals.",
            first.validation.samples,
            report.seeds.report,
            report.config.recognizer
        );
    }
    for warning in too_few_dots(report) {
        errln!("note: {warning}");
    }
}

/// Share of views with too few dots from which on that is said.
const MANY_SKIPPED: f64 = 0.05;

/// What is to be said where many views show too few dots: of the protocols that the design is for.
fn too_few_dots(report: &DesignReport) -> Vec<String> {
    let config = &report.config;
    let own = |v: &&NamedValidation| {
        v.recognizer == config.recognizer && config.views.include(v.validation.protocol)
    };
    let many = report.validation.iter().filter(own).map(|v| &v.validation);
    let many = many.filter(|v| v.skipped_share() > MANY_SKIPPED);
    many.map(|v| {
        let view = v.protocol.view();
        format!(
            "{:.1} % of the `{}` views show fewer than {} dots with z above {:.2}, and are lost; what helps: \
             more dots, dots farther apart (--config min_separation_deg=DEG), or a detector that sees them nearer to the limb",
            100.0 * v.skipped_share(),
            v.protocol,
            view.min_dots,
            view.visibility_limit
        )
    })
    .collect()
}
