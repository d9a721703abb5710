//! Tests of the stage `design`.

mod objectives;
mod orientation_bound;
mod polish;
mod search;
