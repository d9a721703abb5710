//! The map of a ball that is bare but for dots, from a clip whose poses its dots gave.
//!
//! The frames that are placed make the surface; those that are not are laid on it from their neighbors on, and all make the next. No
//! rotation is searched for, and what is placed stays: a common fit of rotations and pixels ([`bundle`](super::bundle)), which knows nothing of
//! the camera's axis and takes outlines as they are found, made errors of 0.2 to 0.8 degrees in the middle 0.2 to 1.2 (`bench
//! calibration-unknown --seed 35100001 --plain`, five clips).

use super::bare::BareFaceMaker;
use super::face::Face;
use super::fit::{FitSpace, agreement};
use super::frame::PaintedFrame;
use super::laid::{Laid, apart};
use super::surface_map::{PlaceGrid, SurfaceMap};
use super::track::starts;
use super::viewed::{Facing, ViewedPlaces};
use crate::concurrency;
use crate::geometry::{Rotation, Vec3, spiral_directions};
use crate::stats::median;
use crate::vision::optics::camera::BallView;

/// Places of the map, 1 degree apart: dots are small.
const PLACES: usize = 40_000;
/// Surfaces made one from the other.
const ROUNDS: usize = 2;
/// A frame laid on the surface that agrees with it by less than this part of the middle frame is not placed.
const AGREES: f64 = 0.6;
/// Views of a place that count. What no view shows better is the limb: of 39 marks that only views of 0.1 to 0.2 showed, on 40 clips whose
/// frames show every dot, none was a dot (`bench calibration-unknown --plain`, seeds 35100001 and 35100002).
const FACING: Facing = Facing {
    well: 0.2,
    least: 0.2,
    enough: 2,
};

/// A frame of a clip.
#[derive(Debug, Clone, Copy)]
pub struct MappedFrame<'a> {
    /// What it shows.
    pub paint: &'a PaintedFrame,
    /// How it sees the ball.
    pub view: BallView,
    /// How the ball lies in it, map to view frame, where that is known.
    pub rotation: Option<Rotation>,
}

/// Makes maps.
#[derive(Debug, Default)]
pub struct PaintMapper {
    grid: PlaceGrid,
    maker: BareFaceMaker,
}

impl PaintMapper {
    /// The frames of a clip, in the order of time, laid on the surface; those whose orientation this shows get their rotations.
    pub fn lay_out(&self, frames: &mut [MappedFrame<'_>]) -> MappedClip {
        let faces = concurrency::map(frames, |f| self.maker.take(f.paint, &f.view));
        let mut laid: Vec<Option<Laid>> =
            frames.iter().map(|f| Some(Laid::at(f.rotation?))).collect();
        for _ in 0..ROUNDS {
            let surface = SurfaceMap::of(&self.grid, &apart(&faces, &laid));
            // The same frames make the same map.
            if !self.lay(&faces, &surface, &mut laid) {
                break;
            }
        }
        for (frame, laid) in frames.iter_mut().zip(&laid) {
            frame.rotation = laid.map(|l| l.rotation);
        }
        MappedClip { faces, laid }
    }

    /// Lays the open frames, outwards from the placed ones, and says whether one is placed by that.
    fn lay(&self, faces: &[Option<Face>], surface: &SurfaceMap, laid: &mut [Option<Laid>]) -> bool {
        let placed: Vec<(&Face, Rotation)> = (faces.iter().zip(laid.iter()))
            .filter_map(|(face, laid)| Some((face.as_ref()?, laid.as_ref()?.rotation)))
            .collect();
        let agreements = concurrency::map(&placed, |(face, rotation)| {
            agreement(&self.grid, surface, face, rotation)
        });
        let mut agreements: Vec<f64> = agreements.into_iter().flatten().collect();
        let least = AGREES * median(&mut agreements);
        let mut has_new = false;
        loop {
            let is_open = |k: &usize| laid[*k].is_none() && faces[*k].is_some();
            let open: Vec<usize> = (0..laid.len()).filter(is_open).collect();
            let found = concurrency::map(&open, |&k| {
                let face = faces[k].as_ref()?;
                let mut space = FitSpace::default();
                let (before, after) = (&laid[..k], &laid[k + 1..]);
                let starts = starts(before.iter().rev()).chain(starts(after.iter()));
                let tried = starts.filter_map(|r| space.lay(&self.grid, surface, face, &r));
                let best = tried.max_by(|a, b| a.agreement.total_cmp(&b.agreement));
                best.filter(|l| l.agreement >= least)
            });
            if found.iter().all(Option::is_none) {
                return has_new;
            }
            has_new = true;
            for (k, found) in open.into_iter().zip(found) {
                laid[k] = found;
            }
        }
    }
}

/// A clip whose frames are laid on the surface.
#[derive(Debug)]
pub struct MappedClip {
    faces: Vec<Option<Face>>,
    laid: Vec<Option<Laid>>,
}

impl MappedClip {
    /// The map that the frames show.
    pub fn map(&self) -> ViewedPlaces {
        let places: Vec<Vec3> = spiral_directions(PLACES).collect();
        ViewedPlaces::new(&places, &apart(&self.faces, &self.laid), FACING)
    }

    /// Looks for what hides the ball in the frames: what is so much darker than the bare ball, over that, and larger than a disc of so many radians.
    pub fn find_cover(&mut self, darkness: f64, radius: f64) {
        let darkest = (1.0 - darkness).max(1e-3).ln();
        let covers = concurrency::map(&self.faces, |face| {
            face.as_ref().map(|f| f.cover(darkest, radius))
        });
        for (face, cover) in self.faces.iter_mut().zip(covers) {
            if let (Some(face), Some(cover)) = (face, cover) {
                face.covered = cover;
            }
        }
    }

    /// Whether something hides the ball in a frame, at a direction of its view frame that is visible.
    pub fn is_covered(&self, frame: usize, direction: &Vec3) -> bool {
        self.faces[frame]
            .as_ref()
            .is_some_and(|f| f.is_covered(direction))
    }
}
