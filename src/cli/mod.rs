//! The command line: arguments in, library calls, words and files out.
//!
//! Exit codes: 0 done; 2 unusable arguments or input, with one line that says which; 1 anything else.

mod stencil;
mod validate;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::error::Result;

/// Designs dot patterns for balls, proves them, and ships what is needed to use them.
#[derive(Debug, Parser)]
#[command(name = "spindoe", version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Measure how often a pattern's dots are identified rightly, by Monte Carlo.
    Validate(validate::Arguments),
    /// Make the stencil that draws a pattern on a ball: two printable halves.
    Stencil(Box<stencil::Arguments>),
}

/// Runs the command with the process' arguments.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let done: Result<()> = match cli.command {
        Command::Validate(arguments) => validate::run(&arguments),
        Command::Stencil(arguments) => stencil::run(&arguments),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("spindoe: {error}");
            ExitCode::from(if error.is_usage() { 2 } else { 1 })
        }
    }
}
