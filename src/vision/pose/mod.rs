//! From dots to the ball's orientation: dots are identified, all places where dots may be are matched with the pattern, the pose is
//! refined on dots and then on pixels, and its probability is that of all that speaks for it ([`TrustMap`]).

pub(crate) mod align;
pub(crate) mod all_places;
pub(crate) mod identify;
pub(crate) mod pixels;
pub(crate) mod places;
pub(crate) mod refine;
pub(crate) mod rotations;
pub(crate) mod sharpen;
pub(crate) mod trust;

pub use trust::{
    FEATURES, PixelsEvidence, PlacesEvidence, PoseEvidence, PoseSource, TrustMap, TrustWeights,
};
