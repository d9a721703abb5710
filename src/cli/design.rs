//! `spindoe design`: the main job.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};

use super::print_json;
use crate::design::descent::Constraints;
use crate::design::{
    Candidate, DesignConfig, DesignObserver, DesignOutcome, ObjectiveName, design,
};
use crate::error::{Error, Result};
use crate::files;
use crate::report::{ProofConfig, ProvenDesign, prove};
use crate::stencil::StencilConfig;
use crate::validate::ProtocolName;

/// The default folder's name; a number is added where it is taken.
const FOLDER: &str = "spindoe-design";

#[derive(Debug, Args)]
#[command(after_help = "\
Each random start is improved by L-BFGS on the objective and then judged by Monte Carlo trials; the best
is proven on trials of other seeds. The folder then holds pattern.csv, table.npz, report.json,
sensitivity.csv, plots and stencil/. Ctrl-C ends the search and finishes with the best pattern so far.

Examples:
  spindoe design
  spindoe design --seed 7 --starts 48 --out my-ball
  spindoe design --dots 12 --hole-diameter-mm 6 --out twelve")]
pub struct Arguments {
    /// Number of dots, 4 to 64.
    #[arg(long, value_name = "N", default_value_t = DesignConfig::default().dots)]
    dots: usize,
    /// Seed of the random starts; the seeds of all trials are derived from it.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Number of random starts.
    #[arg(long, value_name = "N", default_value_t = DesignConfig::default().starts)]
    starts: usize,
    /// Steps of L-BFGS a start.
    #[arg(long, value_name = "N", default_value_t = DesignConfig::default().steps)]
    steps: u64,
    /// What a descent climbs.
    #[arg(long, value_enum, default_value_t = ObjectiveName::MeanNn)]
    objective: ObjectiveName,
    /// Monte Carlo trials a candidate, again for each protocol of the winner's proof, and a fifth of
    /// it for each point of the sensitivity sweeps.
    #[arg(long, value_name = "N", default_value_t = DesignConfig::default().samples)]
    samples: u64,
    /// The protocol whose identity rate chooses among the candidates.
    #[arg(long, value_enum, default_value_t = DesignConfig::default().protocol)]
    protocol: ProtocolName,
    /// Least angle between two dots, degrees (18 degrees leave walls between 4 mm holes on a 40 mm ball).
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 18.0,
        allow_negative_numbers = true
    )]
    min_separation_deg: f64,
    /// Fewest dots in view from any direction; by default a quarter of them.
    #[arg(long, value_name = "N")]
    min_visible: Option<usize>,
    /// Diameter of the ball that the stencil fits, mm. Table-tennis balls measure 40.0 to 40.6: measure yours.
    #[arg(long, value_name = "MM", default_value_t = StencilConfig::default().ball_diameter_mm, allow_negative_numbers = true)]
    ball_diameter_mm: f64,
    /// Diameter of the stencil's holes at the ball, mm.
    #[arg(long, value_name = "MM", default_value_t = StencilConfig::default().hole_diameter_mm, allow_negative_numbers = true)]
    hole_diameter_mm: f64,
    /// The folder to write to; by default spindoe-design, with a number where that is taken.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the report as one JSON object on standard output.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    fn config(&self) -> DesignConfig {
        DesignConfig {
            dots: self.dots,
            seed: self.seed,
            starts: self.starts,
            steps: self.steps,
            samples: self.samples,
            protocol: self.protocol,
            constraints: Constraints {
                least_separation_rad: self.min_separation_deg.to_radians(),
                least_visible: self.min_visible(),
            },
            ..DesignConfig::default()
        }
    }

    fn min_visible(&self) -> usize {
        self.min_visible.unwrap_or(self.dots / 4)
    }

    fn stencil(&self) -> StencilConfig {
        StencilConfig {
            ball_diameter_mm: self.ball_diameter_mm,
            hole_diameter_mm: self.hole_diameter_mm,
            ..StencilConfig::default()
        }
    }

    /// The command that repeats this design, whatever the defaults of other versions.
    fn command(&self) -> String {
        format!(
            "spindoe design --dots {} --seed {} --starts {} --steps {} --objective {} --samples {} \
             --protocol {} --min-separation-deg {} --min-visible {} --ball-diameter-mm {} --hole-diameter-mm {}",
            self.dots,
            self.seed,
            self.starts,
            self.steps,
            self.objective,
            self.samples,
            self.protocol,
            self.min_separation_deg,
            self.min_visible(),
            self.ball_diameter_mm,
            self.hole_diameter_mm,
        )
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let config = arguments.config();
    config.check()?;
    let stencil = arguments.stencil();
    stencil.validate()?;
    let dir = match &arguments.out {
        Some(dir) => dir.clone(),
        None => free_folder(),
    };
    files::create_writable_dir(&dir)?;
    let stop = stop_on_interrupt()?;
    let clock = Instant::now();
    let mut progress = Progress::new(&config, &dir);
    let outcome = design(&config, &stop, &mut progress)?;
    let search_s = clock.elapsed().as_secs_f64();
    if outcome.stopped {
        progress.say("stopped: finishing with the best so far; Ctrl-C again leaves at once");
    }
    let proof = ProofConfig::of_samples(config.samples);
    let mut proven = prove(
        &outcome,
        &config,
        &proof,
        arguments.command(),
        &mut |what| {
            progress.say(what);
        },
    )?;
    proven.report.timing.search_s = search_s;
    progress.say("drawing the plots");
    proven.write(&dir, &stencil)?;
    progress.say("making the stencil");
    proven.write_stencil(&dir, &stencil)?;
    progress.finish();
    if arguments.json {
        return print_json(&proven.report);
    }
    print_words(&proven, &outcome, clock.elapsed().as_secs_f64());
    println!("{}", dir.display());
    Ok(())
}

