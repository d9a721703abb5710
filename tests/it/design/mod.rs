//! Tests of the stage `design`.

mod coincidence;
mod confusion;
mod objectives;
mod orientation_bound;
mod polish;
mod search;
mod shard;
