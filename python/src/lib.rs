//! The native part of the Python package `spindoe`: conversions between NumPy and the library.
//!
//! Classes here are handles; what users see is in `spindoe/*.py`, with documentation and types. Every
//! call that takes longer than a few microseconds releases the interpreter's lock, long ones listen
//! for Ctrl-C. Settings and reports cross the border as JSON, numbers as arrays.

mod arrays;
mod balls;
mod calibrate;
mod clip;
mod command;
mod dataset;
mod design;
mod errors;
mod estimator;
mod fictrac;
mod frames;
mod image;
mod painted;
mod pattern;
mod published;
mod recognizer;
mod rig;
mod spin;
mod stencil;
mod synth;
mod training;
mod validate;
mod work;

use pyo3::prelude::*;

#[pymodule]
mod _native {
    #[pymodule_export]
    use super::balls::Balls;
    #[pymodule_export]
    use super::command::command;
    #[pymodule_export]
    use super::dataset::write_dataset;
    #[pymodule_export]
    use super::design::{DesignJob, design_request, merge};
    #[pymodule_export]
    use super::estimator::{
        BallView, Estimator, Tracker, intrinsics_of, project_points, read_intrinsics, size_doubt,
    };
    #[pymodule_export]
    use super::fictrac::fictrac_rows;
    #[pymodule_export]
    use super::image::read_image;
    #[pymodule_export]
    use super::painted::{PaintedEstimator, PaintedTracker, Surface};
    #[pymodule_export]
    use super::pattern::{HashTable, Pattern, shipped_designs};
    #[pymodule_export]
    use super::published::{onnx_bytes, read_trajectories};
    #[pymodule_export]
    use super::recognizer::Recognizer;
    #[pymodule_export]
    use super::rig::Rig;
    #[pymodule_export]
    use super::spin::{fit_spin, in_axes};
    #[pymodule_export]
    use super::stencil::Stencil;
    #[pymodule_export]
    use super::synth::{RigSequence, Sequence, independent_frame};
    #[pymodule_export]
    use super::training::{
        NetWeights, TrainingSamples, net_graph, samples_per_frame, training_batch, world_sha256,
    };
    #[pymodule_export]
    use super::validate::{trial_views, validate};

    use super::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add(
            "MIN_CONFIDENCE_DOTS",
            spindoe::recognize::MIN_CONFIDENCE_DOTS,
        )?;
        module.add(
            "MIN_CONFIDENCE_IMAGES",
            spindoe::recognize::MIN_CONFIDENCE_IMAGES,
        )
    }
}
