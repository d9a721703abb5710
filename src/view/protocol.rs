//! The four protocols by which views are made.

use crate::error::{Error, Result, require};
use crate::recognize::robust::{NoiseShape, RobustConfig};

/// A protocol's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ProtocolName {
    /// All dots with z > 0, noise of 3 degrees (SpinDOE Sec. IV-A).
    Paper,
    /// Four of the dots with z > 1/3, noise of 3 degrees.
    Sparse,
    /// All dots with z > 0, noise of 5 degrees, 20 % missed, 2 false.
    Clutter,
    /// Dots with z > 0.15 of a ball of 30 px radius, noise of 1 px per axis, 10 % missed, 1 false.
    Image,
}

impl ProtocolName {
    /// All protocols, from the easiest to the hardest to read.
    pub const ALL: [Self; 4] = [Self::Paper, Self::Sparse, Self::Clutter, Self::Image];

    /// As written on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Sparse => "sparse",
            Self::Clutter => "clutter",
            Self::Image => "image",
        }
    }
}

impl std::str::FromStr for ProtocolName {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "protocol", name)
    }
}

impl std::fmt::Display for ProtocolName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}

/// Noise of a visible dot's position.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Noise {
    /// Rotated about an axis uniform on the sphere by an angle from N(0, sigma). Per tangent axis
    /// this has the standard deviation sigma / sqrt(3): a third of the axis lies along the dot on
    /// average.
    RandomAxis {
        /// Standard deviation of the rotation's angle, radians.
        sigma_rad: f64,
    },
    /// Moved in the image by N(0, sigma) per axis, then projected back to the sphere.
    Pixel {
        /// Standard deviation per image axis, pixels.
        sigma_px: f64,
        /// The ball's radius in the image, pixels.
        radius_px: f64,
    },
}

/// A protocol: how views are made from a pattern.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Protocol {
    /// Its name.
    pub name: ProtocolName,
    /// A dot is visible where its z exceeds this.
    pub visibility_limit: f64,
    /// Number of visible dots that are given (chosen at random); `None` gives all.
    pub dots_given: Option<usize>,
    /// Noise of a dot's position.
    pub noise: Noise,
    /// Probability that a dot is missed.
    pub miss_probability: f64,
    /// False dots, uniform on the visible cap.
    pub false_dots: usize,
    /// Views with fewer real dots are skipped, and counted.
    pub min_dots: usize,
}

impl Protocol {
    /// The protocol of that name with its standard values.
    pub fn standard(name: ProtocolName) -> Self {
        let degrees = |d: f64| Noise::RandomAxis {
            sigma_rad: d.to_radians(),
        };
        let base = Self {
            name,
            visibility_limit: 0.0,
            dots_given: None,
            noise: degrees(3.0),
            miss_probability: 0.0,
            false_dots: 0,
            min_dots: 3,
        };
        match name {
            ProtocolName::Paper => base,
            ProtocolName::Sparse => Self {
                visibility_limit: 1.0 / 3.0,
                dots_given: Some(4),
                min_dots: 4,
                ..base
            },
            ProtocolName::Clutter => Self {
                noise: degrees(5.0),
                miss_probability: 0.2,
                false_dots: 2,
                ..base
            },
            ProtocolName::Image => Self {
                visibility_limit: 0.15,
                noise: Noise::Pixel {
                    sigma_px: 1.0,
                    radius_px: 30.0,
                },
                miss_probability: 0.1,
                false_dots: 1,
                ..base
            },
        }
    }

    /// The same protocol with another noise: the angle's standard deviation, or for `image` the
    /// pixel noise that amounts to this angle at the ball's center.
    #[must_use]
    pub fn with_sigma_rad(mut self, sigma_rad: f64) -> Self {
        match &mut self.noise {
            Noise::RandomAxis { sigma_rad: s } => *s = sigma_rad,
            Noise::Pixel {
                sigma_px,
                radius_px,
            } => *sigma_px = sigma_rad * *radius_px,
        }
        self
    }

    /// The noise as an angle, radians (for `image` at the ball's center).
    pub fn sigma_rad(&self) -> f64 {
        match self.noise {
            Noise::RandomAxis { sigma_rad } => sigma_rad,
            Noise::Pixel {
                sigma_px,
                radius_px,
            } => sigma_px / radius_px,
        }
    }

    /// The noise per tangent axis, radians: a rotation about a random axis moves a dot by a third
    /// of its variance along each axis (for `image` at the ball's center).
    pub fn tangent_sigma_rad(&self) -> f64 {
        match self.noise {
            Noise::RandomAxis { sigma_rad } => sigma_rad / 3f64.sqrt(),
            Noise::Pixel { .. } => self.sigma_rad(),
        }
    }

    /// Checks the domains of all values.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the parameter.
    pub fn check(&self) -> Result<()> {
        let sigma = self.sigma_rad();
        let inside = (0.0..=std::f64::consts::PI).contains(&sigma);
        require(inside, "sigma_rad", "0 to 180 degrees", sigma.to_degrees())?;
        let (miss, limit) = (self.miss_probability, self.visibility_limit);
        require(
            (0.0..1.0).contains(&miss),
            "miss_probability",
            "[0, 1)",
            miss,
        )?;
        let inside = (-1.0..1.0).contains(&limit);
        require(inside, "visibility_limit", "a z in [-1, 1)", limit)
    }

    /// The robust recognizer's configuration for this protocol. It holds what a user who knows the
    /// camera would state: rates, the number of false dots that every view has, and the shape of
    /// the noise. It never holds which dots are false or missed.
    pub fn recognizer_config(&self) -> RobustConfig {
        let detection_probability = match self.dots_given {
            // Four of on average 6.7 visible dots are given.
            Some(_) => 0.6,
            None => (1.0 - self.miss_probability).min(0.98),
        };
        RobustConfig {
            visibility_limit: self.visibility_limit,
            detection_probability,
            expected_false_dots: (self.false_dots as f64).max(0.02),
            usual_false_dots: Some(self.false_dots as u16),
            noise: match self.noise {
                Noise::RandomAxis { .. } => NoiseShape::RandomAxis,
                Noise::Pixel { .. } => NoiseShape::Gaussian,
            },
            ..RobustConfig::default()
        }
    }
}
