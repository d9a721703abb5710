//! `spindoe completions` and `spindoe man`: what a shell and `man` need to know of the command.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;
use clap_complete::Shell;

use super::{command_line, stdout_error};
use crate::error::{Error, Result};
use crate::files::{self, Replacement};

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  spindoe completions bash > ~/.local/share/bash-completion/completions/spindoe
  spindoe completions zsh > ~/.zfunc/_spindoe
  spindoe completions fish > ~/.config/fish/completions/spindoe.fish")]
pub struct CompletionArguments {
    /// The shell.
    #[arg(value_enum)]
    shell: Shell,
}

/// Prints the completions of a shell.
pub fn completions(arguments: &CompletionArguments) -> Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut command_line(), "spindoe", &mut text);
    std::io::stdout().write_all(&text).map_err(stdout_error)
}

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  spindoe man -o ~/.local/share/man/man1 && man spindoe-design")]
pub struct ManArguments {
    /// The folder for spindoe.1 and one page for each command, spindoe-design.1 and so on.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// Writes the manual pages.
pub fn man(arguments: &ManArguments) -> Result<()> {
    let set = Replacement::begin(&arguments.output)?;
    let mut command = command_line();
    command.build();
    let write = |name: String, page: clap::Command| {
        let mut text = Vec::new();
        clap_mangen::Man::new(page)
            .title(name.to_uppercase())
            .render(&mut text)
            .map_err(|e| Error::Internal(format!("manual page {name}: {e}")))?;
        files::write_bytes(&set.path().join(format!("{name}.1")), &text)
    };
    for sub in command.get_subcommands().filter(|s| s.get_name() != "help") {
        let name = format!("spindoe-{}", sub.get_name());
        // `clap` keeps names for the length of the program.
        write(name.clone(), sub.clone().name(name.leak() as &'static str))?;
    }
    write("spindoe".to_owned(), command.clone())?;
    set.publish(&[], "spindoe.1")?;
    outln!("{}", arguments.output.display());
    Ok(())
}
