//! The ball's outline: by its edges ([`circle`]), by a [`net`], by the frames before and after, corrected by its rim.

pub mod circle;
pub(crate) mod locate;
pub mod net;
pub(crate) mod path;
pub(crate) mod place;
pub(crate) mod rim;
