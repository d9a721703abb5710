//! The commands in three levels, as `spindoe --help` shows them; a command's flags in groups, briefly by its `--help` and in whole by
//! `spindoe help`.

use std::fmt::Write as _;

use clap::{Arg, Args, Command};

use super::settings::{CONFIG, PRINT, wrapped};
use crate::error::{Error, Result};

/// Commands by what they are for. Those for scripts are shown by `spindoe help --all`.
const LEVELS: [(&str, &[&str]); 3] = [
    (
        "Commands",
        &[
            "design",
            "advise",
            "stencil",
            "mark",
            "calibrate",
            "estimate",
            "live",
            "spin",
        ],
    ),
    ("Experiments", &["validate", "identify", "synth", "dataset"]),
    (
        "For scripts",
        &["table", "merge", "report", "completions", "man", "help"],
    ),
];
/// Levels that are shown where not all are asked for.
const SHOWN: usize = 2;

/// Flags by what they are of, by their ids; those of some commands have a heading of their own beside them.
const HEADINGS: [(&str, &[&str]); 6] = [
    (
        "Input",
        &[
            "table",
            "circle",
            "roi",
            "raw",
            "mirrored",
            "live",
            "balls",
            "strobe_ms",
            "preset",
            "painted",
            "calibrate",
            "ball",
            "exposure",
            "rig",
        ],
    ),
    (
        "Ball",
        &[
            "dots",
            "add",
            "marks",
            "learn_extra",
            "keep_out",
            "ball_diameter_mm",
            "dot_diameter_mm",
            "ball_px",
            "also",
        ],
    ),
    (
        "Camera",
        &[
            "camera",
            "intrinsics",
            "camera_distance_radii",
            "exposure_ms",
            "readout_ms",
            "image_size",
        ],
    ),
    (
        "Sequence",
        &[
            "frames",
            "fps",
            "times",
            "rps",
            "axis",
            "motion",
            "no_sequence",
            "max_spin_rps",
            "max_latency_ms",
            "at",
        ],
    ),
    (
        "Trials",
        &[
            "samples",
            "seed",
            "protocol",
            "sweep",
            "dot_sigma_deg",
            "budget",
            "resume",
            "shard",
        ],
    ),
    (
        "Output",
        &[
            "content",
            "format",
            "method",
            "output",
            "overwrite",
            "json",
            "overlay",
            "report",
            "frame",
            "min_confidence",
            "write_surface",
            "pictures",
            "stretches",
            "windows",
            "picture",
            "sheet",
            "coupon",
        ],
    ),
];
/// What all commands have, or most, and the end of their help says in one sentence.
const COMMON: [&str; 4] = ["help", "quiet", CONFIG, PRINT];
/// Columns of a command's `--help`, and of its flags' names.
const WIDTH: usize = 80;
const NAMES: usize = 30;
/// Examples that it shows at most: the rest is in `spindoe help`.
const EXAMPLES: usize = 5;
/// Flags of `estimate` that are settings of these, which few need there.
const SETTINGS: [(&str, &[&str]); 4] = [
    (
        "live",
        &[
            "circle",
            "camera_distance_radii",
            "max_spin_rps",
            "ball_diameter_mm",
        ],
    ),
    ("calibrate", &["circle", "camera_distance_radii"]),
    (
        "dataset",
        &["circle", "roi", "camera_distance_radii", "ball_diameter_mm"],
    ),
    ("validate", &["ball_diameter_mm"]),
];

#[derive(Debug, Args)]
pub struct Arguments {
    /// The command.
    command: Option<String>,
    /// All commands, those for scripts too.
    #[arg(long, conflicts_with = "command")]
    all: bool,
}

/// The command line's help with the commands in levels.
pub(super) fn with_levels(cli: Command) -> Command {
    let template = template(&cli, SHOWN);
    cli.disable_help_subcommand(true)
        .help_template(template)
        .override_usage("spindoe [OPTIONS] COMMAND")
}

/// The help of the first `levels`.
fn template(cli: &Command, levels: usize) -> String {
    let mut text = "{about}\n\n{usage-heading} {usage}\n".to_owned();
    for (title, names) in &LEVELS[..levels] {
        let _ = write!(text, "\n{title}:\n");
        for command in names.iter().filter_map(|name| cli.find_subcommand(name)) {
            let about = command.get_about().map(ToString::to_string);
            let _ = writeln!(
                text,
                "  {:<13}{}",
                command.get_name(),
                about.unwrap_or_default()
            );
        }
    }
    text += "\nOptions:\n{options}\n\n`spindoe help COMMAND` explains a command,\n`spindoe help --all` lists those for scripts too.\n";
    text
}

