//! Tests of the stage `spin`.

mod aliases;
mod allocation;
mod decay;
mod dots;
mod estimators;
mod precession;
mod scipy;
mod shared;
mod trajectories;
