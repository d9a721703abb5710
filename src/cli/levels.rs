//! The commands in three levels, as `spindoe --help` shows them, and `spindoe help`.

use std::fmt::Write as _;

use clap::{Args, Command};

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
            "spin",
        ],
    ),
    ("Experiments", &["validate", "identify", "synth"]),
    (
        "For scripts",
        &["table", "merge", "report", "completions", "man", "help"],
    ),
];
/// Levels that are shown where not all are asked for.
const SHOWN: usize = 2;

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
        Some(name) => cli.find_subcommand(name).cloned().ok_or_else(|| {
            let problem = format!("expected a command of `spindoe help --all`, found {name}");
            Error::argument("command", problem)
        })?,
    };
    super::write_stdout(chosen.render_long_help().to_string().as_bytes())
}