/// Puts the flags of a command in groups.
pub(super) fn with_headings(command: Command) -> Command {
    let heading = |argument: &Arg| {
        let id = argument.get_id().as_str();
        let found = HEADINGS.iter().find(|(_, ids)| ids.contains(&id));
        found.map(|(heading, _)| *heading)
    };
    let settings = SETTINGS
        .iter()
        .find(|(name, _)| *name == command.get_name());
    let settings = settings.map_or(&[][..], |(_, ids)| ids);
    command.mut_args(|argument| {
        let argument = match argument.get_id().as_str() {
            "overwrite" => argument.visible_alias("force"),
            id if settings.contains(&id) => argument.hide(true),
            _ => argument,
        };
        match (argument.get_help_heading(), heading(&argument)) {
            (None, Some(heading)) if !argument.is_positional() => argument.help_heading(heading),
            _ => argument,
        }
    })
}

/// The command line whose commands answer `--help` on one screen or two; `spindoe help COMMAND` has the whole.
pub(super) fn with_brief_help(mut cli: Command) -> Command {
    cli.build();
    cli.mut_subcommands(|command| {
        let text = brief(&command);
        command.override_help(text)
    })
}

/// A command's flags that its `--help` shows.
fn shown(command: &Command) -> impl Iterator<Item = &Arg> {
    let is_common = |argument: &Arg| COMMON.contains(&argument.get_id().as_str());
    command
        .get_arguments()
        .filter(move |a| !a.is_hide_set() && !a.is_positional() && !is_common(a))
}

/// A command's help in brief: examples, then each flag in a few words.
fn brief(command: &Command) -> String {
    let name = command.get_name();
    let about = command.get_about().map(ToString::to_string);
    let usage = command.clone().render_usage();
    let mut text = format!("{}\n\n{usage}\n", about.unwrap_or_default());
    if let (Some(examples), _) = parts(command) {
        // One that goes on in the next line ends with a bar.
        let mut shown = 0;
        let lines = examples.trim_end().lines();
        let few = lines.take_while(|line| {
            shown += usize::from(line.contains("spindoe "));
            shown <= EXAMPLES
        });
        let _ = write!(text, "\n{}\n", few.collect::<Vec<_>>().join("\n"));
    }
    let positionals = command.get_positionals().filter(|a| !a.is_hide_set());
    let mut groups: Vec<(&str, Vec<&Arg>)> = vec![("Arguments", positionals.collect())];
    for argument in shown(command) {
        let heading = argument.get_help_heading().unwrap_or("Options");
        match groups.iter_mut().find(|(title, _)| *title == heading) {
            Some((_, arguments)) => arguments.push(argument),
            None => groups.push((heading, vec![argument])),
        }
    }
    let place = |title: &str| match title {
        "Arguments" => 0,
        "Options" => HEADINGS.len() + 2,
        title => {
            1 + HEADINGS
                .iter()
                .position(|(own, _)| *own == title)
                .unwrap_or(HEADINGS.len())
        }
    };
    groups.sort_by_key(|(title, _)| place(title));
    for (title, arguments) in groups.iter().filter(|(_, arguments)| !arguments.is_empty()) {
        let _ = write!(text, "\n{title}:\n");
        for argument in arguments {
            text += &line(argument);
        }
    }
    let has = |id: &str| command.get_arguments().any(|a| a.get_id() == id);
    let mut end = format!("`spindoe help {name}` explains each of them.");
    if has(CONFIG) {
        end += " --config KEY=VALUE|FILE.toml sets what has no flag (--print-config lists it);";
    }
    end += " -q shows no progress.";
    let _ = write!(text, "\n{}\n", wrapped(&end, WIDTH).join("\n"));
    text
}

/// An argument, and what it is in a few words.
fn line(argument: &Arg) -> String {
    let name = match (argument.get_short(), argument.is_positional()) {
        (Some(short), _) => format!("  -{short}, {argument}"),
        (None, true) => format!("  {argument}"),
        (None, false) => format!("      {argument}"),
    };
    let mut rows = wrapped(&sentence(argument), WIDTH - NAMES).into_iter();
    let mut text = match name.chars().count() + 2 <= NAMES {
        true => format!("{name:<NAMES$}{}\n", rows.next().unwrap_or_default()),
        false => format!("{name}\n"),
    };
    for row in rows {
        let _ = writeln!(text, "{:NAMES$}{row}", "");
    }
    text
}

