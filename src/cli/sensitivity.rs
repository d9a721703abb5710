//! `spindoe sensitivity`: how the rates depend on noise and on the paper's alpha.

use std::path::PathBuf;

use clap::Args;

use super::output::{Counter, one_of};
use super::{print_json, read_table};
use crate::error::Result;
use crate::files;
use crate::validate::{Protocol, ProtocolName, SensitivityConfig, sensitivity, sensitivity_csv};

#[derive(Debug, Args)]
#[command(after_help = "\
Writes sensitivity.csv, sensitivity_sigma.png and sensitivity_alpha.png.

Example:
  spindoe sensitivity pattern.csv -o sweep --protocol clutter --samples 5000")]
pub struct Arguments {
    /// A pattern (CSV of unit vectors x,y,z) or a hash table (.npz).
    #[arg(value_name = "PATTERN_OR_TABLE")]
    input: PathBuf,
    /// The folder to write to.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Protocol of the views.
    #[arg(long, value_parser = one_of(&ProtocolName::ALL, ProtocolName::as_str), default_value_t = ProtocolName::Paper)]
    protocol: ProtocolName,
    /// Trials per point.
    #[arg(long, value_name = "N", default_value_t = 2_000)]
    samples: u64,
    /// Seed of the trials.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Noise levels in degrees, for both recognizers.
    #[arg(long, value_name = "S,S,...", value_delimiter = ',', num_args = 0..,
          default_values_t = SensitivityConfig::default().sigmas_deg)]
    sigmas_deg: Vec<f64>,
    /// Values of alpha, for the paper's recognizer at the protocol's own noise.
    #[arg(long, value_name = "A,A,...", value_delimiter = ',', num_args = 0..,
          default_values_t = SensitivityConfig::default().alphas)]
    alphas: Vec<f64>,
    /// Print the points as one JSON array.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let table = read_table(&arguments.input)?;
    let config = SensitivityConfig {
        sigmas_deg: arguments.sigmas_deg.clone(),
        alphas: arguments.alphas.clone(),
        samples: arguments.samples,
        seed: arguments.seed,
    };
    let dir = &arguments.output;
    files::create_dir(dir)?;
    let protocol = Protocol::standard(arguments.protocol);
    let count = 2 * config.sigmas_deg.len() + config.alphas.len();
    let counter = Counter::new(count as u64, "points");
    let points = sensitivity(&table, &protocol, &config, &mut |p| {
        let v = &p.result.validation;
        counter.line(&format!(
            "{} {:>6}  {:<6}  identity {}  orientation {}",
            p.parameter.as_str(),
            p.value,
            p.result.recognizer,
            v.identity,
            v.orientation
        ));
        counter.add(1);
    })?;
    counter.finish();
    let csv = sensitivity_csv(&points);
    files::write_bytes(&dir.join("sensitivity.csv"), csv.as_bytes())?;
    #[cfg(feature = "plot")]
    crate::report::plots::sensitivity_plots(dir, &points)?;
    if arguments.json {
        return print_json(&points);
    }
    outln!("{}", dir.display());
    Ok(())
}
