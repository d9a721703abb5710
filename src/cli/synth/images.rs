//! Images and clips of a ball.

use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::{Arguments, Content, range};
use crate::ball::{Ball, DesignRecord};
use crate::cli::output::Counter;
use crate::error::{Error, Result, require};
use crate::files::{self, Replacement};
use crate::geometry::Vec3;
use crate::pattern::Pattern;
use crate::spin::DEFAULT_FPS;
use crate::synth::SynthConfig;
use crate::synth::dataset::{ClipConfig, SynthSequence, independent_frame, strobed_frame};
use crate::synth::folder::{self, Masks, Origin, Written};
use crate::synth::several::StrobeConfig;

/// Maximum number of frames of a set.
pub(super) const MAX_FRAMES: usize = 1_000_000;
/// The folder where none is given.
const FOLDER: &str = "sample";
/// Spin of the preset `sample`, revolutions per second.
const SAMPLE_RPS: f64 = 40.0;
/// Exposure of the preset `sample`, s: short enough that dots stay round at its spin.
const SAMPLE_EXPOSURE_S: f64 = 2e-4;

/// The base of the ranges of random frames.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum ImagePreset {
    /// Any camera, light, background, motion and noise.
    All,
    /// A ball of 60 pixels, sharp, well lit, in full view.
    Good,
    /// Good conditions on the camera's axis, at one spin.
    Sample,
    /// A launch monitor's camera.
    Golf,
    /// The ranges of a file.
    File(PathBuf),
}

impl std::str::FromStr for ImagePreset {
    type Err = Infallible;

    fn from_str(text: &str) -> std::result::Result<Self, Infallible> {
        Ok(match text {
            "all" => Self::All,
            "good" => Self::Good,
            "sample" => Self::Sample,
            "golf" => Self::Golf,
            path => Self::File(path.into()),
        })
    }
}

impl ImagePreset {
    fn config(&self) -> Result<SynthConfig> {
        Ok(match self {
            Self::All => SynthConfig::default(),
            Self::Good => SynthConfig::good(),
            Self::Golf => SynthConfig::golf(),
            // The camera looks at the ball: the estimator, which sees crops, takes it so.
            Self::Sample => SynthConfig {
                max_off_axis_rad: 0.0,
                rps: [SAMPLE_RPS; 2],
                ..SynthConfig::good()
            },
            Self::File(path) => {
                let text = files::read_at_most(path, files::MAX_TEXT_BYTES)?;
                serde_json::from_slice(&text)
                    .map_err(|e| Error::input(path, "configuration", e.to_string()))?
            }
        })
    }
}

/// Settings of rendered frames.
#[derive(Debug, Args)]
pub struct Ranges {
    /// Displacement of the ball over a clip, U,V pixels; by default a tenth of its radius in a random direction.
    #[arg(long, hide = true, value_parser = range, allow_hyphen_values = true, value_name = "U,V")]
    drift_px: Option<[f64; 2]>,
    /// Side of the crops, pixels: one number, or LOW,HIGH [default: 32 to 240, small ones more likely].
    #[arg(long, hide = true, value_parser = range, value_name = "PX")]
    size_px: Option<[f64; 2]>,
    /// Distance of the camera in ball radii: one number, or LOW,HIGH [default: 6,60].
    #[arg(long, hide = true, value_parser = range, allow_hyphen_values = true, value_name = "RADII")]
    camera_distance_radii: Option<[f64; 2]>,
    /// Radius of the dots as an angle, degrees: one number, or LOW,HIGH; one for a ball [default: that of the
    /// design, else 2.3,7.4].
    #[arg(long, hide = true, value_parser = range, allow_hyphen_values = true, value_name = "DEG")]
    dot_radius_deg: Option<[f64; 2]>,
    /// Standard deviation of the drawn dots from the pattern, degrees per tangent axis: one number, or LOW,HIGH; one for a
    /// ball [default: 0.23,1.7].
    #[arg(long, hide = true, value_parser = range, allow_hyphen_values = true, value_name = "DEG")]
    placement_sigma_deg: Option<[f64; 2]>,
    /// Probability of a logo [default: 0.7].
    #[arg(long, hide = true, value_name = "P", allow_negative_numbers = true)]
    logo_probability: Option<f64>,
    /// Maximum rotation of a ball during the exposure, degrees [default: 17].
    #[arg(long, hide = true, value_name = "DEG", allow_negative_numbers = true)]
    max_arc_deg: Option<f64>,
}

/// Columns and rows, as `1280x1024`.
pub(super) fn size(text: &str) -> std::result::Result<[usize; 2], String> {
    let parts = text.split_once(['x', 'X']);
    let numbers = parts.and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    numbers.ok_or_else(|| "expected WIDTHxHEIGHT, as 1280x1024".into())
}

