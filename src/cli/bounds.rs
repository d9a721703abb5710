//! The bounds of every number among the arguments, by the flag's name: one flag means the same in all commands.
//!
//! They keep out what has no meaning (a frame rate of 1e308, an angle that is no number, as many rounds as a
//! computer's word can count), before any work begins. What only one command or the library rejects, such as a
//! spin beyond what its frames can show, is checked there.

use clap::builder::ValueParser;
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command, value_parser};

use crate::error::{Error, Result};

/// Smallest number that is not 0: squares and inverses of it are still numbers.
const SMALLEST: f64 = 1e-9;

/// Flags, or how their names end, with their minimum and maximum.
const BOUNDS: [(&str, f64, f64); 30] = [
    ("fps", 1e-3, 1e7),
    ("rps", 0.0, 1e4),
    ("-rps", 0.0, 1e4),
    ("sigma-deg", 0.0, 180.0),
    ("-sigma-deg", 0.0, 180.0),
    ("min-separation-deg", 0.0, 180.0),
    ("seam-margin-deg", 0.0, 60.0),
    ("-deg", 0.0, 360.0),
    ("-mm", 0.0, 1e4),
    ("ball-mass-g", 0.0, 1e6),
    ("drift-px", -1e6, 1e6),
    ("-px", 0.0, 1e6),
    ("-pixels", 0.0, 1e10),
    ("pixel-noise", 0.0, 1e3),
    ("blur", 0.0, 1e4),
    ("circle", -1e6, 1e6),
    // A rotation vector of a whole turn at most.
    ("c2a-r", -6.3, 6.3),
    ("intrinsics", -1e7, 1e7),
    // Parallel rays come from infinity.
    ("camera-distance-radii", 0.0, f64::INFINITY),
    ("decay-per-s", 0.0, 1e3),
    ("jitter", 0.0, 1.0),
    ("outliers", 0.0, 1.0),
    ("drops", 0.0, 1.0),
    ("-confidence", 0.0, 1.0),
    ("bound-goal", 0.0, 1e9),
    ("starts", 1.0, 1e6),
    ("rounds", 1.0, 1e6),
    ("frames", 1.0, 1e7),
    // Trials are bounded where they are drawn; any seed will do.
    ("samples", 0.0, f64::INFINITY),
    ("seed", 0.0, f64::INFINITY),
];
/// The bounds of other numbers.
const OTHERS: (f64, f64) = (0.0, 1e9);

/// The bounds of a flag's numbers; none for one that takes no numbers.
fn bounds(argument: &Arg) -> Option<(f64, f64)> {
    let flag = argument.get_long()?;
    let named = BOUNDS
        .iter()
        .find(|(name, ..)| match name.strip_prefix('-') {
            Some(_) => flag.ends_with(name),
            None => flag == *name,
        });
    let kind = argument.get_value_parser().type_id();
    let numbers = [
        ValueParser::from(value_parser!(f64)),
        value_parser!(usize).into(),
        value_parser!(u64).into(),
    ];
    let is_number = numbers.iter().any(|number| number.type_id() == kind);
    named
        .map(|(_, low, high)| (*low, *high))
        .or(is_number.then_some(OTHERS))
}

/// Checks the numbers that were given to a command.
///
/// # Errors
/// [`Error::Argument`] that names the flag, its bounds and the number.
pub(super) fn check(command: &Command, given: &ArgMatches) -> Result<()> {
    for argument in command.get_arguments() {
        let id = argument.get_id().as_str();
        let Some((low, high)) = bounds(argument) else {
            continue;
        };
        if given.value_source(id) != Some(ValueSource::CommandLine) {
            continue;
        }
        for value in given.get_raw(id).into_iter().flatten() {
            let value = value.to_string_lossy();
            for (text, number) in value
                .split(',')
                .filter_map(|t| Some((t, t.trim().parse::<f64>().ok()?)))
            {
                let expected = match number {
                    x if !(low..=high).contains(&x) => format!("{low} to {high}"),
                    x if x != 0.0 && x.abs() < SMALLEST => format!("0 or at least {SMALLEST:e}"),
                    _ => continue,
                };
                let flag = argument.get_long().unwrap_or(id);
                let problem = format!("expected {expected}, found {}", text.trim());
                return Err(Error::argument(format!("--{flag}"), problem));
            }
        }
    }
    Ok(())
}
