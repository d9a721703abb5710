//! `spindoe synth`: images, a clip, dots or orientations of a ball, with exact truth.

mod dots;
#[cfg(feature = "vision")]
mod images;
mod orientations;
#[cfg(feature = "vision")]
mod rig;

use std::path::{Path, PathBuf};

use clap::{ArgMatches, Args, ValueEnum};

#[cfg(feature = "vision")]
use super::camera::CameraSource;
#[cfg(feature = "vision")]
use super::flashes::Flashes;
use super::output::{one_of, reject_foreign, unit};
use crate::ball::Ball;
use crate::error::{Error, Result};
use crate::geometry::Vec3;
#[cfg(feature = "vision")]
use crate::synth::SynthKind;
use crate::view::ProtocolName;

/// The shipped pattern of a ball where none is given.
const PATTERN: &str = "dots20";

#[derive(Debug, Args)]
#[command(after_help = "\
Without arguments it writes a sample to try: a clip of a spinning ball with its pattern and table.

A folder of images or of a clip holds images/*.png (a clip's are named by their times in nanoseconds), pattern.csv,
table.npz, truth.json (the ground truth of every frame), index.csv (for the SpinDOE authors' reader: image path,
quaternion w,x,y,z, then u,v of each dot to be found), contact_sheet.png, and of a clip orientations.csv.
Dots are written as `spindoe identify` reads them, orientations as `spindoe spin` does.

Examples:
  spindoe synth -o sample
  spindoe synth table.npz --as images -o set --frames 5000
  spindoe synth dots32 --as images --config kind=dotless -o empty
  spindoe synth table.npz -o clip --frames 20 --rps 60 --ball-px 60
  spindoe synth dots20 -o far --image-size 1280x1024 --config drift_px=400,-80
  spindoe synth dots20 --also dots32 -o two
  spindoe synth dots20 --rig rig.yaml -o two-cameras
  spindoe synth dots20 --strobe-ms 0,0.9,2.1 -o exposures
  spindoe synth dots20 --as dots --protocol clutter -o dots.csv
  spindoe synth --as orientations --rps 40 --frames 200 -o orientations.csv")]
pub struct Arguments {
    /// The ball's pattern: a shipped one by its name, its CSV, a table, or the folder of a design or calibration
    /// [default: dots20].
    pattern: Option<PathBuf>,
    /// What to make [default: a clip; images with --strobe-ms].
    #[arg(long = "as", value_enum, value_name = "WHAT")]
    content: Option<Content>,
    /// The folder or the file to write [default: of images and clips the folder sample].
    #[arg(short, long, value_name = "DIR|FILE.csv")]
    output: Option<PathBuf>,
    /// Replace images or a clip that the folder holds already, with all their files.
    #[arg(long)]
    overwrite: bool,
    /// Number of frames [default: images 100, a clip 24, dots 1000, orientations 10].
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Seed.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Ranges from which frames are drawn: all conditions; good ones (a ball of 60 pixels, sharp, well lit, in full view);
    /// sample, good ones on the camera's axis, 40 rps; golf, a launch monitor's camera (balls of 100 pixels with dimples in
    /// infrared light, golf's spins); or a JSON file of them, as `config` in truth.json [default: images all, a clip
    /// sample, exposures with --strobe-ms golf].
    #[cfg(feature = "vision")]
    #[arg(long, value_name = "all|good|sample|golf|FILE.json")]
    preset: Option<images::ImagePreset>,
    /// Content of the frames: the pattern's ball, or an object without the pattern [default: dotted].
    #[cfg(feature = "vision")]
    #[arg(hide = true, long, value_parser = one_of(&SynthKind::ALL, SynthKind::as_str))]
    kind: Option<SynthKind>,
    /// Frames per second [default: 350, or the camera's].
    #[arg(long, value_name = "F", allow_negative_numbers = true)]
    fps: Option<f64>,
    /// Spin, revolutions per second: one number, or LOW,HIGH [default: by the preset; orientations 50].
    #[arg(long, value_parser = range, allow_hyphen_values = true, value_name = "RPS")]
    rps: Option<[f64; 2]>,
    /// The spin's axis: X,Y,Z in the camera frame (x right, y up, z to the camera), of any length; at random where not
    /// given.
    #[arg(long, value_parser = vector, allow_hyphen_values = true, value_name = "X,Y,Z")]
    axis: Option<Vec3>,
    /// Exposure of a clip's frames, milliseconds; at random where not given.
    #[cfg(feature = "vision")]
    #[arg(long, value_name = "MS", allow_negative_numbers = true)]
    exposure_ms: Option<f64>,
    /// Rolling shutter of a clip: time from the exposure of an image's first row to that of its last, milliseconds [default: 0].
    #[cfg(feature = "vision")]
    #[arg(hide = true, long, value_name = "MS", allow_negative_numbers = true)]
    readout_ms: Option<f64>,
    /// Flashes of one exposure, milliseconds, ascending, or PERIODxN, as in 0.7x3: each image shows the ball once for each flash, on
    /// its way across.
    #[cfg(feature = "vision")]
    #[arg(long, value_name = "MS,MS..", allow_hyphen_values = true)]
    strobe_ms: Option<Flashes>,
    /// Part of the diameter that the nearest images of a strobed ball share: one number, or LOW,HIGH; negative where they are
    /// apart [default: 0,0.6].
    #[cfg(feature = "vision")]
    #[arg(hide = true, long, value_parser = range, allow_hyphen_values = true, value_name = "SHARE", requires = "strobe_ms")]
    overlap: Option<[f64; 2]>,
    /// A further ball that flies through the same clip, as PATTERN; may be given several times.
    #[cfg(feature = "vision")]
    #[arg(long, value_name = "PATTERN", conflicts_with = "strobe_ms")]
    also: Vec<PathBuf>,
    /// Cameras of a rig, by its file: as `estimate --rig` reads it. Each has a folder of the same ball, and the rig's file lies beside them.
    #[cfg(feature = "vision")]
    #[arg(long, value_name = "RIG.yaml", conflicts_with_all = ["also", "strobe_ms", "image_size", "mirrored", "readout_ms", "drift_px"])]
    rig: Option<PathBuf>,
    /// Diameter of the ball, pixels: one number, or LOW,HIGH; the crop's side follows from it.
    #[cfg(feature = "vision")]
    #[arg(long, value_parser = range, allow_hyphen_values = true, value_name = "PX")]
    ball_px: Option<[f64; 2]>,
    /// Whole frames of this size with the ball anywhere in them, WIDTHxHEIGHT pixels, instead of crops.
    #[cfg(feature = "vision")]
    #[arg(long, value_parser = images::size, value_name = "WxH")]
    image_size: Option<[usize; 2]>,
    /// Flip all images left to right, as a selfie video is.
    #[cfg(feature = "vision")]
    #[arg(hide = true, long)]
    mirrored: bool,
    /// Also write masks/*.png: white where the ball is visible.
    #[cfg(feature = "vision")]
    #[arg(hide = true, long)]
    masks: bool,
    /// The view of the dots: as in `spindoe validate` [default: paper].
    #[arg(long, value_parser = one_of(&ProtocolName::ALL, ProtocolName::as_str))]
    protocol: Option<ProtocolName>,
    /// The camera of orientations: as for `spindoe advise`. Frame rate, noise, outliers and lost frames are what
    /// it gives of the pattern in rendered frames.
    #[cfg(feature = "vision")]
    #[arg(long, value_name = "dark|any|CAMERA.toml")]
    camera: Option<CameraSource>,
    #[cfg(feature = "vision")]
    #[command(flatten)]
    ranges: images::Ranges,
    #[command(flatten)]
    scenario: orientations::ScenarioArguments,
    /// Print one JSON object instead: the truth.
    #[arg(long)]
    json: bool,
}

/// What is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Content {
    /// One ball that rotates at a constant spin.
    #[cfg(feature = "vision")]
    Clip,
    /// Another ball, view and camera in every frame.
    #[cfg(feature = "vision")]
    Images,
    /// Observed dots of single frames.
    Dots,
    /// Time-stamped orientations of one ball.
    Orientations,
}

/// The flags that only some contents have, by their ids.
#[cfg(feature = "vision")]
const OWN: &[(&str, &[Content])] = {
    use Content::{Clip, Dots, Images, Orientations};
    const PICTURES: &[Content] = &[Clip, Images];
    &[
        ("preset", PICTURES),
        ("kind", PICTURES),
        ("ball_px", PICTURES),
        ("image_size", PICTURES),
        ("mirrored", PICTURES),
        ("masks", PICTURES),
        ("overwrite", PICTURES),
        ("exposure_ms", &[Clip]),
        ("readout_ms", &[Clip]),
        ("drift_px", &[Clip]),
        ("also", &[Clip]),
        ("rig", &[Clip]),
        ("strobe_ms", &[Images]),
        ("overlap", &[Images]),
        ("fps", &[Clip, Orientations]),
        ("axis", &[Clip, Orientations]),
        ("rps", &[Clip, Images, Orientations]),
        ("camera", &[Orientations]),
        ("protocol", &[Dots]),
    ]
};
#[cfg(not(feature = "vision"))]
const OWN: &[(&str, &[Content])] = &[
    ("fps", &[Content::Orientations]),
    ("axis", &[Content::Orientations]),
    ("rps", &[Content::Orientations]),
    ("protocol", &[Content::Dots]),
];

impl Arguments {
    /// What is made.
    fn content(&self) -> Content {
        #[cfg(feature = "vision")]
        let usual = match self.strobe_ms.is_some() {
            false => Content::Clip,
            true => Content::Images,
        };
        #[cfg(not(feature = "vision"))]
        let usual = Content::Dots;
        self.content.unwrap_or(usual)
    }

    /// The ball: the given one, or the shipped one of 20 dots.
    fn ball(&self) -> Result<Ball> {
        Ball::read(self.pattern.as_deref().unwrap_or(Path::new(PATTERN)))
    }

    /// The file to write.
    fn file(&self) -> Result<&PathBuf> {
        let expected = || Error::argument("output", "expected a file");
        self.output.as_ref().ok_or_else(expected)
    }

    /// The axis as a unit vector, where it is given.
    fn unit_axis(&self) -> Result<Option<Vec3>> {
        let unit = |axis| {
            unit(axis).ok_or_else(|| Error::argument("axis", "expected a vector that is not 0"))
        };
        self.axis.map(unit).transpose()
    }

    /// The one spin that is given, revolutions per second.
    fn one_rps(&self) -> Result<Option<f64>> {
        match self.rps {
            Some([low, high]) if low != high => {
                let problem = "expected one number where there is one spin";
                Err(Error::argument("rps", problem))
            }
            rps => Ok(rps.map(|[rps, _]| rps)),
        }
    }
}

/// A number, or two separated by a comma.
fn range(text: &str) -> std::result::Result<[f64; 2], String> {
    match numbers(text).as_slice() {
        [x] => Ok([*x; 2]),
        [low, high] => Ok([*low, *high]),
        _ => Err("expected a finite number, or two as LOW,HIGH".into()),
    }
}

/// Three finite numbers separated by commas.
fn vector(text: &str) -> std::result::Result<Vec3, String> {
    match numbers(text).as_slice() {
        [x, y, z] => Ok(Vec3::new(*x, *y, *z)),
        _ => Err("expected three finite numbers X,Y,Z".into()),
    }
}

/// Finite numbers separated by commas; none where a part is no such number.
fn numbers(text: &str) -> Vec<f64> {
    let parts = text.split(',').map(|n| n.trim().parse().ok());
    let finite = parts.map(|n| n.filter(|x: &f64| x.is_finite()));
    finite.collect::<Option<Vec<_>>>().unwrap_or_default()
}

pub fn run(arguments: &Arguments, given: Option<&ArgMatches>) -> Result<()> {
    if let Some(given) = given {
        reject_foreign(given, OWN, arguments.content())?;
    }
    match arguments.content() {
        #[cfg(feature = "vision")]
        Content::Clip | Content::Images => images::run(arguments),
        Content::Dots => dots::run(arguments),
        Content::Orientations => orientations::run(arguments),
    }
}
