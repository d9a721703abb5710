//! The ranges from which random frames are drawn.
//!
//! The defaults are wider than the conditions in use, so that a photograph lies within the training
//! distribution. They follow from optics and from the appearance of balls; they are not fitted to
//! any set of images. [`SynthConfig::good`] is the narrow counterpart: the conditions that a user
//! arranges.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

use super::blotches::Blotches;
use crate::error::{Error, Result, require};

/// What the frame shows in the ball's place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Hash)]
#[serde(rename_all = "kebab-case")]
pub enum SynthKind {
    /// A ball with the pattern.
    #[default]
    Dotted,
    /// A ball with the dots of another pattern.
    OtherPattern,
    /// A ball without dots, with what else a ball may have.
    Dotless,
    /// A ball with logos only.
    LogoOnly,
    /// A ball with seams only.
    SeamsOnly,
    /// An orange or another fruit: pores and a stem.
    Fruit,
    /// A lamp or a white disc: bright all over, without shading.
    Lamp,
    /// A wheel with spokes.
    Wheel,
    /// A ball speckled all over.
    Speckled,
    /// Noise without a ball.
    Noise,
}

impl SynthKind {
    /// All kinds.
    pub const ALL: [Self; 10] = [
        Self::Dotted,
        Self::OtherPattern,
        Self::Dotless,
        Self::LogoOnly,
        Self::SeamsOnly,
        Self::Fruit,
        Self::Lamp,
        Self::Wheel,
        Self::Speckled,
        Self::Noise,
    ];

    /// The name on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Dotted => "dotted",
            Self::OtherPattern => "other-pattern",
            Self::Dotless => "dotless",
            Self::LogoOnly => "logo-only",
            Self::SeamsOnly => "seams-only",
            Self::Fruit => "fruit",
            Self::Lamp => "lamp",
            Self::Wheel => "wheel",
            Self::Speckled => "speckled",
            Self::Noise => "noise",
        }
    }

    /// Whether the frame shows the pattern.
    pub fn has_pattern(self) -> bool {
        self == Self::Dotted
    }

    /// Whether the frame shows any ball or disc.
    pub fn has_ball(self) -> bool {
        self != Self::Noise
    }
}

impl std::str::FromStr for SynthKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "kind", name)
    }
}

