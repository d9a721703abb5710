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
        let words = $crate::cli::shown(format!($($words)*));
        let _ = writeln!(std::io::stderr(), "{words}");
    }};
}

#[cfg(feature = "vision")]
mod advise;
mod bounds;
#[cfg(feature = "vision")]
mod calibrate;
#[cfg(feature = "vision")]
mod camera;
#[cfg(feature = "vision")]
mod dataset;
mod design;
#[cfg(feature = "vision")]
mod estimate;
#[cfg(feature = "vision")]
mod flashes;
mod identify;
#[cfg(feature = "vision")]
mod images;
#[cfg(feature = "vision")]
mod inputs;
mod interrupt;
mod levels;
#[cfg(feature = "vision")]
mod live;
#[cfg(feature = "mark")]
mod mark;
mod memory;
mod merge;
mod motion;
mod old;
mod output;
mod outputs;
mod pattern;
#[cfg(feature = "vision")]
mod pipe;
mod report;
mod settings;
mod shell;
mod spin;
#[cfg(feature = "plot")]
mod spin_plot;
mod spin_stretches;
mod spin_summary;
mod stencil;
mod synth;
mod table;
mod validate;

use std::ffi::OsString;
use std::io::{BufRead, BufReader, IsTerminal as _, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{ArgMatches, CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

use crate::design::DesignRequest;
use crate::error::{Error, Result};
use crate::files;

/// Designs dot patterns for balls, evaluates them, and writes the files needed to use them.
#[derive(Debug, Parser)]
#[command(
    name = "spindoe",
    bin_name = "spindoe",
    version,
    about,
    max_term_width = 100
)]
struct Cli {
    /// Show no progress; warnings and errors stay.
    #[arg(short, long, global = true)]
    quiet: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Search a pattern, and write its table, stencil and report.
    Design(Box<design::Arguments>),
    /// Find the pattern for a camera, and what would improve the camera.
    #[cfg(feature = "vision")]
    Advise(Box<advise::Arguments>),
    /// Make a printable stencil that draws a pattern on a ball.
    Stencil(Box<stencil::Arguments>),
    /// Make paper lobes, stickers or plotter files of a pattern.
    #[cfg(feature = "mark")]
    Mark(Box<mark::Arguments>),
    /// Measure a ball's dots as they were drawn, from a clip of it.
    #[cfg(feature = "vision")]
    Calibrate(Box<calibrate::Arguments>),
    /// Estimate orientations and the spin from images or videos.
    #[cfg(feature = "vision")]
    Estimate(Box<estimate::Arguments>),
    /// Estimate orientations and spin live; JSON lines go to stdout.
    #[cfg(feature = "vision")]
    Live(Box<live::Arguments>),
    /// Estimate the spin from time-stamped orientations.
    Spin(Box<spin::Arguments>),
    /// Measure how often patterns are identified correctly.
    Validate(Box<validate::Arguments>),
    /// Identify dots given as directions, and estimate the orientation.
    Identify(Box<identify::Arguments>),
    /// Make a data set of flights with positions and spins from clips.
    #[cfg(feature = "vision")]
    Dataset(Box<dataset::Arguments>),
    /// Make images, a clip, dots or orientations, with exact truth.
    Synth(Box<synth::Arguments>),
    /// Make the hash table of a pattern, a NumPy archive.
    Table(table::Arguments),
    /// Merge the shards of a search on several machines to one design.
    Merge(merge::Arguments),
    /// Write the report of a design or a calibration again.
    Report(report::Arguments),
    /// Print the completions of a shell.
    Completions(shell::CompletionArguments),
    /// Write the manual pages.
    Man(shell::ManArguments),
    /// Explain a command.
    Help(levels::Arguments),
}

/// The whole command line: levels of help, and `--config` where there are settings.
fn command_line() -> clap::Command {
    let cli = Cli::command().mut_subcommands(|command| match command.get_after_help() {
        Some(words) => {
            let words = joined(&words.to_string());
            command.after_help(words)
        }
        None => command,
    });
    levels::with_levels(settings::with_config(cli).mut_subcommands(levels::with_headings))
}

