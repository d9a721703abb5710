//! `spindoe synth`: draws synthetic images with ground truth.

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueEnum};
use serde_json::json;

use super::output::{Counter, one_of};
use super::simulate::vector;
use crate::ball::Ball;
use crate::error::{Error, Result, require};
use crate::files::{self, Replacement};
use crate::geometry::Vec3;
use crate::synth::dataset::{ClipConfig, Sequence, independent_frame};
use crate::synth::folder::{self, Masks, Origin, Written};
use crate::synth::{SynthConfig, SynthKind};

/// Maximum number of frames of a set.
const MAX_FRAMES: usize = 1_000_000;

/// The base of the ranges of random frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
enum Preset {
    /// All conditions: any camera, light, background, motion and noise.
    #[default]
    All,
    /// Good conditions: a ball of 60 pixels, sharp, well lit, in full view.
    Good,
}

#[derive(Debug, Args)]
#[command(after_help = "\
The folder then holds images/*.png, index.csv (for the SpinDOE authors' reader: image path from the folder,
quaternion w,x,y,z, then u,v of each dot to be found), truth.json (the ground truth of every frame),
contact_sheet.png, and for a sequence orientations.csv, which `spindoe spin` reads.

Examples:
  spindoe synth pattern.csv --out set --frames 5000
  spindoe synth pattern.csv --out easy --preset good
  spindoe synth pattern.csv --out empty --kind dotless
  spindoe synth table.npz --out clip --sequence --frames 20 --rps 60 --ball-px 60
  spindoe synth table.npz --out live --sequence --image-size 1280x1024 --ball-px 60 --drift-px 400,-80")]
pub struct Arguments {
    /// The pattern, CSV, or a hash table, NPZ.
    pattern: PathBuf,
    /// The folder to write to.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Number of frames.
    #[arg(long, value_name = "N", default_value_t = 100)]
    frames: usize,
    /// Seed.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// The ranges from which frames are drawn; the flags below change them.
    #[arg(long, value_enum, default_value_t)]
    preset: Preset,
    /// Content of the frames: the pattern's ball, or an object without the pattern [default:
    /// dotted].
    #[arg(long, value_parser = one_of(&SynthKind::ALL, SynthKind::as_str))]
    kind: Option<SynthKind>,
    /// One ball that rotates at a constant spin, instead of another ball, view and camera in every
    /// frame.
    #[arg(long)]
    sequence: bool,
    /// Frames per second of the sequence.
    #[arg(
        long,
        default_value_t = 350.0,
        requires = "sequence",
        allow_negative_numbers = true
    )]
    fps: f64,
    /// Spin, revolutions per second: one number, or LOW,HIGH [default: 0,150].
    #[arg(long, value_parser = range, allow_hyphen_values = true, value_name = "RPS")]
    rps: Option<[f64; 2]>,
    /// The spin's axis in the camera frame, X,Y,Z (x right, y up, z to the camera), of any length;
    /// at random where not given.
    #[arg(long, value_parser = vector, allow_hyphen_values = true, value_name = "X,Y,Z", requires_all = ["sequence", "rps"])]
    axis: Option<Vec3>,
    /// Exposure of the sequence's frames in milliseconds; at random where not given.
    #[arg(
        long,
        value_name = "MS",
        requires = "sequence",
        allow_negative_numbers = true
    )]
    exposure_ms: Option<f64>,
    /// Displacement of the ball over the sequence, U,V pixels; by default a tenth of its radius in
    /// a random direction.
    #[arg(long, value_parser = range, allow_hyphen_values = true, value_name = "U,V", requires = "sequence")]
    drift_px: Option<[f64; 2]>,
    /// Side of all crops, pixels [default: 32 to 240, small ones more likely].
    #[arg(long, value_name = "PX", conflicts_with_all = ["min_size", "max_size"])]
    size: Option<usize>,
    /// Minimum side of the crops, pixels.
    #[arg(long, value_name = "PX")]
    min_size: Option<usize>,
    /// Maximum side of the crops, pixels.
    #[arg(long, value_name = "PX")]
    max_size: Option<usize>,
    /// Diameter of the ball, pixels: one number, or LOW,HIGH; the crop's side follows from it.
    #[arg(long, value_parser = range, allow_hyphen_values = true, value_name = "PX")]
    ball_px: Option<[f64; 2]>,
    /// Whole frames of this size with the ball anywhere in them, WIDTHxHEIGHT pixels, instead of
    /// crops.
    #[arg(long, value_parser = size, value_name = "WxH")]
    image_size: Option<[usize; 2]>,
    /// Distance of the camera in ball radii: one number, or LOW,HIGH [default: 6,60].
    #[arg(
        long,
        alias = "camera-distance",
        value_parser = range,
        allow_hyphen_values = true,
        value_name = "RADII"
    )]
    camera_distance_radii: Option<[f64; 2]>,
    /// Radius of the dots as an angle, degrees: one number, or LOW,HIGH; one for a ball [default:
    /// that of the design, else 2.3,7.4].
    #[arg(long, value_parser = range, allow_hyphen_values = true, value_name = "DEG")]
    dot_radius_deg: Option<[f64; 2]>,
    /// Standard deviation of the drawn dots from the pattern, degrees per tangent axis: one number,
    /// or LOW,HIGH; one for a ball [default: 0.23,1.7].
    #[arg(long, alias = "misplacement-deg", value_parser = range, allow_hyphen_values = true, value_name = "DEG")]
    placement_sigma_deg: Option<[f64; 2]>,
    /// Probability of a logo [default: 0.7].
    #[arg(long, alias = "logo", value_name = "P", allow_negative_numbers = true)]
    logo_probability: Option<f64>,
    /// Maximum rotation of a ball during the exposure, degrees [default: 17].
    #[arg(
        long,
        alias = "most-blur-deg",
        value_name = "DEG",
        allow_negative_numbers = true
    )]
    max_arc_deg: Option<f64>,
    /// Flip all images left to right, as a selfie video is.
    #[arg(long)]
    mirrored: bool,
    /// Also write masks/*.png: white where the ball is visible.
    #[arg(long)]
    masks: bool,
    /// All ranges, JSON, as `config` in truth.json; omitted keys have their default, and the flags
    /// above take precedence.
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    config: Option<PathBuf>,
    /// Print a summary as one JSON object instead of words.
    #[arg(long)]
    json: bool,
}

/// Columns and rows, as `1280x1024`.
fn size(text: &str) -> std::result::Result<[usize; 2], String> {
    let parts = text.split_once(['x', 'X']);
    let numbers = parts.and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    numbers.ok_or_else(|| "expected WIDTHxHEIGHT, as 1280x1024".into())
}

/// A number, or two separated by a comma.
fn range(text: &str) -> std::result::Result<[f64; 2], String> {
    let numbers: Vec<f64> = text
        .split(',')
        .filter_map(|n| n.trim().parse().ok().filter(|x: &f64| x.is_finite()))
        .collect();
    match (numbers.as_slice(), text.split(',').count()) {
        ([x], 1) => Ok([*x; 2]),
        ([low, high], 2) => Ok([*low, *high]),
        _ => Err("expected a finite number, or two as LOW,HIGH".into()),
    }
}

impl Arguments {
    fn synth_config(&self, ball: &Ball) -> Result<SynthConfig> {
        let mut config: SynthConfig = match (&self.config, self.preset) {
            (Some(path), _) => {
                let text = files::read_at_most(path, files::MAX_TEXT_BYTES)?;
                serde_json::from_slice(&text)
                    .map_err(|e| Error::input(path, "configuration", e.to_string()))?
            }
            (None, Preset::All) => SynthConfig::default(),
            (None, Preset::Good) => SynthConfig::good(),
        };
        if self.size.or(self.min_size).or(self.max_size).is_some() {
            // The side of the crop is given: the ball's size follows from it, unless it is given as
            // well.
            config.ball_px = None;
        }
        config.size_px[0] = self.size.or(self.min_size).unwrap_or(config.size_px[0]);
        config.size_px[1] = self.size.or(self.max_size).unwrap_or(config.size_px[1]);
        config.kind = self.kind.unwrap_or(config.kind);
        config.ball_px = self.ball_px.or(config.ball_px);
        config.image_px = self.image_size.or(config.image_px);
        config.rps = self.rps.unwrap_or(config.rps);
        if let Some(distance) = self.camera_distance_radii {
            config.camera_distance_radii = distance;
            config.parallel_share = 0.0;
        }
        match (self.dot_radius_deg, ball.design()) {
            (Some(radius), _) => config.dot_radius_rad = radius.map(f64::to_radians),
            (None, Some(design)) if self.config.is_none() => {
                config.dot_radius_rad = [design.dot_diameter().asin(); 2];
            }
            (None, _) => {}
        }
        if let Some(sigma) = self.placement_sigma_deg {
            config.placement_sigma_rad = sigma.map(f64::to_radians);
        }
        config.logo_probability = self.logo_probability.unwrap_or(config.logo_probability);
        if let Some(arc) = self.max_arc_deg {
            config.max_arc_rad = arc.to_radians();
        }
        config.mirrored |= self.mirrored;
        config.check()?;
        Ok(config)
    }

    fn sequence_config(&self) -> Result<Option<ClipConfig>> {
        if !self.sequence {
            return Ok(None);
        }
        let spin = match (self.axis, self.rps) {
            (Some(axis), Some([low, high])) => {
                if low != high {
                    let problem = "expected one number where --axis is given";
                    return Err(Error::argument("rps", problem));
                }
                let axis = super::output::unit(axis)
                    .ok_or_else(|| Error::argument("axis", "expected a vector that is not 0"))?;
                Some((axis * (low * std::f64::consts::TAU)).into())
            }
            _ => None,
        };
        Ok(Some(ClipConfig {
            fps: self.fps,
            spin,
            exposure_s: self.exposure_ms.map(|ms| 1e-3 * ms),
            drift_px: self.drift_px,
        }))
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let ball = Ball::read(&arguments.pattern)?;
    let config = arguments.synth_config(&ball)?;
    let pattern = ball.into_pattern();
    let Arguments { frames, seed, .. } = *arguments;
    require(
        (1..=MAX_FRAMES).contains(&frames),
        "frames",
        "1 to 1000000",
        frames,
    )?;
    let sequence_config = arguments.sequence_config()?;
    let sequence = sequence_config
        .map(|s| Sequence::random(&pattern, &config, &s, seed, frames))
        .transpose()?;
    let taken = ["index.csv", "truth.json", "images"];
    files::reject_taken(&arguments.out, &taken, "frames", "choose another folder")?;
    let set = Replacement::begin(&arguments.out)?;
    let origin = Origin {
        seed,
        pattern_sha256: pattern.sha256(),
        pattern: pattern.dots().iter().map(|d| (*d).into()).collect(),
        config: config.clone(),
        sequence: sequence_config,
    };
    let clock = Instant::now();
    let counter = Counter::new(frames as u64, "frames");
    let draw = |k| match &sequence {
        Some(sequence) => sequence.frame(k),
        None => independent_frame(&pattern, &config, seed, k),
    };
    let masks = if arguments.masks {
        Masks::Write
    } else {
        Masks::Omit
    };
    let shown = |done| counter.set(done as u64);
    let written = folder::write(set.path(), origin, frames, masks, draw, shown)?;
    counter.finish();
    set.publish(&[], &[], "index.csv")?;
    let spin = sequence.map(|s| s.spin());
    summarize(arguments, &written, spin, clock.elapsed().as_secs_f64())
}

fn summarize(
    arguments: &Arguments,
    written: &Written,
    spin: Option<Vec3>,
    seconds: f64,
) -> Result<()> {
    let rps = spin.map(|w| w.norm() / std::f64::consts::TAU);
    if arguments.json {
        return super::print_json(&json!({
            "out": arguments.out.to_string_lossy(),
            "frames": written.frames,
            "without_dots": written.without_dots,
            "visible_dots": written.visible_dots,
            "seed": arguments.seed,
            "spin_rad_s": spin.map(|w| [w.x, w.y, w.z]),
            "rps": rps,
            "fps": arguments.sequence.then_some(arguments.fps),
            "seconds": seconds,
        }));
    }
    let per_frame = written.visible_dots as f64 / written.frames as f64;
    outln!(
        "{}: {} frames, {per_frame:.1} dots to be found in each (seed {}); {seconds:.1} s",
        arguments.out.display(),
        written.frames,
        arguments.seed
    );
    if written.without_dots > 0 {
        outln!(
            "{} frames without any such dot: in truth.json, not in index.csv",
            written.without_dots
        );
    }
    if let (Some(w), Some(rps)) = (spin, rps) {
        outln!(
            "spin [{:.4}, {:.4}, {:.4}] rad/s, {rps:.3} rps",
            w.x,
            w.y,
            w.z
        );
    }
    Ok(())
}