impl Ranges {
    /// Sets what is given.
    fn apply(&self, config: &mut SynthConfig, designed: Option<&DesignRecord>) -> Result<()> {
        if let Some(size) = self.size_px {
            let [low, high] = size;
            let is_whole = size
                .iter()
                .all(|x| x.fract() == 0.0 && (1.0..=65_535.0).contains(x));
            require(
                is_whole,
                "size_px",
                "whole numbers from 1",
                format!("{low},{high}"),
            )?;
            config.size_px = size.map(|x| x as usize);
            // The side of the crop is given: the ball's size follows from it, unless it is given as well.
            config.ball_px = None;
        }
        if let Some(distance) = self.camera_distance_radii {
            config.camera_distance_radii = distance;
            config.parallel_share = 0.0;
        }
        if let Some(radius) = self.dot_radius_deg {
            config.dot_radius_rad = radius.map(f64::to_radians);
        } else if let Some(design) = designed {
            config.dot_radius_rad = [design.dot_radius_rad(); 2];
        }
        if let Some(sigma) = self.placement_sigma_deg {
            config.placement_sigma_rad = sigma.map(f64::to_radians);
        }
        config.logo_probability = self.logo_probability.unwrap_or(config.logo_probability);
        if let Some(arc) = self.max_arc_deg {
            config.max_arc_rad = arc.to_radians();
        }
        Ok(())
    }
}

impl Arguments {
    fn is_clip(&self) -> bool {
        self.content() == Content::Clip
    }

    /// The flashes of each image, where there are several.
    fn strobe(&self) -> Result<Option<StrobeConfig>> {
        let Some(flashes) = &self.strobe_ms else {
            return Ok(None);
        };
        let mut strobe = StrobeConfig::new(flashes.times_s.clone());
        strobe.overlap = self.overlap.unwrap_or(strobe.overlap);
        if self.preset() == ImagePreset::Golf && self.rps.is_none() {
            strobe = strobe.with_golf_spin();
        }
        strobe.check()?;
        Ok(Some(strobe))
    }

    fn preset(&self) -> ImagePreset {
        let usual = match (self.is_clip(), self.strobe_ms.is_some()) {
            (true, _) => ImagePreset::Sample,
            (false, false) => ImagePreset::All,
            (false, true) => ImagePreset::Golf,
        };
        self.preset.clone().unwrap_or(usual)
    }

    pub(super) fn synth_config(&self, ball: &Ball) -> Result<SynthConfig> {
        let preset = self.preset();
        let mut config = preset.config()?;
        // A file states its own sizes.
        let is_file = matches!(preset, ImagePreset::File(_));
        let designed = ball.design().filter(|_| !is_file);
        self.ranges.apply(&mut config, designed)?;
        config.kind = self.kind.unwrap_or(config.kind);
        config.ball_px = self.ball_px.or(config.ball_px);
        config.image_px = self.image_size.or(config.image_px);
        config.rps = self.rps.unwrap_or(config.rps);
        config.mirrored |= self.mirrored;
        config.check()?;
        Ok(config)
    }

    pub(super) fn clip_config(&self, config: &SynthConfig) -> Result<Option<ClipConfig>> {
        if !self.is_clip() {
            return Ok(None);
        }
        let axis = self.unit_axis()?;
        let [low, high] = config.rps;
        if axis.is_some() && low != high {
            let problem = "expected one number where --axis is given";
            return Err(Error::argument("rps", problem));
        }
        let usual = (self.preset() == ImagePreset::Sample).then_some(SAMPLE_EXPOSURE_S);
        Ok(Some(ClipConfig {
            fps: self.fps.unwrap_or(DEFAULT_FPS),
            spin: axis.map(|axis| (axis * (low * std::f64::consts::TAU)).into()),
            exposure_s: self.exposure_ms.map(|ms| 1e-3 * ms).or(usual),
            drift_px: self.ranges.drift_px,
            readout_s: 1e-3 * self.readout_ms.unwrap_or(0.0),
        }))
    }

    pub(super) fn written_masks(&self) -> Masks {
        match self.masks {
            true => Masks::Write,
            false => Masks::Omit,
        }
    }

    /// The number of frames, `usual` where none is given.
    pub(super) fn frame_count(&self, usual: usize) -> Result<usize> {
        let frames = self.frames.unwrap_or(usual);
        let inside = (1..=MAX_FRAMES).contains(&frames);
        require(inside, "frames", "1 to 1000000", frames)?;
        Ok(frames)
    }

