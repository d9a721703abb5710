//! Numbers that follow from the nets and the synthetic world, as `models/derived.json` has them.
//!
//! `bench derive` in `studies/` computes them; the file names the command and the SHA-256 of each input, and a test
//! fails where an input has changed since.

include!(concat!(env!("OUT_DIR"), "/derived.rs"));
