//! The ball's outline: by its edges ([`circle`]), by a [`net`], by the frames before and after, corrected by its rim. [`find`]
//! settles a ball without its dots.

pub mod circle;
pub mod find;
pub(crate) mod locate;
pub mod net;
pub(crate) mod path;
pub(crate) mod place;
pub(crate) mod recenter;
pub(crate) mod rim;
pub(crate) mod steady;
