//! `spindoe validate`.

use std::path::PathBuf;

use clap::Args;

use crate::error::{Error, Result};
use crate::pattern::Pattern;
use crate::recognise::robust::RobustRecogniser;
use crate::validate::{Protocol, ProtocolName, Validation, validate};

#[derive(Debug, Args)]
pub struct Arguments {
    /// The pattern, a CSV of unit vectors x,y,z.
    pattern: PathBuf,
    /// How the views are made.
    #[arg(long, value_enum, default_value = "paper")]
    protocol: ProtocolName,
    /// Number of trials.
    #[arg(long, default_value_t = 10_000)]
    samples: u64,
    /// Noise in degrees, instead of the protocol's own.
    #[arg(long, allow_negative_numbers = true)]
    sigma_deg: Option<f64>,
    /// Seed of the trials.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print one JSON object instead of words.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let pattern = Pattern::read_csv(&arguments.pattern)?;
    let mut protocol = Protocol::standard(arguments.protocol);
    if let Some(sigma) = arguments.sigma_deg {
        protocol = protocol.with_sigma_rad(sigma.to_radians());
    }
    let recogniser = RobustRecogniser::new(&pattern, protocol.recogniser_config())?;
    let found = validate(
        &pattern,
        &recogniser,
        &protocol,
        arguments.seed,
        arguments.samples,
    )?;
    if arguments.json {
        let mut json = serde_json::to_value(&found)
            .map_err(|e| Error::Internal(format!("report as JSON: {e}")))?;
        json["recognizer"] = "robust".into();
        println!("{json}");
    } else {
        print_words(&found);
    }
    Ok(())
}

fn print_words(v: &Validation) {
    println!(
        "{} protocol, noise {:.3} deg, {} trials (seed {}), {} skipped for too few dots",
        v.protocol, v.sigma_deg, v.samples, v.seed, v.skipped
    );
    println!("  identity     {}", v.identity);
    println!("  orientation  {}", v.orientation);
    println!(
        "  error of the successes  mean {:.3} deg, median {:.3} deg",
        v.mean_error_deg, v.median_error_deg
    );
    println!(
        "  {:.1} us an identification (median {:.1})",
        v.us_per_identification, v.median_us_per_identification
    );
}