/// A text with each paragraph on one line, for any width of the terminal; lines that begin with a space stay.
fn joined(text: &str) -> String {
    let mut all = String::new();
    let mut lines = text.lines().peekable();
    while let Some(line) = lines.next() {
        all += line;
        let flows = |line: &str| !line.is_empty() && !line.starts_with(' ');
        let goes_on =
            !line.ends_with(':') && flows(line) && lines.peek().is_some_and(|next| flows(next));
        all.push(if goes_on { ' ' } else { '\n' });
    }
    all
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
    let parsed = match Parsed::of(&arguments) {
        Ok(parsed) => parsed,
        Err(Refused::Usage(error)) => return report_usage(&error, &arguments),
        Err(Refused::Settings(error)) => return report(&error, ""),
    };
    output::set_quiet(parsed.cli.quiet);
    let name = parsed.name().to_owned();
    let checked = memory::check(&name).and_then(|()| parsed.check());
    match checked.and_then(|()| parsed.run()) {
        Ok(()) => 0,
        Err(error) => report(&error, &name),
    }
}

/// Prints an error in one line, whatever it quotes, and returns its exit code.
fn report(error: &Error, command: &str) -> u8 {
    let words = error_words(error, command);
    let line: Vec<&str> = words.lines().map(str::trim).collect();
    errln!("spindoe: {}", line.join(" "));
    match error {
        Error::NoAnswer { .. } => 3,
        error if error.is_usage() => 2,
        _ => 1,
    }
}

/// The arguments, understood.
struct Parsed {
    cli: Cli,
    command: clap::Command,
    given: ArgMatches,
}

/// Arguments that are not.
enum Refused {
    Usage(clap::Error),
    Settings(Error),
}

impl From<clap::Error> for Refused {
    fn from(error: clap::Error) -> Self {
        Self::Usage(error)
    }
}

impl Parsed {
    /// The arguments with those that `--config` names.
    fn of(arguments: &[OsString]) -> std::result::Result<Self, Refused> {
        let mut command = command_line();
        if arguments.iter().any(|a| a == "--help" || a == "-h") {
            command = levels::with_brief_help(command);
        }
        if arguments.iter().any(|a| a == "--print-config") {
            // What a run needs, its settings do not.
            command =
                command.mut_subcommands(|sub| sub.mut_args(|argument| argument.required(false)));
            let given = command.try_get_matches_from_mut(arguments)?;
            if settings::prints(&given) {
                let found =
                    settings::expanded(&command, arguments, &given).map_err(Refused::Settings)?;
                let given = match found {
                    Some(all) => command.try_get_matches_from_mut(all)?,
                    None => given,
                };
                print_settings(&command, &given).map_err(Refused::Settings)?;
                std::process::exit(0);
            }
        }
        let mut given = command.try_get_matches_from_mut(arguments)?;
        let found = settings::expanded(&command, arguments, &given).map_err(Refused::Settings)?;
        if let Some(all) = found {
            given = command.try_get_matches_from_mut(all)?;
        }
        let cli = Cli::from_arg_matches(&given)?;
        Ok(Self {
            cli,
            command,
            given,
        })
    }

    /// The command's name.
    fn name(&self) -> &str {
        self.given.subcommand_name().unwrap_or_default()
    }

    /// Checks the bounds of all numbers that were given, and that no output is an input.
    fn check(&self) -> Result<()> {
        let chosen = self.given.subcommand();
        let command =
            chosen.and_then(|(name, given)| Some((self.command.find_subcommand(name)?, given)));
        command.map_or(Ok(()), |(command, given)| {
            bounds::check(command, given)?;
            outputs::check(command, given)
        })
    }

    fn run(self) -> Result<()> {
        let name = self.name().to_owned();
        let given = self.given.subcommand_matches(&name);
        match self.cli.command {
            Command::Design(arguments) => design::run(&arguments),
            #[cfg(feature = "vision")]
            Command::Advise(arguments) => advise::run(&arguments),
            Command::Stencil(arguments) => stencil::run(&arguments),
            #[cfg(feature = "mark")]
            Command::Mark(arguments) => mark::run(&arguments, given),
            #[cfg(feature = "vision")]
            Command::Calibrate(arguments) => calibrate::run(&arguments),
            #[cfg(feature = "vision")]
            Command::Estimate(arguments) => estimate::run(&arguments, given),
            #[cfg(feature = "vision")]
            Command::Live(arguments) => live::run(&arguments, given),
            Command::Spin(arguments) => spin::run(&arguments),
            Command::Validate(arguments) => validate::run(&arguments),
            Command::Identify(arguments) => identify::run(&arguments),
            #[cfg(feature = "vision")]
            Command::Dataset(arguments) => dataset::run(&arguments),
            Command::Synth(arguments) => synth::run(&arguments, given),
            Command::Table(arguments) => table::run(&arguments),
            Command::Merge(arguments) => merge::run(&arguments),
            Command::Report(arguments) => report::run(&arguments),
            Command::Completions(arguments) => shell::completions(&arguments),
            Command::Man(arguments) => shell::man(&arguments),
            Command::Help(arguments) => levels::run(&arguments, self.command),
        }
    }
}

