//! Tests of the stage `recognize`.

mod allocations;
mod confidence;
mod paper;
mod robust;
