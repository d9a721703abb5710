//! Tests of the stage `ball`.

mod features;
mod table;
