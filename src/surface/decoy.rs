//! Whether the frames of a clip show one ball.
//!
//! A face agrees somewhere with any surface: paint is blotches of like sizes all over. How well it does so by chance is measured on decoys,
//! the same faces cut into rings that are turned against each other: they have the paint's tones and sizes, and no ball shows them. The
//! frames are taken in two halves, every second placed one: each is laid on the surface that the other half shows, and the decoys of all
//! frames, placed or not, anywhere on it. Frames of one ball agree, in the middle, by more than any decoy. Related: J. E. Elias, S. P. Gygi,
//! "Target-decoy search strategy for increased confidence in large-scale protein identifications", Nature Methods 4, 2007.

use super::face::Face;
use super::fit::FitSpace;
use super::laid::{LAID, Laid, apart, few, numbers};
use super::search::{Blurred, Search};
use super::surface_map::{PlaceGrid, SurfaceMap};
use crate::concurrency;
use crate::stats::median;

/// Frames of each half that are compared, and decoys laid on its surface, at most.
pub(super) const TESTED: usize = 12;
/// By so much more, after Fisher's transform, frames of one ball agree: 12 clips of three kinds were 0.5 to 1.5 above their decoys (`bench
/// painted`, seeds 59000002 and 59000003), two sets of unrelated frames of 36 and 60 pixels -0.1 and 0.0.
const MARGIN: f64 = 0.2;

/// What decoys are compared on.
pub(crate) struct Decoys<'a> {
    pub grid: &'a PlaceGrid,
    pub search: &'a Search,
    pub faces: &'a [Option<Face>],
}

impl Decoys<'_> {
    /// Whether the frames that are placed, and make the surface themselves, agree with each other by more than by chance.
    pub fn are_beaten(&self, laid: &[Option<Laid>]) -> bool {
        let placed = numbers(laid);
        if placed.len() < 2 {
            return true;
        }
        let seen = numbers(self.faces);
        let (mut own, mut by_chance) = (Vec::new(), 0.0f64);
        for half in 0..2 {
            let every_second = |all: &[usize]| {
                all.iter()
                    .skip(half)
                    .step_by(2)
                    .copied()
                    .collect::<Vec<_>>()
            };
            let mut others = laid.to_vec();
            let tested = every_second(&placed);
            tested.iter().for_each(|k| others[*k] = None);
            let surface = SurfaceMap::of(self.grid, &apart(self.faces, &others));
            let agrees = |&k: &usize| {
                let (face, laid) = (self.faces[k].as_ref()?, laid[k].as_ref()?);
                let laid = FitSpace::default().lay(self.grid, &surface, face, &laid.rotation)?;
                Some(laid.agreement)
            };
            own.extend(
                concurrency::map(&few(&tested, TESTED), agrees)
                    .into_iter()
                    .flatten(),
            );
            by_chance = by_chance.max(self.by_chance(&surface, &every_second(&seen)));
        }
        stands_out(&mut own, by_chance)
    }

    /// Whether the frames that are placed on a surface which others made agree with it by more than by chance.
    pub fn are_beaten_on(&self, surface: &SurfaceMap, laid: &[Option<Laid>]) -> bool {
        let mut own: Vec<f64> = laid.iter().flatten().map(|l| l.agreement).collect();
        own.is_empty() || stands_out(&mut own, self.by_chance(surface, &numbers(self.faces)))
    }

    /// The best that a decoy agrees with a surface.
    fn by_chance(&self, surface: &SurfaceMap, frames: &[usize]) -> f64 {
        let blurred = self.search.blurred(self.grid, surface);
        let agrees = |&k: &usize| self.agreement(surface, &blurred, self.faces[k].as_ref()?);
        let agreements = concurrency::map(&few(frames, TESTED), agrees);
        agreements.into_iter().flatten().fold(0.0, f64::max)
    }

    /// The best that the decoy of a face agrees with a surface.
    pub fn agreement(&self, surface: &SurfaceMap, blurred: &Blurred, face: &Face) -> Option<f64> {
        let decoy = face.decoy();
        let found = self.search.find(blurred, &decoy, None);
        let mut space = FitSpace::default();
        let laid = found.iter().take(LAID);
        let laid = laid.filter_map(|(r, _)| space.lay(self.grid, surface, &decoy, r));
        laid.map(|l| l.agreement).max_by(f64::total_cmp)
    }
}

/// Correlations are compared by Fisher's transform: the noise of one is then that of any other.
pub(super) fn stands_out(own: &mut [f64], by_chance: f64) -> bool {
    !own.is_empty() && median(own).atanh() > by_chance.atanh() + MARGIN
}
