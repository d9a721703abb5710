//! Tests of the stage `spin`.

mod aliases;
mod allocation;
mod bound;
mod clock;
mod decay;
mod estimators;
mod fictrac;
mod free;
mod golf_shot;
mod lies;
mod long;
mod motion;
mod precession;
mod repeated;
mod scipy;
mod shared;
mod trajectories;
