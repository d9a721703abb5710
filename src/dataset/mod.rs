//! A data set of flights, as the SpinDOE authors published one: where balls were over time, with their spins.
//!
//! ```text
//! clips -> clip::run -> orientations and positions -> flights, apart at their bounces -> a spin each -> files
//! ```
//!
//! A folder holds
//! - `index.csv` and a file `NNN.csv` for each flight, in the authors' format ([`trajectories`](crate::spin::trajectories)), which their reader
//!   reads: times from the flight's first position on, positions and spins in the frame that `dataset.json` names;
//! - `orientations/NNN.csv`, what was estimated in each frame of the flight, with the covariances of orientation and position
//!   ([`orientations`](crate::spin::orientations)) and the times of the clip;
//! - `dataset.json`, a [`Record`]: tables, camera, clips, where their times came from, each flight's spin with its covariance, its bounce, the version;
//! - `plots/NNN_spin.png` and `plots/NNN_positions.png`, by which a flight is checked.
//!
//! Guarantees: a folder with an index is whole; positions are measured, not smoothed; a flight without a spin says why, and has no row in the index. Not
//! guaranteed: what [`bounce`] does not.

pub mod bounce;
mod files;
mod flight;
#[cfg(feature = "plot")]
mod plots;
mod record;

pub use bounce::{Bounce, BounceConfig, PathPoint, bounces};
pub use files::{Destination, write};
pub use flight::{DatasetConfig, Flight, FlightClip, flights, read_clip};
pub use record::{
    BounceRecord, ClipRecord, FORMAT_VERSION, FlightRecord, Record, SpinRecord, TableRecord,
};
