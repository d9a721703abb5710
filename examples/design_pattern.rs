//! Designs a small pattern from a program, evaluates it and writes everything to a folder.
//!
//! `cargo run --release --example design_pattern -- my-ball`

use std::sync::atomic::AtomicBool;

use spindoe::Result;
use spindoe::design::{DesignConfig, DesignObserver, SearchState, Stage};
use spindoe::report::{DesignJob, JobObserver, JobStart};

/// Prints the best rate after each piece of work, and the stages after the search.
struct Printer;

impl DesignObserver for Printer {
    fn progress(&mut self, state: &SearchState, stage: Stage) -> Result<()> {
        if let Some(best) = state.best().and_then(|c| c.answered) {
            println!("{stage:?}: best identity rate so far {best}");
        }
        Ok(())
    }
}

impl JobObserver for Printer {
    fn step(&mut self, what: &str) -> Result<()> {
        println!("{what}");
        Ok(())
    }
}

fn main() -> Result<()> {
    let dir = std::env::args().nth(1).unwrap_or("my-ball".into());
    let config = DesignConfig {
        starts: 4,
        samples: 2_000,
        seed: 42,
        ..DesignConfig::default()
    };
    let job = DesignJob::of(config, dir);
    let never = AtomicBool::new(false);
    let found = job.run(JobStart::Fresh, &never, &mut Printer)?;
    for v in &found.report.validation {
        println!(
            "{} {}: {}",
            v.recognizer, v.validation.protocol, v.validation.answered
        );
    }
    println!("{}", job.dir.display());
    Ok(())
}
