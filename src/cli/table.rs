//! `spindoe table`: the hash table that an estimator loads.

use std::path::PathBuf;

use clap::Args;

use super::pattern::PatternSource;
use crate::ball::PairRule;
use crate::error::Result;

#[derive(Debug, Args)]
#[command(after_help = "\
The archive opens with numpy.load: dots (n,3), features (m,3), bases (m,2), feature_dots (m,), meta
(UTF-8 JSON). Pairs of dots that cannot serve as a basis are excluded by the settings min_cross and
max_angle_deg; the archive's meta says so.

Example:
  spindoe table pattern.csv -o table.npz")]
pub struct Arguments {
    #[command(flatten)]
    pattern: PatternSource,
    /// The file to write.
    #[arg(short, long, value_name = "TABLE.npz")]
    output: PathBuf,
    /// Exclude pairs of dots whose cross product is shorter than this.
    #[arg(hide = true, long, value_name = "X", default_value_t = PairRule::default().min_cross)]
    min_cross: f64,
    /// Exclude pairs of dots farther apart than this, degrees.
    #[arg(hide = true, long, value_name = "DEG", default_value_t = 170.0)]
    max_angle_deg: f64,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let rule = PairRule {
        min_cross: arguments.min_cross,
        max_angle_rad: arguments.max_angle_deg.to_radians(),
    };
    let ball = arguments.pattern.ball()?.with_pair_rule(rule)?;
    ball.write_npz(&arguments.output)?;
    let dots = ball.pattern().dots();
    errln!(
        "{}: {} features of {} dots",
        arguments.output.display(),
        rule.count(dots)?,
        dots.len()
    );
    Ok(())
}
