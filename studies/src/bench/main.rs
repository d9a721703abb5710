//! `bench`: what is measured and derived, one subcommand each.
//!
//!     cargo run --release -p spindoe-studies -- --help

mod calibration;
mod calibration_bound;
mod calibration_unknown;
mod camera_family;
mod camera_race;
mod cost;
mod derive;
mod detection_limit;
mod frames;
mod latency;
mod mirror;
mod noise;
mod objectives;
mod objectives_images;
mod outlines;
mod rebuild;
mod recognizer;
mod residuals;
mod robustness;
mod sequences;
mod spin_coverage;
mod spin_decay;
mod spin_rates;
mod stencils;
mod tables;
mod targets;
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
    /// Rates, errors, confidences and failures of the recognizers on simulated views.
    Recognizer(recognizer::Args),
    /// Accuracy on synthetic frames, each alone: dots, orientations, confidences, times.
    Frames(frames::Args),
    /// How near outlines are to the truth, and what their failures cost.
    Outlines(outlines::Args),
    /// What the pixels of a frame show at most.
    DetectionLimit(detection_limit::Args),
    /// Whether named dots are off by as much as their covariances state.
    Residuals(residuals::Args),
    /// What degraded images cost.
    Robustness(robustness::Args),
    /// How often images that show no ball are answered.
    Noise(noise::Args),
    /// How often a flipped camera is told apart.
    Mirror(mirror::Args),
    /// How much the frames of a sequence help each other.
    Sequences(sequences::Args),
    /// What a frame costs that is answered, and one that is not.
    Cost(cost::Args),
    /// How long a frame takes, live.
    Latency(latency::Args),
    /// Whether a spin's covariance says how well it is known, from images.
    SpinCoverage(spin_coverage::Args),
    /// Rates and errors of the spin estimators on simulated orientations.
    SpinRates(spin_rates::Args),
    /// Coverage of the interval of a spin's decay.
    SpinDecay(spin_decay::Args),
    /// Patterns on the same rendered frames of one camera.
    CameraFamily(camera_family::Args),
    /// Whether a race of patterns finds the order of many more frames.
    CameraRace(camera_race::Args),
    /// How well objectives predict simulated failures.
    Objectives(objectives::Args),
    /// How well objectives predict failures on rendered frames, for any number of dots.
    ObjectivesImages(objectives_images::Args),
    /// Patterns of 20 dots on the same trials: random, spread, published, own.
    Targets(targets::Args),
    /// What a calibration is worth on rendered clips.
    Calibration(calibration::Args),
    /// The calibration against the Cramér-Rao bound.
    CalibrationBound(calibration_bound::Args),
    /// Patterns built from rendered clips alone.
    CalibrationUnknown(calibration_unknown::Args),
    /// Stencils of many random patterns, for `tests/python/check_stencils.py`.
    Stencils(stencils::Args),
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
    /// Make anew what follows from the synthetic world: nets, derived numbers, tables.
    Rebuild(rebuild::Args),
    /// Make anew the tables that stand in docs/.
    Tables(tables::Args),
    /// Files of frames that are told nothing, against the same told the protocol.
    Conditions {
        /// Trials a row.
        #[arg(long, default_value_t = 10_000)]
        trials: u64,
        /// Seed of the trials.
        #[arg(long, default_value_t = TRUST_SEED)]
        seed: u64,
    },
    /// Spins reported of random orientations.
    Spins {
        /// Files.
        #[arg(long, default_value_t = 10_000)]
        files: u64,
        /// Seed of the files.
        #[arg(long, default_value_t = TRUST_SEED)]
        seed: u64,
    },
    /// The confidences that are claimed, compared with the truth.
    Confidence {
        /// Images for each of the designs.
        #[arg(long, default_value_t = 12_000)]
        images: u64,
        /// Seed of the images.
        #[arg(long, default_value_t = TRUST_SEED)]
        seed: u64,
    },
    /// Single images that do not show the ball.
    Kinds {
        /// Images of a kind.
        #[arg(long, default_value_t = 3_000)]
        images: u64,
        /// Seed of the images.
        #[arg(long, default_value_t = TRUST_SEED)]
        seed: u64,
        /// Beginnings of the kinds' names, or the design of the table; all kinds and dots20 by default.
        kinds: Vec<String>,
    },
    /// Verdicts over clips on the right, a wrong and a mirrored table.
    Verdicts {
        /// Frames.
        #[arg(long, default_value_t = 1_000)]
        frames: u64,
        /// Seed of the frames.
        #[arg(long, default_value_t = TRUST_SEED)]
        seed: u64,
    },
}

fn main() -> Result<(), Box<dyn Error>> {
    match Arguments::parse().command {
        Command::Recognizer(args) => args.run()?,
        Command::Frames(args) => args.run()?,
        Command::Outlines(args) => args.run()?,
        Command::DetectionLimit(args) => args.run()?,
        Command::Residuals(args) => args.run()?,
        Command::Robustness(args) => args.run().map_err(|e| e as Box<dyn Error>)?,
        Command::Noise(args) => args.run()?,
        Command::Mirror(args) => args.run().map_err(|e| e as Box<dyn Error>)?,
        Command::Sequences(args) => args.run()?,
        Command::Cost(args) => args.run()?,
        Command::Latency(args) => args.run()?,
        Command::SpinCoverage(args) => args.run()?,
        Command::SpinRates(args) => args.run(),
        Command::SpinDecay(args) => args.run(),
        Command::CameraFamily(args) => args.run()?,
        Command::CameraRace(args) => args.run()?,
        Command::Objectives(args) => args.run()?,
        Command::ObjectivesImages(args) => args.run().map_err(|e| e as Box<dyn Error>)?,
        Command::Targets(args) => args.run()?,
        Command::Calibration(args) => args.run()?,
        Command::CalibrationBound(args) => args.run()?,
        Command::CalibrationUnknown(args) => args.run()?,
        Command::Stencils(args) => args.run()?,
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
        Command::Rebuild(args) => args.run()?,
        Command::Tables(args) => args.run()?,
        Command::Conditions { trials, seed } => trust::conditions::print(trials, seed)?,
        Command::Spins { files, seed } => trust::spins::print(files, seed)?,
        Command::Confidence { images, seed } => trust::kinds::confidence(images, seed)?,
        Command::Kinds {
            images,
            seed,
            kinds,
        } => trust::kinds::print(images, seed, &kinds)?,
        Command::Verdicts { frames, seed } => trust::verdicts::print(frames, seed)?,
    }
    Ok(())
}
