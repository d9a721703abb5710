//! Clips of one ball by the cameras of a rig.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::json;

use super::Arguments;
use crate::cli::output::Counter;
use crate::error::{Result, require};
use crate::files;
use crate::geometry::Vec3;
use crate::synth::folder::{self, Origin};
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
    let frames = arguments.frame_count(FRAMES)?;
    let [diameter_mm, _] = ball.sizes_mm(None, None);
    let pattern = ball.pattern();
    let sequence = RigSequence::random(
        pattern,
        &config,
        &clip,
        &rig,
        0.5e-3 * diameter_mm,
        arguments.seed,
        frames,
    )?;
    check_folders(arguments, &rig)?;
    let (output, set) = arguments.begin()?;
    let clock = Instant::now();
    let counter = Counter::new((frames * rig.cameras().len()) as u64, "frames");
    let masks = arguments.written_masks();
    let mut visible_dots = 0;
    for (k, camera) in rig.cameras().iter().enumerate() {
        let own = set.path().join(&camera.name);
        files::create_dir(&own)?;
        ball.write_csv(&own.join("pattern.csv"))?;
        ball.write_npz(&own.join("table.npz"))?;
        let origin = Origin {
            seed: arguments.seed,
            pattern_sha256: pattern.sha256(),
            pattern: pattern.dots().iter().map(|d| (*d).into()).collect(),
            config: config.clone(),
            sequence: Some(sequence.taken(k, &clip)),
            strobe: None,
        };
        let shown = |done| counter.set((k * frames + done) as u64);
        let draw = |frame| sequence.frame(k, frame);
        visible_dots += folder::write(&own, origin, frames, masks, draw, shown)?.visible_dots;
    }
    files::write_bytes(&set.path().join(FILE), yaml.as_bytes())?;
    counter.finish();
    set.publish(&[], FILE)?;
    let made = MadeRig {
        output,
        cameras: rig.names(),
        frames,
        visible_dots,
        seed: arguments.seed,
        spin: sequence.spin(),
        fps: clip.fps,
        seconds: clock.elapsed().as_secs_f64(),
    };
    made.say(arguments.json)
}

/// The cameras name folders, which nothing that is kept may have.
fn check_folders(arguments: &Arguments, rig: &Rig) -> Result<()> {
    for name in rig.names() {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
        let inside = !name.is_empty() && name.chars().all(is_plain);
        let expected = "camera names of letters, digits, - and _: they name folders";
        require(inside, "rig", expected, name)?;
    }
    match arguments.output.as_ref().filter(|_| !arguments.overwrite) {
        Some(output) => {
            let taken: Vec<&str> = rig.names().into_iter().chain([FILE]).collect();
            let advice = "choose another folder, or --overwrite it";
            files::reject_taken(output, &taken, "frames", advice)
        }
        None => Ok(()),
    }
}

/// What was made.
struct MadeRig<'a> {
    output: PathBuf,
    cameras: Vec<&'a str>,
    /// Of each camera.
    frames: usize,
    visible_dots: usize,
    seed: u64,
    /// In the rig's frame, rad/s.
    spin: Vec3,
    fps: f64,
    seconds: f64,
}

impl MadeRig<'_> {
    fn say(&self, as_json: bool) -> Result<()> {
        let Self { spin, frames, .. } = self;
        let rps = spin.norm() / std::f64::consts::TAU;
        if as_json {
            return crate::cli::print_json(&json!({
                "output": self.output.to_string_lossy(),
                "cameras": self.cameras,
                "frames": frames,
                "visible_dots": self.visible_dots,
                "seed": self.seed,
                "spin_rad_s": [spin.x, spin.y, spin.z],
                "rps": rps,
                "fps": self.fps,
                "seconds": self.seconds,
            }));
        }
        let count = self.cameras.len();
        outln!(
            "{}: {frames} frames of each of {count} cameras ({}), {:.1} dots to be found in each (seed {}); {:.1} s",
            self.output.display(),
            self.cameras.join(", "),
            self.visible_dots as f64 / (frames * count) as f64,
            self.seed,
            self.seconds
        );
        outln!(
            "spin [{:.4}, {:.4}, {:.4}] rad/s in the frame of {}, {rps:.3} rps; {} frames a second",
            spin.x,
            spin.y,
            spin.z,
            self.cameras[0],
            self.fps
        );
        Ok(())
    }
}