/// The ranges of random frames. Pairs are `[minimum, maximum]`; a value is drawn once for a frame.
///
/// ```
/// use spindoe::synth::SynthConfig;
///
/// let config = SynthConfig { ball_px: Some([60.0, 60.0]), ..SynthConfig::good() };
/// assert!(config.check().is_ok());
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SynthConfig {
    /// What is shown. Default: a dotted ball.
    pub kind: SynthKind,

    // The image.
    /// Side of the square crop, pixels, log-uniform. Default: 32 to 240.
    pub size_px: [usize; 2],
    /// The ball's diameter over the crop's side. Default: 0.6 to 1.
    pub fill: [f64; 2],
    /// The ball's diameter, pixels, log-uniform; where given, the crop's side follows from `fill`.
    /// Default: none, `size_px` holds.
    pub ball_px: Option<[f64; 2]>,
    /// Columns and rows of a whole frame, in which the ball lies anywhere; its diameter is that in
    /// the crop. Default: none, a crop.
    pub image_px: Option<[usize; 2]>,
    /// Maximum of the ball's center off the crop's, along either axis, over half the side.
    /// Default: 0.2.
    pub off_center: f64,
    /// Share of the frames whose border cuts the ball. Default: 0.1.
    pub cut_share: f64,
    /// Maximum part of the diameter beyond the border. Default: 0.35.
    pub max_cut: f64,
    /// Whether images are flipped left to right. Default: no.
    pub mirrored: bool,

    // The camera.
    /// Distance of the camera from the ball's center in ball radii, log-uniform; in a whole frame longer where the lens would
    /// have to see more than 34 degrees to either side. Default: 4 to 60.
    pub camera_distance_radii: [f64; 2],
    /// Share of the frames taken along parallel rays. Default: 0.05.
    pub parallel_share: f64,
    /// Maximum angle between the optical axis and the ray to the ball's center, radians: of a crop, which may be cut from
    /// anywhere. A whole frame has its axis near its middle. Default: 0.6 (34 degrees).
    pub max_off_axis_rad: f64,

    // The ball.
    /// Angular radius of the dots, radians. Default: 0.04 to 0.13.
    pub dot_radius_rad: [f64; 2],
    /// Relative standard deviation of the dots' radii within a ball. Default: 0.02 to 0.2.
    pub dot_radius_spread: [f64; 2],
    /// Standard deviation of a dot's placement error, per tangent axis, radians. Default: 0.004 to
    /// 0.03.
    pub placement_sigma_rad: [f64; 2],
    /// Maximum of (long axis - short axis) / (long + short) of a dot. Default: 0.2.
    pub max_dot_elongation: f64,
    /// Share of the light that a dot's ink takes: a worn pen leaves gray. Default: 0.55 to 1.
    pub ink_density: [f64; 2],
    /// Maximum part of the ink that a streaky pen leaves out. Default: 0.4.
    pub max_streaks: f64,
    /// Share of the pens whose ink is colored. Default: 0.25.
    pub colored_ink_share: f64,
    /// Probability that a dot was not drawn. Default: 0.01.
    pub left_out: f64,
    /// Probability of a logo. Default: 0.7.
    pub logo_probability: f64,
    /// Angular radius of the logo, radians. Default: 0.25 to 0.75.
    pub logo_radius_rad: [f64; 2],
    /// Probability of a seam. Default: 0.35.
    pub seam_probability: f64,
    /// Whether the ball may be stained. Default: yes.
    pub stains: bool,
    /// Whether it is a golf ball: white, with dimples. Default: no.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub dimples: bool,
    /// How the ball is painted with blotches, in the stains' color and the ink's. Default: not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blotches: Option<Blotches>,

    // Motion.
    /// Spin, revolutions per second. Default: 0 to 150.
    pub rps: [f64; 2],
    /// Maximum angle that the ball turns during the exposure, radians. Default: 0.45.
    pub max_arc_rad: f64,
    /// Maximum displacement of the ball during the exposure, pixels of a crop of 60. Default: 8.
    pub max_shift_px: f64,

    // Light.
    /// Share of the light that comes from everywhere. Default: 0.08 to 0.9.
    pub ambient: [f64; 2],
    /// Share of the frames with a second lamp. Default: 0.4.
    pub second_lamp_share: f64,
    /// Share of the balls on which something casts a hard shadow. Default: 0.15.
    pub shadow_share: f64,
    /// Maximum strength of a lamp's highlight; 1 is a white surface in full light. Default: 0.8.
    pub max_gloss: f64,
    /// Maximum darkening towards the limb. Default: 0.4.
    pub max_limb: f64,

    // What is behind and before the ball.
    /// Maximum brightness of the background against that of the ball's brightest part. Default:
    /// 1.3.
    pub max_background: f64,
    /// Share of the frames with a textured background. Default: 0.5.
    pub texture_share: f64,
    /// Share of the frames with discs, lamps or other balls in the background. Default: 0.4.
    pub clutter_share: f64,
    /// Share of the frames with ground below the ball, most of them with its shadow there. Default: 0.25.
    pub ground_share: f64,
    /// Share of the frames in which something hides a part of the ball. Default: 0.2.
    pub occlusion_share: f64,
    /// Share of the frames in which cords or a net cross the whole ball. Default: 0.05.
    pub cords_share: f64,
    /// Share of the occluders that cast a shadow on the ball. Default: 0.5.
    pub occluder_shadow_share: f64,
    /// Maximum depth, over the diameter, to which a hand or a bat covers the ball. Default: 0.45.
    pub max_occlusion: f64,

    // The sensor.
    /// Standard deviation of the lens' blur, pixels of a crop of 60. Default: 0.2 to 1.6.
    pub defocus_px: [f64; 2],
    /// Maximum factor on the noise of a good camera. Default: 12.
    pub max_noise: f64,
    /// Share of the frames far over- or underexposed. Default: 0.12.
    pub bad_exposure: f64,
    /// Exponent on the encoded values, log-uniform: a display's or an editor's correction.
    /// Default: 0.5 to 2.
    pub gamma: [f64; 2],
    /// Share of the frames with such an exponent; it is 1 elsewhere, and where the exposure is bad.
    /// Default: 0.35.
    pub gamma_share: f64,
    /// Share of the color cameras with a Bayer mosaic. Default: 0.5.
    pub mosaic_share: f64,
    /// Share of the cameras that sharpen. Default: 0.2.
    pub sharpen_share: f64,
    /// Share of the frames compressed as JPEG. Default: 0.3.
    pub jpeg_share: f64,
    /// Quality of the JPEG compression, 1 to 100. Default: 30 to 98.
    pub jpeg_quality: [f64; 2],
    /// Share of the frames compressed as video. Default: 0.15.
    pub video_share: f64,
    /// Quantizer of the video compression, as H.264's QP. Default: 18 to 36.
    pub video_qp: [f64; 2],
    /// Whether the camera sees infrared light: gray, linear. Default: no.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub infrared: bool,
}

