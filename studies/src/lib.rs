//! What several measuring programs share.

pub mod noise;
pub mod ranks;
