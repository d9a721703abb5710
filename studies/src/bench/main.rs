//! `bench`: what is measured and derived, one subcommand each.
//!
//!     cargo run --release -p spindoe-studies --bin bench -- --help

mod derive;
mod trust;

use std::error::Error;
use std::path::PathBuf;

use clap::{Parser, Subcommand};

/// Seed of all trials on which answers' trust is shown; no parameter was tuned on them.
const TRUST_SEED: u64 = 14_140_001;

#[derive(Parser)]
#[command(
    name = "bench",
    about = "Measures and derives what docs/ and models/ say."
)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Derive the numbers that follow from nets and synthetic world, where their inputs have changed.
    Derive {
        /// The file of derived numbers, read and written.
        #[arg(long, default_value = "models/derived.json")]
        out: PathBuf,
        /// Images for each of the designs.
        #[arg(long, default_value_t = derive::Settings::default().images)]
        images: u64,
        /// Rounds of the fit; each estimates with the map of the one before, the first with none.
        #[arg(long, default_value_t = derive::Settings::default().rounds)]
        rounds: u64,
        /// Seed of the images.
        #[arg(long, default_value_t = derive::Settings::default().seed)]
        seed: u64,
        /// Derive what is up to date, too.
        #[arg(long)]
        force: bool,
    },
    /// Files of frames that are told nothing, against the same told the protocol.
    Conditions {
        /// Trials a row.
        #[arg(default_value_t = 10_000)]
        trials: u64,
        /// Seed of the trials.
        #[arg(default_value_t = TRUST_SEED)]
        seed: u64,
    },
    /// Spins reported of random orientations.
    Spins {
        /// Files.
        #[arg(default_value_t = 10_000)]
        files: u64,
        /// Seed of the files.
        #[arg(default_value_t = TRUST_SEED)]
        seed: u64,
    },
    /// The confidences that are claimed, compared with the truth.
    Confidence {
        /// Images for each of the designs.
        #[arg(default_value_t = 12_000)]
        images: u64,
        /// Seed of the images.
        #[arg(default_value_t = TRUST_SEED)]
        seed: u64,
    },
    /// Single images that do not show the ball.
    Kinds {
        /// Images of a kind.
        #[arg(default_value_t = 3_000)]
        images: u64,
        /// Seed of the images.
        #[arg(default_value_t = TRUST_SEED)]
        seed: u64,
        /// Beginnings of the kinds' names, or the design of the table; all kinds and dots20 by default.
        kinds: Vec<String>,
    },
    /// Verdicts over clips on the right, a wrong and a mirrored table.
    Tables {
        /// Frames.
        #[arg(default_value_t = 1_000)]
        frames: u64,
        /// Seed of the frames.
        #[arg(default_value_t = TRUST_SEED)]
        seed: u64,
    },
}

fn main() -> Result<(), Box<dyn Error>> {
    match Arguments::parse().command {
        Command::Derive {
            out,
            images,
            rounds,
            seed,
            force,
        } => {
            let settings = derive::Settings {
                images,
                rounds,
                seed,
            };
            derive::run(&out, &settings, force)?;
        }
        Command::Conditions { trials, seed } => trust::conditions::print(trials, seed)?,
        Command::Spins { files, seed } => trust::spins::print(files, seed)?,
        Command::Confidence { images, seed } => trust::kinds::confidence(images, seed)?,
        Command::Kinds {
            images,
            seed,
            kinds,
        } => trust::kinds::print(images, seed, &kinds)?,
        Command::Tables { frames, seed } => trust::tables::print(frames, seed)?,
    }
    Ok(())
}
