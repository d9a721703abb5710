//! Clips of one ball by the cameras of a rig.

use std::path::Path;
use std::time::Instant;

use serde_json::json;

use super::Arguments;
use super::images::MAX_FRAMES;
use crate::cli::output::Counter;
use crate::error::{Result, require};
use crate::files;
use crate::synth::folder::{self, Masks, Origin, Written};
use crate::synth::rig::{RigSequence, to_yaml};
use crate::vision::Rig;

/// Frames of each camera where their number is not given.
const FRAMES: usize = 24;
/// The rig's file beside the cameras' folders.
const FILE: &str = "rig.yaml";

pub(super) fn run(arguments: &Arguments, path: &Path) -> Result<()> {
    let rig = Rig::read(path)?;
    let yaml = to_yaml(&rig)?;
    let ball = arguments.ball()?;
    let config = arguments.synth_config(&ball)?;
    let clip = arguments.clip_config(&config)?.unwrap_or_default();
    let frames = arguments.frames.unwrap_or(FRAMES);
    let inside = (1..=MAX_FRAMES).contains(&frames);
    require(inside, "frames", "1 to 1000000", frames)?;
    let [diameter_mm, _] = ball.sizes_mm(None, None);
    let (pattern, seed) = (ball.pattern(), arguments.seed);
    let sequence = RigSequence::random(
        pattern,
        &config,
        &clip,
        &rig,
        0.5e-3 * diameter_mm,
        seed,
        frames,
    )?;
    for name in rig.names() {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
        let inside = !name.is_empty() && name.chars().all(is_plain);
        let expected = "camera names of letters, digits, - and _: they name folders";
        require(inside, "rig", expected, name)?;
    }
    if let Some(output) = arguments.output.as_ref().filter(|_| !arguments.overwrite) {
        let taken: Vec<&str> = rig.names().into_iter().chain([FILE]).collect();
        let advice = "choose another folder, or --overwrite it";
        files::reject_taken(output, &taken, "frames", advice)?;
    }
    let (output, set) = arguments.begin()?;
    let clock = Instant::now();
    let counter = Counter::new((frames * rig.cameras().len()) as u64, "frames");
    let masks = if arguments.masks {
        Masks::Write
    } else {
        Masks::Omit
    };
    let mut all: Vec<Written> = Vec::new();
    for (k, camera) in rig.cameras().iter().enumerate() {
        let own = set.path().join(&camera.name);
        files::create_dir(&own)?;
        ball.write_csv(&own.join("pattern.csv"))?;
        ball.write_npz(&own.join("table.npz"))?;
        let origin = Origin {
            seed,
            pattern_sha256: pattern.sha256(),
            pattern: pattern.dots().iter().map(|d| (*d).into()).collect(),
            config: config.clone(),
            sequence: Some(sequence.taken(k, &clip)),
            strobe: None,
        };
        let shown = |done| counter.set((k * frames + done) as u64);
        let draw = |frame| sequence.frame(k, frame);
        all.push(folder::write(&own, origin, frames, masks, draw, shown)?);
    }
    files::write_bytes(&set.path().join(FILE), yaml.as_bytes())?;
    counter.finish();
    set.publish(&[], FILE)?;
    let (spin, names) = (sequence.spin(), rig.names());
    let seconds = clock.elapsed().as_secs_f64();
    let visible: usize = all.iter().map(|w| w.visible_dots).sum();
    if arguments.json {
        return crate::cli::print_json(&json!({
            "output": output.to_string_lossy(),
            "cameras": names,
            "frames": frames,
            "visible_dots": visible,
            "seed": seed,
            "spin_rad_s": [spin.x, spin.y, spin.z],
            "rps": spin.norm() / std::f64::consts::TAU,
            "fps": clip.fps,
            "seconds": seconds,
        }));
    }
    outln!(
        "{}: {} frames of each of {} cameras ({}), {:.1} dots to be found in each (seed {seed}); {seconds:.1} s",
        output.display(),
        frames,
        names.len(),
        names.join(", "),
        visible as f64 / (frames * names.len()) as f64,
    );
    outln!(
        "spin [{:.4}, {:.4}, {:.4}] rad/s in the frame of {}, {:.3} rps; {} frames a second",
        spin.x,
        spin.y,
        spin.z,
        names[0],
        spin.norm() / std::f64::consts::TAU,
        clip.fps
    );
    Ok(())
}
