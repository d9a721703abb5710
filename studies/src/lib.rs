//! What several measuring programs share.

pub mod cameras;
pub mod noise;
pub mod pictures;
pub mod ranks;