/// Prints the settings of the command that was given.
fn print_settings(cli: &clap::Command, given: &ArgMatches) -> Result<()> {
    let chosen = given.subcommand();
    let text =
        chosen.and_then(|(name, given)| Some(settings::printed(cli.find_subcommand(name)?, given)));
    write_stdout(text.unwrap_or_default().as_bytes())
}

/// Parameters of the library whose flag does not follow from their name.
const FLAGS: [(&str, &str); 6] = [
    ("hole_diameter_mm", "dot-diameter-mm"),
    ("exposure_s", "exposure-ms"),
    ("readout_s", "readout-ms"),
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
    let cli = command_line();
    let command = cli.find_subcommand(name);
    let argument =
        |flag: &str| command.and_then(|c| c.get_arguments().find(|a| a.get_long() == Some(flag)));
    // What is written goes to one or the other; what a setting is named has no flag.
    let found = argument(&flag).or_else(|| argument(if flag == "out" { "output" } else { full }));
    match found {
        Some(setting) if settings::is_setting(setting) => {
            format!("{}: {problem}", flag.replace('-', "_"))
        }
        Some(argument) => format!("--{}: {problem}", argument.get_long().unwrap_or(&flag)),
        None => format!("{full}: {problem}"),
    }
}

/// What flags of `spindoe design` ask for, for a search whose shards another program hands out.
///
/// # Errors
/// One line that names the flag and what was expected.
pub fn design_request(
    flags: impl IntoIterator<Item = OsString>,
) -> std::result::Result<DesignRequest, String> {
    let words = ["spindoe".into(), "design".into()].into_iter().chain(flags);
    let parsed = Parsed::of(&words.collect::<Vec<_>>()).map_err(|refused| match refused {
        Refused::Usage(error) => usage_line(&error),
        Refused::Settings(error) => error.to_string(),
    })?;
    parsed.check().map_err(|error| error.to_string())?;
    let Command::Design(arguments) = parsed.cli.command else {
        return Err("expected the flags of design".to_owned());
    };
    arguments
        .sharded_request()
        .map_err(|error| error_words(&error, "design"))
}

/// Prints help where it was requested, or one line on the error in the arguments.
fn report_usage(error: &clap::Error, arguments: &[OsString]) -> u8 {
    use clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand as NothingAsked;
    if !error.use_stderr() || error.kind() == NothingAsked {
        error.exit();
    }
    match old::replacement(error, arguments) {
        Some(words) => errln!("spindoe: {words}"),
        None => errln!("spindoe: {} (see --help)", usage_line(error)),
    }
    2
}

/// The error in the arguments in one line: its first paragraph, and what clap takes to be meant; usage follows.
fn usage_line(error: &clap::Error) -> String {
    // The ball is named as where a command itself misses it.
    let text = error.to_string();
    let text = text.replace("--table <TABLE.npz>", "--table dots20 (or my-ball)");
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

/// What a terminal is shown: a file's name may hold the codes that a terminal obeys, which are escaped.
fn shown(words: String) -> String {
    let obeyed = |c: char| c.is_control() && c != '\n' && c != '\t';
    if !words.contains(obeyed) {
        return words;
    }
    let escaped = |c: char| match obeyed(c) {
        true => c.escape_default().to_string(),
        false => c.to_string(),
    };
    words.chars().map(escaped).collect()
}

/// See `outln`.
fn print_line(words: std::fmt::Arguments<'_>) {
    let words = shown(words.to_string());
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

/// Writes on standard output: to a file or a pipe every byte, to a terminal what it may be shown.
fn write_stdout(bytes: &[u8]) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    let text = stdout.is_terminal().then(|| String::from_utf8_lossy(bytes));
    let text = text.map(|text| shown(text.into_owned()));
    let bytes = text.as_deref().map_or(bytes, str::as_bytes);
    stdout
        .write_all(bytes)
        .and_then(|()| stdout.flush())
        .map_err(stdout_error)
}
