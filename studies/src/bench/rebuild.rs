//! Everything that follows from the synthetic world, in order: nets, derived numbers, tables.
//!
//! Each step keeps what is up to date: a net that the same command made in the same world, numbers whose inputs are as they
//! were.

use std::path::PathBuf;
use std::process::Command;

use spindoe_studies::Outcome;

/// Files whose tables depend on the nets.
const TABLES: [&str; 2] = [
    "docs/measurements/detector.md",
    "docs/measurements/trust.md",
];

#[derive(clap::Args)]
pub struct Args {
    /// The Python that has PyTorch, and the package of this clone.
    #[arg(long, default_value = "python3")]
    python: PathBuf,
    /// From nothing: what is up to date, too.
    #[arg(long)]
    force: bool,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let command = || {
            let mut command = Command::new(&self.python);
            command.current_dir("python");
            command
        };
        let has = command().args(["-c", "import torch, spindoe"]).status();
        if !has.is_ok_and(|status| status.success()) {
            return Err(format!(
                "{}: expected a Python with torch and spindoe (maturin develop --release in python/)",
                self.python.display()
            )
            .into());
        }
        let force = self.force.then_some("--force");
        let status = command()
            .args(["-m", "train", "--output", "../models"])
            .args(force)
            .status()?;
        if !status.success() {
            return Err(format!("python -m train: {status}").into());
        }
        // The nets are part of the program: what runs from here on is built with the new ones.
        let derive = ["derive"].into_iter().chain(force).collect();
        for step in [derive, vec!["tables", TABLES[0], TABLES[1]]] {
            let status = Command::new(env!("CARGO"))
                .args(["run", "--release", "-p", "spindoe-studies", "--"])
                .args(&step)
                .status()?;
            if !status.success() {
                return Err(format!("bench {}: {status}", step.join(" ")).into());
            }
        }
        Ok(())
    }
}
