//! Designs a small pattern from a program of one's own, proves it and writes everything to a folder.
//!
//! `cargo run --release --example design_pattern -- my-ball`

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use spindoe::Result;
use spindoe::design::checkpoint::SearchState;
use spindoe::design::{DesignConfig, DesignObserver, Stage, design};
use spindoe::report::{EvaluationConfig, evaluate};
use spindoe::stencil::StencilConfig;

/// Prints the best rate after each piece of work.
struct Talk;

impl DesignObserver for Talk {
    fn progress(&mut self, state: &SearchState, stage: Stage) -> Result<()> {
        if let Some(best) = state.pool.first().and_then(|c| c.identity) {
            println!("{stage:?}: best identity rate so far {best}");
        }
        Ok(())
    }
}

fn main() -> Result<()> {
    let dir = PathBuf::from(std::env::args().nth(1).unwrap_or("my-ball".into()));
    let config = DesignConfig {
        starts: 4,
        samples: 2_000,
        seed: 42,
        ..DesignConfig::default()
    };
    let never = AtomicBool::new(false);
    let outcome = design(&config, &mut SearchState::default(), &never, &mut Talk)?;
    let proof = EvaluationConfig::of_samples(2_000);
    let command = "the example design_pattern".to_owned();
    let proven = evaluate(&outcome, &config, &proof, command, &mut |_| ())?;
    let stencil = StencilConfig::default();
    proven.write(&dir, &stencil)?;
    proven.write_stencil(&dir, &stencil)?;
    println!("{}", dir.display());
    Ok(())
}
