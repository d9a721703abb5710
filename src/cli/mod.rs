//! The command line: arguments in, library calls, words and files out.
//!
//! Exit codes: 0 done; 2 unusable arguments or input, with one line that says which; 1 anything else.

mod simulate;
mod spin;
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
    /// Estimate the spin from time-stamped orientations.
    Spin(spin::Arguments),
    /// Simulate orientations of a turning ball, with a known truth.
    Simulate(simulate::Arguments),
}

/// Runs the command with the process' arguments.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let done: Result<()> = match cli.command {
        Command::Validate(arguments) => validate::run(&arguments),
        Command::Spin(arguments) => spin::run(&arguments),
        Command::Simulate(arguments) => simulate::run(&arguments),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("spindoe: {error}");
            ExitCode::from(if error.is_usage() { 2 } else { 1 })
        }
    }
}