impl Default for SynthConfig {
    fn default() -> Self {
        Self {
            kind: SynthKind::Dotted,
            size_px: [32, 240],
            fill: [0.6, 1.0],
            ball_px: None,
            image_px: None,
            off_center: 0.2,
            cut_share: 0.1,
            max_cut: 0.35,
            mirrored: false,
            camera_distance_radii: [4.0, 60.0],
            parallel_share: 0.05,
            max_off_axis_rad: 0.6,
            dot_radius_rad: [0.040, 0.130],
            dot_radius_spread: [0.02, 0.2],
            placement_sigma_rad: [0.004, 0.030],
            max_dot_elongation: 0.2,
            ink_density: [0.55, 1.0],
            max_streaks: 0.4,
            colored_ink_share: 0.25,
            left_out: 0.01,
            logo_probability: 0.7,
            logo_radius_rad: [0.25, 0.75],
            seam_probability: 0.35,
            stains: true,
            dimples: false,
            blotches: None,
            rps: [0.0, 150.0],
            max_arc_rad: 0.45,
            max_shift_px: 8.0,
            ambient: [0.08, 0.9],
            second_lamp_share: 0.4,
            shadow_share: 0.15,
            max_gloss: 0.8,
            max_limb: 0.4,
            max_background: 1.3,
            texture_share: 0.5,
            clutter_share: 0.4,
            ground_share: 0.25,
            occlusion_share: 0.2,
            cords_share: 0.05,
            occluder_shadow_share: 0.5,
            max_occlusion: 0.45,
            defocus_px: [0.2, 1.6],
            max_noise: 12.0,
            bad_exposure: 0.12,
            gamma: [0.5, 2.0],
            gamma_share: 0.35,
            mosaic_share: 0.5,
            sharpen_share: 0.2,
            jpeg_share: 0.3,
            jpeg_quality: [30.0, 98.0],
            video_share: 0.15,
            video_qp: [18.0, 36.0],
            infrared: false,
        }
    }
}

