//! Tests of the stage `spin`.

mod aliases;
mod allocation;
mod bound;
mod decay;
mod estimators;
mod long;
mod motion;
mod precession;
mod scipy;
mod shared;
mod trajectories;
