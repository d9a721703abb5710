//! Dot patterns for balls: designed, evaluated, shipped, and recognized.
//!
//! A ball carries identical dots. Their arrangement identifies them (geometric hashing), which gives
//! the ball's orientation in one camera image; a sequence of orientations gives its spin. This crate
//! designs such patterns, proves them by Monte Carlo, writes the table that an estimator loads and
//! the stencil that a 3-D printer makes, and holds the estimator's stages. It follows T. Gossard, J.
//! Tebbe, A. Ziegler, A. Zell, "SpinDOE: a ball spin estimation method for table tennis robot", IROS
//! 2023 (arXiv 2303.03879), and keeps the paper's algorithms as named baselines.
//!
//! # Stages
//! Imports run from left to right only:
//! [`geometry`] <- [`pattern`] <- [`ball`] (what all others are made for) <- [`view`] <- [`recognize`] <- [`validate`] <- [`design`];
//! [`pipeline`] (work on a stream) serves [`recognize`];
//! [`stencil`], [`mark`], [`spin`], [`vision`] (from an image to an orientation), [`surface`] (a map of all that is on a ball, by the
//! frames of a clip) and [`clip`] (all frames of one) stand beside them, [`dataset`] (flights of many), [`plot`], [`report`] and [`cli`]
//! on top.
//!
//! # Conventions
//! The library takes radians and SI units. Camera frame: x right, y up, z from the ball towards the
//! camera; a dot is visible where z > 0. A [`geometry::Rotation`] maps the pattern's frame to the
//! camera's. All that is random is seeded, and the same seed gives the same bytes on any number of
//! threads.
//!
//! # Examples
//! How often is a pattern identified correctly?
//!
//! ```
//! use spindoe::{Ball, Pattern, ValidationConfig};
//!
//! # fn main() -> spindoe::Result<()> {
//! # let mut rng = <rand_chacha::ChaCha8Rng as rand::SeedableRng>::seed_from_u64(1);
//! # let pattern = spindoe::pattern::random_pattern(20, 0.3, &mut rng)?;
//! // or: let pattern = Pattern::read_csv("pattern.csv".as_ref())?;
//! let config = ValidationConfig { samples: 200, ..ValidationConfig::default() };
//! let found = config.run(&Ball::new(pattern), &|_| {})?;
//! println!("{} of {} trials", found.validation.answered, found.validation.samples);
//! assert!(found.validation.answered.rate > 0.9);
//! # Ok(())
//! # }
//! ```
//!
//! Which dots are these, and what is the orientation?
//!
//! ```
//! use spindoe::{DotUncertainty, ObservedDot, Recognizer, RobustConfig, RobustRecognizer};
//!
//! # fn main() -> spindoe::Result<()> {
//! # let mut rng = <rand_chacha::ChaCha8Rng as rand::SeedableRng>::seed_from_u64(1);
//! # let pattern = spindoe::pattern::random_pattern(20, 0.3, &mut rng)?;
//! # let truth = spindoe::geometry::random_rotation(&mut rng);
//! let recognizer = RobustRecognizer::new(&pattern, RobustConfig::default())?;
//! let mut workspace = recognizer.workspace();
//! // Unit vectors in the camera frame, here made from a known orientation.
//! let dots: Vec<ObservedDot> = pattern.dots().iter().map(|dot| truth * dot)
//!     .filter(|direction| direction.z > 0.2)
//!     .map(|direction| ObservedDot {
//!         direction,
//!         uncertainty: DotUncertainty::Isotropic { sigma_rad: 0.03 },
//!     })
//!     .collect();
//! let found = recognizer.identify(&dots, &mut workspace).expect("the dots are those of the pattern");
//! assert!(found.rotation.angle_to(&truth) < 0.01 && found.confidence > 0.99);
//! # Ok(())
//! # }
//! ```
//!
//! What is the spin?
//!
//! ```
//! use spindoe::{Measurement, Rotation, SpinConfig, SpinEstimator, Vec3};
//!
//! let spin = Vec3::new(0.0, 120.0, 30.0); // rad/s
//! let orientations: Vec<Measurement> = (0..10)
//!     .map(|k| f64::from(k) / 350.0)
//!     .map(|time_s| Measurement::new(time_s, Rotation::from_scaled_axis(spin * time_s)))
//!     .collect();
//! let fit = SpinEstimator::new(SpinConfig::default()).fit(&orientations).expect("a spin");
//! assert!((fit.motion.spin - spin).norm() < 0.1);
//! ```
//!
//! A stencil to print, in memory:
//!
//! ```
//! use spindoe::stencil::HalfName;
//! use spindoe::{Pattern, Stencil, StencilConfig};
//!
//! # fn main() -> spindoe::Result<()> {
//! # let text = include_bytes!("../designs/dots12/pattern.csv");
//! let pattern = Pattern::from_csv("pattern.csv".as_ref(), text)?;
//! let stencil = Stencil::build(&pattern, &StencilConfig::default())?;
//! assert!(stencil.half_stl_bytes(HalfName::A)?.len() > 84);
//! # Ok(())
//! # }
//! ```
//!
#![cfg_attr(
    feature = "vision",
    doc = r#"
