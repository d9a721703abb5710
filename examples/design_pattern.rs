//! Designs a small pattern from a program of one's own, proves it and writes everything to a folder.
//!
//! `cargo run --release --example design_pattern -- my-ball`

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use spindoe::Result;
use spindoe::design::{Candidate, DesignConfig, DesignObserver, design};
use spindoe::report::{ProofConfig, prove};
use spindoe::stencil::StencilConfig;

/// Prints each candidate as it is judged.
struct Talk;

impl DesignObserver for Talk {
    fn candidate(&mut self, candidate: &Candidate, _best: Option<&Candidate>) -> Result<()> {
        println!(
            "start {}: objective {:.4}, identity {}",
            candidate.start, candidate.objective, candidate.validation.identity
        );
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
    let outcome = design(&config, &never, &mut Talk)?;
    let proof = ProofConfig::of_samples(2_000);
    let command = "the example design_pattern".to_owned();
    let proven = prove(&outcome, &config, &proof, command, &mut |_| ())?;
    let stencil = StencilConfig::default();
    proven.write(&dir, &stencil)?;
    proven.write_stencil(&dir, &stencil)?;
    println!("{}", dir.display());
    Ok(())
}
