//! Observed dots of single frames, as a detector would report them.

use serde_json::json;

use super::Arguments;
use crate::error::Result;
use crate::files;
use crate::recognize::observed::{self, observed_frames};
use crate::validate::check_samples;
use crate::view::{Protocol, ProtocolName};

/// Frames where their number is not given.
const FRAMES: usize = 1_000;

/// Writes the views of a protocol, the same as `spindoe validate` draws from this seed.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let path = arguments.file()?;
    files::check_writable(path)?;
    let protocol = Protocol::standard(arguments.protocol.unwrap_or(ProtocolName::Paper));
    let frames = arguments.frames.unwrap_or(FRAMES) as u64;
    check_samples(frames)?;
    let ball = arguments.ball()?;
    let seen = observed_frames(ball.pattern(), protocol.view(), arguments.seed, frames);
    files::write_bytes(path, observed::to_csv(&seen).as_bytes())?;
    if arguments.json {
        return crate::cli::print_json(&json!({
            "output": path.to_string_lossy(),
            "protocol": protocol.name(),
            "frames": seen.len(),
            "skipped": frames - seen.len() as u64,
            "seed": arguments.seed,
        }));
    }
    outln!(
        "{}: {} frames of protocol {} (seed {}); {} left out for too few dots",
        path.display(),
        seen.len(),
        protocol.name(),
        arguments.seed,
        frames - seen.len() as u64
    );
    Ok(())
}
