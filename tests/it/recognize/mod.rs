//! Tests of the stage `recognize`.

mod allocations;
mod paper;
mod robust;
