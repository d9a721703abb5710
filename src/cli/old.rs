//! Names of before the commands had three levels: for this release they answer with the new ones.

use std::ffi::OsString;

use clap::error::{ContextKind, ContextValue, ErrorKind};

/// Commands that are gone, with what does their work.
const COMMANDS: [(&str, &str); 8] = [
    ("compare", "spindoe validate PATTERN PATTERN"),
    (
        "sensitivity",
        "spindoe validate PATTERN --sweep noise -o DIR",
    ),
    ("sample", "spindoe synth"),
    ("simulate", "spindoe synth --as orientations"),
    ("export", "Python's spindoe.write_onnx"),
    ("trajectories", "Python's spindoe.read_trajectories"),
    ("train", "python -m train"),
    ("certify", "spindoe validate"),
];
/// Flags that have another name, by command; "" for all commands.
const FLAGS: [(&str, &str, &str); 27] = [
    ("", "out", "--output"),
    ("", "ball-pixels", "--ball-px"),
    ("", "hole-diameter-mm", "--dot-diameter-mm"),
    ("", "page", "--sheet"),
    ("", "paper", "--sheet"),
    ("", "golf", "--preset golf"),
    ("design", "from", "a PATTERN without a flag"),
    ("design", "render", "--config camera_frames=N"),
    ("validate", "dump", "`spindoe synth PATTERN --as dots`"),
    ("advise", "frames", "--samples"),
    ("report", "plots", "--pictures png,svg"),
    ("identify", "expect", "--protocol"),
    ("identify", "sigma-deg", "--dot-sigma-deg"),
    ("estimate", "circles", "--circle"),
    ("estimate", "precession", "--motion precessing"),
    ("estimate", "follow", "`spindoe live`"),
    ("estimate", "raw", "`spindoe live --raw`"),
    (
        "estimate",
        "max-latency-ms",
        "`spindoe live --max-latency-ms`",
    ),
    ("calibrate", "circles", "--config circle=U,V,R"),
    ("spin", "sigma-deg", "--config orientation_sigma_deg=S"),
    ("spin", "decay", "--motion decaying"),
    ("spin", "precession", "--motion precessing"),
    ("spin", "plot", "--picture"),
    ("synth", "sequence", "--as clip"),
    ("synth", "size", "--config size_px=LOW,HIGH"),
    ("synth", "min-size", "--config size_px=LOW,HIGH"),
    ("synth", "max-size", "--config size_px=LOW,HIGH"),
];

/// Values of a flag that are gone, with what does their work.
const VALUES: [(&str, &str, &str); 2] = [
    (
        "--sweep",
        "alpha",
        "--config sweep_alpha=0.003,0.01,0.03,0.1,0.3,1",
    ),
    ("--recognizer", "paper", "--config recognizer=voting"),
];

/// What replaces a name that these arguments use and that is no more; one line.
pub(super) fn replacement(error: &clap::Error, arguments: &[OsString]) -> Option<String> {
    let name = |kind| match error.get(kind) {
        Some(ContextValue::String(name)) => Some(name.as_str()),
        _ => None,
    };
    match error.kind() {
        ErrorKind::InvalidSubcommand => {
            let name = name(ContextKind::InvalidSubcommand)?;
            let (_, new) = COMMANDS.iter().find(|(old, _)| *old == name)?;
            Some(format!("{name} is now {new}"))
        }
        ErrorKind::UnknownArgument => {
            let flag = name(ContextKind::InvalidArg)?;
            let old = flag.trim_start_matches('-');
            let is_of = |command: &str| {
                command.is_empty() || arguments.iter().any(|a| a.to_str() == Some(command))
            };
            let found = FLAGS
                .iter()
                .find(|(command, flag, _)| *flag == old && is_of(command));
            found.map(|(_, _, new)| format!("{flag} is now {new}"))
        }
        ErrorKind::InvalidValue => {
            let (flag, value) = (
                name(ContextKind::InvalidArg)?,
                name(ContextKind::InvalidValue)?,
            );
            let flag = flag.split(' ').next()?;
            let found = VALUES
                .iter()
                .find(|(of, old, _)| *of == flag && *old == value);
            found.map(|(.., new)| format!("{flag} {value} is now {new}"))
        }
        _ => None,
    }
}