/// The first of `spindoe-design`, `spindoe-design-2`, ... that does not exist.
fn free_folder() -> PathBuf {
    let numbered = (2..).map(|k| PathBuf::from(format!("{FOLDER}-{k}")));
    std::iter::once(PathBuf::from(FOLDER))
        .chain(numbered)
        .find(|p| !p.exists())
        .unwrap_or_else(|| PathBuf::from(FOLDER))
}

/// A flag that the first Ctrl-C sets; the second leaves at once.
fn stop_on_interrupt() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })
    .map_err(|e| Error::Internal(format!("Ctrl-C cannot be caught: {e}")))?;
    Ok(stop)
}

/// Shows a search: a bar on a terminal, plain lines elsewhere; and keeps the best pattern on disk.
struct Progress<'a> {
    config: &'a DesignConfig,
    dir: &'a Path,
    bar: ProgressBar,
    saved: Option<usize>,
}

impl<'a> Progress<'a> {
    fn new(config: &'a DesignConfig, dir: &'a Path) -> Self {
        let bar = ProgressBar::new(config.starts as u64);
        // The template is a constant; were it wrong, the default style would do.
        if let Ok(style) = ProgressStyle::with_template(
            "{bar:30} {pos}/{len} starts, {elapsed} gone, {eta} left  {msg}",
        ) {
            bar.set_style(style);
        }
        Self {
            config,
            dir,
            bar,
            saved: None,
        }
    }

    fn say(&self, what: &str) {
        if self.bar.is_hidden() {
            eprintln!("{what}");
        } else {
            self.bar.set_message(what.to_owned());
        }
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl DesignObserver for Progress<'_> {
    fn candidate(&mut self, candidate: &Candidate, best: Option<&Candidate>) -> Result<()> {
        self.bar.inc(1);
        if let Some(best) = best
            && self.saved != Some(best.start)
        {
            best.pattern.write_csv(&self.dir.join("pattern.csv"))?;
            self.saved = Some(best.start);
        }
        let best = best.map_or("none yet".to_owned(), |b| b.validation.identity.to_string());
        if self.bar.is_hidden() {
            eprintln!(
                "start {} of {}: objective {:.4} -> {:.4}, {} identity {}{}; best {best}",
                candidate.start + 1,
                self.config.starts,
                candidate.objective_before,
                candidate.objective,
                self.config.protocol,
                candidate.validation.identity,
                if candidate.feasible {
                    ""
                } else {
                    ", constraints not met"
                },
            );
        } else {
            self.bar
                .set_message(format!("{} identity: best {best}", self.config.protocol));
        }
        Ok(())
    }
}

fn print_words(proven: &ProvenDesign, outcome: &DesignOutcome, seconds: f64) {
    let report = &proven.report;
    let summary = &report.pattern.summary;
    println!(
        "{} dots, least separation {:.1} deg, {} to be seen from anywhere; start {} of {}; {seconds:.1} s",
        summary.dots,
        summary.least_separation_rad.to_degrees(),
        summary.least_visible,
        report.chosen_start + 1,
        outcome.candidates.len(),
    );
    println!(
        "{:<9} {:<8} {:>29} {:>29} {:>11}",
        "protocol", "recog.", "identity [95 %]", "orientation [95 %]", "mean error"
    );
    for v in &report.validation {
        let found = &v.validation;
        println!(
            "{:<9} {:<8} {:>29} {:>29} {:>7.3} deg",
            found.protocol,
            v.recognizer,
            found.identity.to_string(),
            found.orientation.to_string(),
            found.mean_error_deg,
        );
    }
    if let Some(first) = report.validation.first() {
        println!(
            "{} trials each, on seed {}, which the search never saw.",
            first.validation.samples, report.seeds.report
        );
    }
}