impl SynthConfig {
    /// Good conditions, as a user arranges them: a ball of 60 pixels, sharp and well lit, short
    /// exposures, clear ink, a background darker than the ball, no occluders. Cameras are 6 to 60
    /// radii away.
    pub fn good() -> Self {
        Self {
            ball_px: Some([60.0, 60.0]),
            fill: [0.75, 0.92],
            off_center: 0.05,
            cut_share: 0.0,
            camera_distance_radii: [6.0, 60.0],
            max_off_axis_rad: 0.09,
            dot_radius_rad: [0.07, 0.11],
            dot_radius_spread: [0.02, 0.1],
            placement_sigma_rad: [0.004, 0.02],
            max_dot_elongation: 0.1,
            ink_density: [0.8, 1.0],
            max_streaks: 0.15,
            max_arc_rad: 0.1,
            max_shift_px: 1.0,
            ambient: [0.2, 0.9],
            shadow_share: 0.0,
            max_gloss: 0.4,
            max_background: 0.3,
            clutter_share: 0.1,
            ground_share: 0.0,
            occlusion_share: 0.0,
            cords_share: 0.0,
            defocus_px: [0.2, 0.8],
            max_noise: 3.0,
            bad_exposure: 0.0,
            gamma_share: 0.0,
            jpeg_quality: [70.0, 98.0],
            video_share: 0.0,
            ..Self::default()
        }
    }

    /// A launch monitor's camera: golf balls of 100 pixels by pulsed infrared light before a dark background, noisy and gray,
    /// 0.4 to 0.6 m away.
    pub fn golf() -> Self {
        Self {
            ball_px: Some([100.0, 100.0]),
            camera_distance_radii: [18.7, 28.1],
            parallel_share: 0.0,
            max_off_axis_rad: 0.0,
            max_background: 0.08,
            texture_share: 0.3,
            clutter_share: 0.0,
            seam_probability: 0.0,
            max_noise: 6.0,
            jpeg_share: 0.0,
            sharpen_share: 0.0,
            dimples: true,
            infrared: true,
            ..Self::good()
        }
    }

    /// The same with nothing on the balls but dots: no print, no seam, no stains.
    pub fn unprinted(self) -> Self {
        Self {
            logo_probability: 0.0,
            seam_probability: 0.0,
            stains: false,
            ..self
        }
    }

    /// The same with every dot of the pattern on the ball, exactly where the pattern has it.
    pub fn as_designed(self) -> Self {
        Self {
            placement_sigma_rad: [0.0; 2],
            left_out: 0.0,
            ..self
        }
    }

    /// Checks the domains of all parameters.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] naming the parameter.
    pub fn check(&self) -> Result<()> {
        let [small, large] = self.size_px;
        require(
            (16..=4096).contains(&small) && (small..=4096).contains(&large),
            "size_px",
            "16 to 4096 pixels, the smaller first",
            format_args!("{small},{large}"),
        )?;
        if let Some([width, height]) = self.image_px {
            require(
                (16..=8192).contains(&width) && (16..=8192).contains(&height),
                "image_px",
                "16 to 8192 columns and rows",
                format_args!("{width}x{height}"),
            )?;
        }
        if let Some(range) = self.ball_px {
            pair("ball_px", range, [8.0, 4096.0], "8 to 4096 pixels")?;
        }
        self.check_pairs()?;
        self.check_maxima()?;
        self.check_shares()
    }

    fn check_pairs(&self) -> Result<()> {
        pair("fill", self.fill, [0.1, 1.5], "0.1 to 1.5")?;
        pair(
            "camera_distance_radii",
            self.camera_distance_radii,
            [1.5, 1e6],
            "1.5 to 1000000 ball radii",
        )?;
        pair_deg("dot_radius_rad", self.dot_radius_rad, [0.3, 30.0])?;
        pair(
            "dot_radius_spread",
            self.dot_radius_spread,
            [0.0, 1.0],
            "0 to 1",
        )?;
        pair_deg("placement_sigma_rad", self.placement_sigma_rad, [0.0, 30.0])?;
        pair("ink_density", self.ink_density, [0.0, 1.0], "0 to 1")?;
        pair_deg("logo_radius_rad", self.logo_radius_rad, [0.5, 90.0])?;
        pair("rps", self.rps, [0.0, 1e4], "0 to 10000")?;
        pair("ambient", self.ambient, [0.0, 1.0], "0 to 1")?;
        pair("defocus_px", self.defocus_px, [0.0, 50.0], "0 to 50 pixels")?;
        if let Some(Blotches {
            coverage,
            width_rad,
        }) = self.blotches
        {
            pair("coverage", coverage, [0.0, 0.9], "0 to 0.9")?;
            pair_deg("width_rad", width_rad, [1.0, 60.0])?;
        }
        pair("gamma", self.gamma, [0.1, 10.0], "0.1 to 10")?;
        pair("jpeg_quality", self.jpeg_quality, [1.0, 100.0], "1 to 100")?;
        pair("video_qp", self.video_qp, [0.0, 51.0], "0 to 51")
    }

