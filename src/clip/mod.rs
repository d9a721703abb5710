//! All frames of a clip: each estimated, those in doubt again between their neighbors, several balls distinguished, the table and the
//! mirror image judged by all frames together.

pub(crate) mod ball_tracks;
pub(crate) mod balls;
pub(crate) mod batch;
mod choice;
pub(crate) mod config;
pub(crate) mod evidence;
pub(crate) mod focal;
mod followed;
pub mod frame_table;
pub(crate) mod judgment;
mod live_judgment;
pub(crate) mod orientations;
pub(crate) mod outlines;
pub(crate) mod painted;
mod painted_stream;
mod read;
pub mod rig;
pub(crate) mod rolling;
pub(crate) mod run;
mod second;
pub(crate) mod sequence;
pub(crate) mod sequence_view;
mod shot;
pub(crate) mod smears;
pub(crate) mod strobe;
pub(crate) mod times;
pub(crate) mod tracker;
pub mod verdict;
pub(crate) mod work;

pub use ball_tracks::{BallTracks, NumberedBalls, missing_balls, number_balls};
pub use balls::{BallEstimate, BallsEstimator, BallsWorkspace, sort_from_left};
pub use batch::{Batch, BatchFrame, BatchObserver, SequenceOutcome};
pub use config::{BatchConfig, FrameClock};
pub use evidence::SequenceEvidence;
pub use focal::{CameraCheck, FocalDoubt, LiveCheck, SeenOval, focal_doubt};
pub use judgment::Judgment;
pub use orientations::{NamedFrame, orientations};
pub use painted::{PaintedClip, PaintedEstimator, SurfaceObserver};
pub use painted_stream::{PaintedState, PaintedStream};
pub use rig::{
    CameraAgreement, CameraClip, ClockCheck, Fusion, Misfit, RigClip, RigConfig, RigDoubt,
    RigFrame, RigOutcome, combine, run_rig, run_rig_sources,
};
pub use rolling::{SequenceRows, seen_times};
pub use run::{run, run_sources};
pub use sequence::{
    FrameInDoubt, ImageResults, ImageWork, SequenceConfig, SequenceSummary, estimate_passes,
    estimate_sequence, estimate_spin, frames_in_doubt, held_images, second_pass,
};
pub use sequence_view::SequenceView;
pub use smears::SequenceSmears;
pub use strobe::{Strobe, StrobeHypothesis};
pub use times::TimeSource;
pub use tracker::{Tracker, TrackerConfig, TrackerState};
pub use work::Work;
