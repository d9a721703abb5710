//! What several measuring programs share.

pub mod noise;
