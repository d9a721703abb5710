//! Tests of the stage `spin`.

mod aliases;
mod allocation;
mod bound;
mod clock;
mod decay;
mod estimators;
mod free;
mod lies;
mod long;
mod motion;
mod precession;
mod scipy;
mod shared;
mod trajectories;
