//! `spindoe certify`: the noise that a pattern tolerates for certain.

use std::path::PathBuf;

use clap::Args;

use super::print_json;
use crate::certify::{Certificate, CertifyConfig, MAX_COUNT, MIN_COUNT, TakenFor, certify};
use crate::error::Result;
use crate::pattern::Pattern;

#[derive(Debug, Args)]
#[command(after_help = "\
As long as every detected dot is displaced by less than the guaranteed angle, no other explanation of the
dots is as good as the right one. The certificate states it for 3 to 8 detected dots, for confusions with
other dots and with the pattern's mirror image, with an example of each nearest confusion.

Examples:
  spindoe certify pattern.csv -o certificate.json
  spindoe certify pattern.csv --check certificate.json")]
pub struct Arguments {
    /// A pattern: CSV of unit vectors x,y,z.
    #[arg(value_name = "PATTERN.csv")]
    pattern: PathBuf,
    /// Write the certificate to this file.
    #[arg(short, long, value_name = "CERTIFICATE.json", conflicts_with = "check")]
    output: Option<PathBuf>,
    /// Verify this certificate instead of making one.
    #[arg(long, value_name = "CERTIFICATE.json")]
    check: Option<PathBuf>,
    /// Minimum z of a dot that can be detected.
    #[arg(long, value_name = "Z", default_value_t = CertifyConfig::default().visibility_limit, allow_negative_numbers = true, conflicts_with = "check")]
    visibility_limit: f64,
    /// The guaranteed angle may lie below the true one by this much, degrees.
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 0.02,
        allow_negative_numbers = true,
        conflicts_with = "check"
    )]
    tolerance_deg: f64,
    /// Print the certificate as one JSON object instead of words.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let pattern = Pattern::read_csv(&arguments.pattern)?;
    let certificate = match &arguments.check {
        Some(path) => {
            let certificate = Certificate::read(path)?;
            certificate.check(&pattern)?;
            errln!("{}: verified", path.display());
            certificate
        }
        None => {
            let config = CertifyConfig {
                visibility_limit: arguments.visibility_limit,
                tolerance_rad: arguments.tolerance_deg.to_radians(),
            };
            let certificate = certify(&pattern, &config)?;
            if let Some(path) = &arguments.output {
                certificate.write(path)?;
            }
            certificate
        }
    };
    if arguments.json {
        return print_json(&certificate);
    }
    print_words(&certificate);
    Ok(())
}

/// The guarantees in words.
pub(super) fn print_words(certificate: &Certificate) {
    let angle = |taken_for, detected| {
        certificate
            .guarantee(taken_for, detected)
            .map_or("-".to_owned(), |g| {
                format!("{:.2}", g.guaranteed_rad.to_degrees())
            })
    };
    outln!("No confusion while every dot is displaced by less than this, degrees:");
    outln!("{:>9} {:>12} {:>12}", "detected", "other dots", "mirrored");
    for detected in MIN_COUNT..=MAX_COUNT {
        let [others, mirrored] = TakenFor::ALL.map(|t| angle(t, detected));
        outln!("{detected:>9} {others:>12} {mirrored:>12}");
    }
    outln!(
        "Every view shows at least {} dots with z > {}; others than the detected ones may be missed.",
        certificate.min_visible,
        certificate.visibility_limit
    );
}