    fn check_maxima(&self) -> Result<()> {
        for (name, value, max, expected) in [
            ("off_center", self.off_center, 1.0, "0 to 1"),
            ("max_cut", self.max_cut, 0.5, "0 to 0.5"),
            (
                "max_dot_elongation",
                self.max_dot_elongation,
                0.5,
                "0 to 0.5",
            ),
            ("max_streaks", self.max_streaks, 1.0, "0 to 1"),
            ("max_shift_px", self.max_shift_px, 1e3, "0 to 1000 pixels"),
            ("max_gloss", self.max_gloss, 100.0, "0 to 100"),
            ("max_limb", self.max_limb, 1.0, "0 to 1"),
            ("max_background", self.max_background, 100.0, "0 to 100"),
            ("max_occlusion", self.max_occlusion, 1.0, "0 to 1"),
            ("max_noise", self.max_noise, 1e3, "0 to 1000"),
        ] {
            require((0.0..=max).contains(&value), name, expected, value)?;
        }
        require(
            (0.0..=TAU).contains(&self.max_arc_rad),
            "max_arc_rad",
            "0 to 360 degrees",
            self.max_arc_rad.to_degrees(),
        )?;
        require(
            (0.0..=PI / 3.0).contains(&self.max_off_axis_rad),
            "max_off_axis_rad",
            "0 to 60 degrees",
            self.max_off_axis_rad.to_degrees(),
        )
    }

    fn check_shares(&self) -> Result<()> {
        for (name, value) in [
            ("cut_share", self.cut_share),
            ("parallel_share", self.parallel_share),
            ("colored_ink_share", self.colored_ink_share),
            ("left_out", self.left_out),
            ("logo_probability", self.logo_probability),
            ("seam_probability", self.seam_probability),
            ("second_lamp_share", self.second_lamp_share),
            ("shadow_share", self.shadow_share),
            ("texture_share", self.texture_share),
            ("clutter_share", self.clutter_share),
            ("ground_share", self.ground_share),
            ("occlusion_share", self.occlusion_share),
            ("cords_share", self.cords_share),
            ("occluder_shadow_share", self.occluder_shadow_share),
            ("bad_exposure", self.bad_exposure),
            ("gamma_share", self.gamma_share),
            ("mosaic_share", self.mosaic_share),
            ("sharpen_share", self.sharpen_share),
            ("jpeg_share", self.jpeg_share),
            ("video_share", self.video_share),
        ] {
            require((0.0..=1.0).contains(&value), name, "0 to 1", value)?;
        }
        Ok(())
    }
}

fn pair(
    name: &'static str,
    [low, high]: [f64; 2],
    [min, max]: [f64; 2],
    expected: &str,
) -> Result<()> {
    require(
        low >= min && low <= high && high <= max,
        name,
        &format!("{expected}, the smaller first"),
        format_args!("{low},{high}"),
    )
}

/// As [`pair`], for a range in radians whose bounds are in degrees.
fn pair_deg(name: &'static str, range: [f64; 2], bounds: [f64; 2]) -> Result<()> {
    let expected = format!("{} to {} degrees", bounds[0], bounds[1]);
    pair(name, range.map(f64::to_degrees), bounds, &expected)
}