/// The first clause of an argument's help, with its default and its values.
fn sentence(argument: &Arg) -> String {
    let help = argument.get_help().map(ToString::to_string);
    let help = help.unwrap_or_default();
    let (body, usual) = match help
        .strip_suffix(']')
        .and_then(|h| h.rsplit_once(" [default: "))
    {
        Some((body, usual)) => (body, Some(usual.to_owned())),
        None => (help.as_str(), None),
    };
    let mut text = clause(body).to_owned();
    let is_flag = !argument.get_action().takes_values();
    let values: Vec<String> = argument
        .get_possible_values()
        .iter()
        .filter(|value| !value.is_hide_set())
        .map(|value| value.get_name().to_owned())
        .collect();
    let names = argument.get_value_names().unwrap_or_default();
    let is_named = names.iter().any(|name| name.contains([',', '|']));
    if !(is_flag || is_named || values.is_empty() || argument.is_hide_possible_values_set()) {
        let _ = write!(text, ": {}", values.join(", "));
    }
    let stated = argument
        .get_default_values()
        .iter()
        .map(|v| v.to_string_lossy());
    let stated: Vec<_> = stated.collect();
    let stated = (!is_flag && !stated.is_empty()).then(|| stated.join(","));
    if let Some(usual) = usual.or(stated) {
        let _ = write!(text, " [default: {}]", clause(&usual));
    }
    if let Some(names) = argument
        .get_visible_aliases()
        .filter(|names| !names.is_empty())
    {
        let _ = write!(text, " (or --{})", names.join(", --"));
    }
    text
}

/// What stands before the first stop, colon or semicolon.
fn clause(text: &str) -> &str {
    let ends = [". ", ": ", "; "].map(|end| text.find(end).unwrap_or(text.len()));
    let end = ends.into_iter().min().unwrap_or(text.len());
    text[..end].trim_end_matches('.')
}

/// The examples of a command's help, and the rest of what stands behind its flags.
fn parts(command: &Command) -> (Option<String>, String) {
    let after = command.get_after_help().map(ToString::to_string);
    let after = after.unwrap_or_default();
    let at = match after.starts_with("Example") {
        true => Some(0),
        false => after.find("\nExample").map(|at| at + 1),
    };
    match at {
        Some(at) => (
            Some(after[at..].to_owned()),
            after[..at].trim_end().to_owned(),
        ),
        None => (None, after),
    }
}

/// The command with its examples before its flags.
fn with_examples_first(command: Command) -> Command {
    let (Some(examples), rest) = parts(&command) else {
        return command;
    };
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{}\n\n{{all-args}}{{after-help}}",
        examples.trim_end()
    );
    command.help_template(template).after_help(rest)
}

/// Prints the help that was asked for.
pub(super) fn run(arguments: &Arguments, cli: Command) -> Result<()> {
    let all = template(&cli, LEVELS.len());
    let mut cli = if arguments.all {
        cli.help_template(all)
    } else {
        cli
    };
    cli.build();
    let mut chosen = match &arguments.command {
        None => cli,
        Some(name) => {
            let found = cli.find_subcommand(name).cloned().ok_or_else(|| {
                let problem = format!("expected a command of `spindoe help --all`, found {name}");
                Error::argument("command", problem)
            })?;
            with_examples_first(found)
        }
    };
    super::write_stdout(chosen.render_long_help().to_string().as_bytes())
}

#[cfg(all(test, feature = "vision", feature = "mark", feature = "plot"))]
mod tests {
    use super::*;

    /// Whoever asks for help is to read it.
    #[test]
    fn helps_are_brief_and_flags_few() {
        let cli = with_brief_help(super::super::command_line());
        let mut flags = 0;
        for command in cli.get_subcommands() {
            let text = brief(command);
            let (name, lines) = (command.get_name(), text.lines().count());
            assert!(lines <= 60, "{name}: {lines} lines\n{text}");
            let wide = text.lines().find(|line| line.chars().count() > WIDTH);
            assert!(wide.is_none(), "{name}: {wide:?}");
            for argument in shown(command) {
                let flag = argument.get_long().unwrap_or_default();
                assert!(text.contains(&format!("--{flag}")), "{name}: {flag}");
                flags += 1;
            }
        }
        assert!(flags <= 159, "{flags} flags");
    }
}
