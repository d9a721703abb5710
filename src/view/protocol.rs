//! Protocols: the named view models by which patterns are compared.

use serde::{Deserialize, Serialize};

use super::{Detection, FalseDots, Noise, ViewModel};
use crate::error::{Error, Result};

/// A protocol's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
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

    /// The views of the protocol. It shows the ball in every view, never mirrored.
    pub fn view(self) -> ViewModel {
        let degrees = |d: f64| Noise::RandomAxis {
            sigma_rad: d.to_radians(),
        };
        let base = ViewModel {
            visibility_limit: 0.0,
            noise: degrees(3.0),
            noise_scale: 1.0,
            detection: Detection::Each { probability: 1.0 },
            false_dots: FalseDots::Usual(0),
            false_dot_limit: 0.0,
            foreign_share: 0.0,
            mirrored_share: 0.0,
            min_dots: 3,
        };
        match self {
            Self::Paper => base,
            Self::Sparse => ViewModel {
                visibility_limit: 1.0 / 3.0,
                detection: Detection::Given { dots: 4 },
                false_dot_limit: 1.0 / 3.0,
                min_dots: 4,
                ..base
            },
            Self::Clutter => ViewModel {
                noise: degrees(5.0),
                detection: Detection::Each { probability: 0.8 },
                false_dots: FalseDots::Usual(2),
                ..base
            },
            Self::Image => ViewModel {
                visibility_limit: 0.15,
                noise: Noise::Pixel {
                    sigma_px: 1.0,
                    radius_px: 30.0,
                },
                detection: Detection::Each { probability: 0.9 },
                false_dots: FalseDots::Usual(1),
                false_dot_limit: 0.15,
                ..base
            },
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

/// A protocol: a named view model, whose noise may be another than the standard one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(into = "ProtocolRecord", try_from = "ProtocolRecord")]
pub struct Protocol {
    name: ProtocolName,
    view: ViewModel,
}

impl Protocol {
    /// The protocol of that name with its standard values.
    pub fn standard(name: ProtocolName) -> Self {
        Self {
            name,
            view: name.view(),
        }
    }

    /// The same protocol with another noise.
    #[must_use]
    pub fn with_noise(mut self, noise: Noise) -> Self {
        self.view.noise = noise;
        self
    }

    /// The same protocol with another size of the noise, [`Noise::sigma_rad`].
    #[must_use]
    pub fn with_sigma_rad(self, sigma_rad: f64) -> Self {
        self.with_noise(self.view.noise.with_sigma_rad(sigma_rad))
    }

    /// Its name.
    pub fn name(&self) -> ProtocolName {
        self.name
    }

    /// Its views.
    pub fn view(&self) -> &ViewModel {
        &self.view
    }
}

/// A protocol as it stands in reports and checkpoints.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct ProtocolRecord {
    name: ProtocolName,
    visibility_limit: f64,
    dots_given: Option<usize>,
    noise: Noise,
    miss_probability: f64,
    false_dots: u16,
    min_dots: usize,
}

impl From<Protocol> for ProtocolRecord {
    fn from(protocol: Protocol) -> Self {
        let Protocol { name, view } = protocol;
        let (dots_given, miss_probability) = match view.detection {
            Detection::Each { probability } => (None, 1.0 - probability),
            Detection::Given { dots } => (Some(dots), 0.0),
        };
        Self {
            name,
            visibility_limit: view.visibility_limit,
            dots_given,
            noise: view.noise,
            miss_probability,
            false_dots: view.false_dots.usual().unwrap_or_default(),
            min_dots: view.min_dots,
        }
    }
}

impl TryFrom<ProtocolRecord> for Protocol {
    type Error = String;

    /// Only the noise may differ from the standard values.
    fn try_from(record: ProtocolRecord) -> std::result::Result<Self, String> {
        let protocol = Self::standard(record.name).with_noise(record.noise);
        protocol.view.check().map_err(|e| e.to_string())?;
        let own = ProtocolRecord::from(protocol);
        let is_same = own.visibility_limit == record.visibility_limit
            && own.dots_given == record.dots_given
            && (own.miss_probability - record.miss_probability).abs() < 1e-9
            && own.false_dots == record.false_dots
            && own.min_dots == record.min_dots;
        if is_same {
            Ok(protocol)
        } else {
            Err(format!(
                "expected the views of the protocol {}",
                record.name
            ))
        }
    }
}
