//! The command line: arguments in, library calls, words and files out.
//!
//! Exit codes: 0 done; 2 unusable arguments or input, with one line that names the problem; 3 done,
//! but no input could be answered; 1 anything else.

/// Prints a line on standard output. The reader may stop early (`| head`): then the command ends
/// quietly. Any other failure ends it with one line and exit code 1.
macro_rules! outln {
    () => {
        $crate::cli::print_line(format_args!(""))
    };
    ($($words:tt)+) => {
        $crate::cli::print_line(format_args!($($words)+))
    };
}

/// Prints a line on standard error; a failure is ignored.
macro_rules! errln {
    ($($words:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($words)*);
    }};
}

#[cfg(feature = "vision")]
mod advise;
mod bounds;
#[cfg(feature = "vision")]
mod calibrate;
#[cfg(feature = "vision")]
mod camera;
mod compare;
mod design;
#[cfg(feature = "vision")]
mod estimate;
#[cfg(feature = "vision")]
mod export;
mod identify;
#[cfg(feature = "vision")]
mod images;
mod interrupt;
#[cfg(feature = "mark")]
mod mark;
mod memory;
mod merge;
mod output;
mod precession;
mod report;
#[cfg(feature = "vision")]
mod sample;
mod sensitivity;
mod shell;
mod simulate;
mod spin;
#[cfg(feature = "plot")]
mod spin_plot;
mod spin_stretches;
mod spin_summary;
mod stencil;
#[cfg(feature = "vision")]
mod synth;
mod table;
mod trajectories;
#[cfg(feature = "plot")]
mod trajectories_plot;
mod validate;

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{ArgMatches, CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

use crate::design::Shard;
use crate::error::{Error, Result};
use crate::files;
use crate::report::{DesignJob, Start};

/// Designs dot patterns for balls, evaluates them, and writes the files needed to use them.
#[derive(Debug, Parser)]
#[command(name = "spindoe", version, about, max_term_width = 100)]
struct Cli {
    /// Show no progress; warnings and errors stay.
    #[arg(short, long, global = true)]
    quiet: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Design a pattern: search, evaluate, and leave pattern, table, stencil, plots and report in a
    /// folder.
    Design(design::Arguments),
    /// Merge the shards of a search that ran on several machines: the best of all meet in the last
    /// trial.
    Merge(merge::Arguments),
    /// Measure how often a pattern is identified correctly, by Monte Carlo.
    Validate(validate::Arguments),
    /// Say which pattern a camera identifies best, how well, and what to change of the camera.
    #[cfg(feature = "vision")]
    Advise(Box<advise::Arguments>),
    /// Make the page of a design's folder: report.html, to look at and to hand on.
    Report(report::Arguments),
    /// Compare patterns on the same trials, side by side.
    Compare(compare::Arguments),
    /// Measure how the rates depend on the dots' noise and on the paper's alpha; data and plots.
    Sensitivity(sensitivity::Arguments),
    /// Make the hash table of a pattern, a NumPy archive.
    Table(table::Arguments),
    /// Identify the dots of frames from their observed directions, and give the orientation.
    Identify(identify::Arguments),
    /// Estimate orientations and the spin from images or videos.
    #[cfg(feature = "vision")]
    Estimate(Box<estimate::Arguments>),
    /// Measure a ball's dots as they were really drawn, from a clip of it.
    #[cfg(feature = "vision")]
    Calibrate(Box<calibrate::Arguments>),
    /// Make the stencil that draws a pattern on a ball: two printable halves.
    Stencil(Box<stencil::Arguments>),
    /// Mark a pattern on a ball without a stencil: paper lobes, stickers, files for plotters.
    #[cfg(feature = "mark")]
    Mark(Box<mark::Arguments>),
    /// Estimate the spin from time-stamped orientations.
    Spin(spin::Arguments),
    /// Simulate orientations of a rotating ball, with known ground truth.
    Simulate(simulate::Arguments),
    /// Draw synthetic images of a ball with a pattern, with ground truth: a data set, or a rotating
    /// ball.
    #[cfg(feature = "vision")]
    Synth(Box<synth::Arguments>),
    /// Write the dot detector's net as an ONNX file, for estimators in other languages.
    #[cfg(feature = "vision")]
    Export(export::Arguments),
    /// Write a sample to try: a pattern, its table, and a clip of a spinning ball.
    #[cfg(feature = "vision")]
    Sample(sample::Arguments),
    /// Print the completions of a shell.
    Completions(shell::CompletionArguments),
    /// Write the manual pages.
    Man(shell::ManArguments),
    /// Summarize trajectories with known spins, in the format of the published set.
    Trajectories(trajectories::Arguments),
}

/// Runs the command with the process' arguments.
pub fn main() -> ExitCode {
    ExitCode::from(main_with(std::env::args_os()))
}

/// Runs the command with these arguments, the first of which is the program's name, and returns its
/// exit code.
pub fn main_with(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    interrupt::catch();
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    output::set_command_line(&arguments);
    let (cli, command, given) = match parsed(arguments) {
        Ok(parsed) => parsed,
        Err(error) => return report_usage(&error),
    };
    output::set_quiet(cli.quiet);
    match check_numbers(&command, &given).and_then(|()| run(cli.command, &given)) {
        Ok(()) => 0,
        Err(error) => {
            // Whatever an error quotes, it is one line.
            let words = error_words(&error, given.subcommand_name().unwrap_or_default());
            let line: Vec<&str> = words.lines().map(str::trim).collect();
            errln!("spindoe: {}", line.join(" "));
            match error {
                Error::NoAnswer { .. } => 3,
                error if error.is_usage() => 2,
                _ => 1,
            }
        }
    }
}

/// The arguments as commands take them, and the command with what was given to it.
fn parsed(
    arguments: impl IntoIterator<Item = OsString>,
) -> std::result::Result<(Cli, clap::Command, ArgMatches), clap::Error> {
    let mut command = Cli::command();
    let given = command.try_get_matches_from_mut(arguments)?;
    Ok((Cli::from_arg_matches(&given)?, command, given))
}

/// Checks the bounds of all numbers that were given.
fn check_numbers(cli: &clap::Command, given: &ArgMatches) -> Result<()> {
    let chosen = given.subcommand();
    let command = chosen.and_then(|(name, given)| Some((cli.find_subcommand(name)?, given)));
    command.map_or(Ok(()), |(command, given)| bounds::check(command, given))
}

/// Only `mark` asks what was given.
#[cfg_attr(not(feature = "mark"), allow(unused_variables))]
fn run(command: Command, given: &ArgMatches) -> Result<()> {
    match command {
        Command::Design(arguments) => design::run(&arguments),
        Command::Merge(arguments) => merge::run(&arguments),
        Command::Validate(arguments) => validate::run(&arguments),
        #[cfg(feature = "vision")]
        Command::Advise(arguments) => advise::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Sensitivity(arguments) => sensitivity::run(&arguments),
        Command::Table(arguments) => table::run(&arguments),
        Command::Identify(arguments) => identify::run(&arguments),
        #[cfg(feature = "vision")]
        Command::Estimate(arguments) => estimate::run(&arguments),
        #[cfg(feature = "vision")]
        Command::Calibrate(arguments) => calibrate::run(&arguments),
        Command::Stencil(arguments) => stencil::run(&arguments),
        #[cfg(feature = "mark")]
        Command::Mark(arguments) => mark::run(&arguments, given.subcommand_matches("mark")),
        Command::Spin(arguments) => spin::run(&arguments),
        Command::Simulate(arguments) => simulate::run(&arguments),
        #[cfg(feature = "vision")]
        Command::Synth(arguments) => synth::run(&arguments),
        #[cfg(feature = "vision")]
        Command::Export(arguments) => export::run(&arguments),
        #[cfg(feature = "vision")]
        Command::Sample(arguments) => sample::run(&arguments),
        Command::Completions(arguments) => shell::completions(&arguments),
        Command::Man(arguments) => shell::man(&arguments),
        Command::Trajectories(arguments) => trajectories::run(&arguments),
    }
}

/// Parameters of the library whose flag does not follow from their name.
const FLAGS: [(&str, &str); 4] = [
    ("exposure_s", "exposure-ms"),
    ("image_px", "image-size"),
    ("inverse_distance", "camera-distance-radii"),
    ("max_rps", "max-spin-rps"),
];

/// The error in one line. A parameter that the command `name` takes is named by its flag.
fn error_words(error: &Error, name: &str) -> String {
    let Error::Argument { parameter, problem } = error else {
        return error.to_string();
    };
    // A field within a group, as in `pair_rule.min_cross`, has the flag of its own name.
    let full = parameter.as_str().trim_start_matches('-');
    let library = full.rsplit('.').next().unwrap_or(full);
    let special = FLAGS.iter().find(|(parameter, _)| *parameter == library);
    let flag = special.map_or_else(
        || match library.strip_suffix("_rad") {
            Some(angle) => format!("{}-deg", angle.replace('_', "-")),
            None => library.replace('_', "-"),
        },
        |(_, flag)| (*flag).to_owned(),
    );
    let cli = Cli::command();
    let command = cli.find_subcommand(name);
    let is_known = |flag: &&str| {
        command.is_some_and(|c| c.get_arguments().any(|a| a.get_long() == Some(*flag)))
    };
    // What is written goes to one or the other.
    let names = [flag.as_str(), if flag == "out" { "output" } else { &flag }];
    match names.iter().find(|flag| is_known(flag)) {
        Some(flag) => format!("--{flag}: {problem}"),
        None => format!("{full}: {problem}"),
    }
}

/// What the flags of `spindoe design` ask for.
#[derive(Debug)]
pub struct DesignRequest {
    /// The design.
    pub job: DesignJob,
    /// Where it starts.
    pub start: Start,
    /// The shard of it that is to run, where not all is.
    pub shard: Option<Shard>,
}

/// The job that `spindoe design` with these flags would run, for callers from other languages: they
/// get its defaults, names and units.
///
/// # Errors
/// One line that names the flag and what was expected.
pub fn design_job(
    flags: impl IntoIterator<Item = OsString>,
) -> std::result::Result<DesignRequest, String> {
    let words = ["spindoe".into(), "design".into()].into_iter().chain(flags);
    let (cli, command, given) = parsed(words).map_err(|error| usage_line(&error))?;
    check_numbers(&command, &given).map_err(|error| error.to_string())?;
    let Command::Design(arguments) = cli.command else {
        return Err("expected the flags of design".to_owned());
    };
    let (job, start) = arguments
        .job()
        .map_err(|error| error_words(&error, "design"))?;
    Ok(DesignRequest {
        job,
        start,
        shard: arguments.shard,
    })
}

/// The job that `spindoe merge` would run on these shards, and the command that its report names.
///
/// # Errors
/// Those of reading the first shard.
pub fn merge_job(shards: &[PathBuf], out: PathBuf) -> Result<(DesignJob, Option<String>)> {
    merge::job(shards, out)
}

/// Prints help where it was requested, or one line on the error in the arguments.
fn report_usage(error: &clap::Error) -> u8 {
    use clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand as NothingAsked;
    if !error.use_stderr() || error.kind() == NothingAsked {
        error.exit();
    }
    errln!("spindoe: {} (see --help)", usage_line(error));
    2
}

/// The error in the arguments in one line: its first paragraph, and what clap takes to be meant; usage follows.
fn usage_line(error: &clap::Error) -> String {
    let text = error.to_string();
    let mut paragraphs = text.split("\n\n");
    let first = paragraphs.next().unwrap_or_default();
    let tips = paragraphs.flat_map(str::lines);
    let tips = tips.filter_map(|line| line.trim().strip_prefix("tip: "));
    let words = std::iter::once(first).chain(tips).map(|words| {
        let words = words.split_whitespace().collect::<Vec<_>>().join(" ");
        words.strip_prefix("error: ").unwrap_or(&words).to_owned()
    });
    crate::error::on_one_line(words.collect::<Vec<_>>().join("; "))
}

/// An input that is read piece by piece: a file, or standard input for `-`.
struct Input {
    /// Its name in messages.
    name: PathBuf,
    reader: Box<dyn BufRead + Send>,
}

/// Opens a file to be read, or standard input for `-`.
fn open_input(path: &Path) -> Result<Input> {
    let (name, reader): (_, Box<dyn BufRead + Send>) = if path == Path::new("-") {
        let stdin = BufReader::with_capacity(1 << 16, std::io::stdin());
        (PathBuf::from("standard input"), Box::new(stdin))
    } else {
        (path.to_path_buf(), Box::new(files::open(path)?))
    };
    Ok(Input { name, reader })
}

/// The consequence of a failure to write on standard output. The reader may stop early (`| head`):
/// then the command ends quietly.
fn stdout_error(error: std::io::Error) -> Error {
    if error.kind() == std::io::ErrorKind::BrokenPipe {
        std::process::exit(0);
    }
    Error::write("standard output", error)
}

/// See `outln`.
fn print_line(words: std::fmt::Arguments<'_>) {
    let mut out = std::io::stdout().lock();
    if let Err(error) = writeln!(out, "{words}") {
        if error.kind() == std::io::ErrorKind::BrokenPipe {
            std::process::exit(0);
        }
        errln!("spindoe: standard output: cannot be written: {error}");
        std::process::exit(1);
    }
}

/// Prints one JSON object on standard output.
fn print_json(value: &impl serde::Serialize) -> Result<()> {
    let mut text = serde_json::to_vec(value)
        .map_err(|e| Error::Internal(format!("cannot be written as JSON: {e}")))?;
    text.push(b'\n');
    write_stdout(&text)
}

/// Writes on standard output.
fn write_stdout(bytes: &[u8]) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    stdout
        .write_all(bytes)
        .and_then(|()| stdout.flush())
        .map_err(stdout_error)
}
