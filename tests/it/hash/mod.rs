//! Tests of the stage `hash`.

mod features;
mod npz;