From an image to the orientation (feature `vision`):

```
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::independent_frame;
use spindoe::vision::{Budget, DetectorName, Prior};
use spindoe::{Estimator, EstimatorConfig, FrameEstimate, Pattern};

# fn main() -> spindoe::Result<()> {
# let text = include_bytes!("../designs/dots20/pattern.csv");
let pattern = Pattern::from_csv("pattern.csv".as_ref(), text)?;
let estimator = Estimator::new(&pattern, EstimatorConfig::default(), DetectorName::Cnn.build()?)?;
let mut workspace = estimator.workspace();
let mut estimate = FrameEstimate::default();
let frame = independent_frame(&pattern, &SynthConfig::good(), 1, 0)?;
estimator.estimate(&frame.image, &Prior::default(), &Budget::default(), &mut workspace, &mut estimate);
match &estimate.outcome {
    Ok(pose) => println!("{} with probability {}", pose.rotation, pose.confidence),
    Err(rejection) => println!("no answer: {rejection}"),
}
# Ok(())
# }
```
"#
)]

pub mod ball;
#[cfg(feature = "vision")]
pub mod calibrate;
#[cfg(feature = "vision")]
pub mod camera;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
#[cfg(feature = "vision")]
pub mod clip;
mod concurrency;
#[cfg(feature = "vision")]
pub mod dataset;
pub mod design;
mod error;
pub mod files;
#[cfg(feature = "vision")]
mod fit;
pub mod geometry;
#[cfg(feature = "vision")]
pub mod image;
#[cfg(feature = "mark")]
pub mod mark;
mod npz;
pub mod pattern;
#[cfg(feature = "native")]
pub mod pipeline;
#[cfg(feature = "plot")]
pub mod plot;
pub mod recognize;
#[cfg(feature = "native")]
pub mod report;
#[cfg(feature = "vision")]
pub mod source;
pub mod spin;
pub mod stats;
pub mod stencil;
#[cfg(feature = "vision")]
pub mod surface;
#[cfg(feature = "vision")]
pub mod synth;
pub mod validate;
pub mod view;
#[cfg(feature = "vision")]
pub mod vision;

pub use ball::{Ball, PairRule, PaperConfig, Placement};
pub use concurrency::StopFlag;
pub use design::{Constraints, DesignConfig, KeepOut, ObjectiveName};
pub use error::{Error, Parameter, Result};
pub use geometry::{Rotation, Vec3};
pub use pattern::Pattern;
pub use recognize::robust::{RobustConfig, RobustRecognizer};
pub use recognize::{Explanations, Hint, Identification, Recognizer};
#[cfg(feature = "native")]
pub use report::DesignJob;
pub use spin::motion::ConstantSpin;
pub use spin::robust::{RobustEstimator as SpinEstimator, SpinConfig};
pub use spin::{Fit as SpinFit, Measurement};
pub use stats::Proportion;
pub use stencil::{Stencil, StencilConfig};
pub use validate::{Trials, Validation, ValidationConfig};
pub use view::{DotUncertainty, ObservedDot, Protocol, ProtocolName, ViewModel};
#[cfg(feature = "vision")]
pub use vision::{Estimator, EstimatorConfig, FrameEstimate, Pose};