    /// Begins the folder, where it is free or may be replaced.
    pub(super) fn begin(&self) -> Result<(PathBuf, Replacement)> {
        let folder = self.output.clone().unwrap_or_else(|| FOLDER.into());
        if !self.overwrite {
            let taken = ["index.csv", "truth.json", "images"];
            let advice = "choose another folder, or --overwrite it";
            files::reject_taken(&folder, &taken, "frames", advice)?;
        }
        let set = Replacement::begin(&folder)?;
        Ok((folder, set))
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    if let Some(rig) = &arguments.rig {
        return super::rig::run(arguments, rig);
    }
    let ball = arguments.ball()?;
    let config = arguments.synth_config(&ball)?;
    let clip = arguments.clip_config(&config)?;
    let strobe = arguments.strobe()?;
    let others = arguments.also.iter().map(|path| Ball::read(path));
    let others: Vec<Ball> = others.collect::<Result<_>>()?;
    let (pattern, seed) = (ball.pattern(), arguments.seed);
    let usual = if arguments.is_clip() { 24 } else { 100 };
    let frames = arguments.frame_count(usual)?;
    let sequence = clip.as_ref().map(|clip| match others.is_empty() {
        true => SynthSequence::random(pattern, &config, clip, seed, frames),
        false => {
            let all = std::iter::once(&ball).chain(&others);
            let all: Vec<Pattern> = all.map(|b| b.pattern().clone()).collect();
            SynthSequence::of_balls(&all, &config, clip, seed, frames)
        }
    });
    let sequence = sequence.transpose()?;
    let (folder, set) = arguments.begin()?;
    write_balls(set.path(), &ball, &others)?;
    let origin = Origin {
        seed,
        pattern_sha256: pattern.sha256(),
        pattern: pattern.dots().iter().map(|d| (*d).into()).collect(),
        config: config.clone(),
        sequence: clip.map(|clip| sequence.as_ref().map_or(clip, |s| s.taken(&clip))),
        strobe: strobe.clone(),
    };
    let clock = Instant::now();
    let counter = Counter::new(frames as u64, "frames");
    let draw = |k| match (&sequence, &strobe) {
        (Some(sequence), _) => sequence.frame(k),
        (None, Some(strobe)) => strobed_frame(pattern, &config, strobe, seed, k),
        (None, None) => independent_frame(pattern, &config, seed, k),
    };
    let shown = |done| counter.set(done as u64);
    let masks = arguments.written_masks();
    let written = folder::write(set.path(), origin, frames, masks, draw, shown)?;
    counter.finish();
    let replaced = if arguments.overwrite {
        &["masks", "orientations.csv"][..]
    } else {
        &[]
    };
    set.publish(replaced, "index.csv")?;
    let made = MadeClip {
        folder,
        written,
        spin: sequence.map(|s| s.spin()),
        fps: clip.map(|c| c.fps),
        seconds: clock.elapsed().as_secs_f64(),
    };
    made.summarize(arguments)
}

/// Writes the pattern and the table of each ball: those of the second have a 2 in their names, and so on.
fn write_balls(folder: &Path, ball: &Ball, others: &[Ball]) -> Result<()> {
    ball.write_csv(&folder.join("pattern.csv"))?;
    ball.write_npz(&folder.join("table.npz"))?;
    for (number, other) in (2..).zip(others) {
        other.write_csv(&folder.join(format!("pattern{number}.csv")))?;
        other.write_npz(&folder.join(format!("table{number}.npz")))?;
    }
    Ok(())
}

/// A folder that was written.
struct MadeClip {
    folder: PathBuf,
    written: Written,
    spin: Option<Vec3>,
    fps: Option<f64>,
    seconds: f64,
}

impl MadeClip {
    fn summarize(&self, arguments: &Arguments) -> Result<()> {
        let Self {
            folder,
            written,
            spin,
            fps,
            seconds,
        } = self;
        let rps = spin.map(|w| w.norm() / std::f64::consts::TAU);
        if arguments.json {
            return crate::cli::print_json(&json!({
                "output": folder.to_string_lossy(),
                "frames": written.frames,
                "without_dots": written.without_dots,
                "visible_dots": written.visible_dots,
                "seed": arguments.seed,
                "spin_rad_s": spin.map(|w| [w.x, w.y, w.z]),
                "rps": rps,
                "fps": fps,
                "seconds": seconds,
            }));
        }
        let per_frame = written.visible_dots as f64 / written.frames as f64;
        outln!(
            "{}: {} frames, {per_frame:.1} dots to be found in each (seed {}); {seconds:.1} s",
            folder.display(),
            written.frames,
            arguments.seed
        );
        if written.without_dots > 0 {
            outln!(
                "{} frames without any such dot: in truth.json, not in index.csv",
                written.without_dots
            );
        }
        if let (Some(w), Some(rps), Some(fps)) = (spin, rps, fps) {
            outln!(
                "spin [{:.4}, {:.4}, {:.4}] rad/s, {rps:.3} rps; {fps} frames a second",
                w.x,
                w.y,
                w.z
            );
        }
        Ok(())
    }
}
