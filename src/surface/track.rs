//! The frames of a clip, one after the other on a surface that grows, and all of them on the surface that all show.

use nalgebra::Matrix3;

use super::bundle::{self, Paint};
use super::clip::{Clip, Views};
use super::decoy::Decoys;
use super::face::{Face, FaceMaker};
use super::fit::FitSpace;
use super::frame::PaintedFrame;
use super::laid::{LAID, Laid, TURNED, apart, few, numbers};
use super::order::have_order;
use super::search::{Blurred, Search};
use super::surface_map::{PlaceGrid, SurfaceMap};
use crate::concurrency;
use crate::geometry::{Rotation, Vec3, rotation_angle, turned_covariance};
use crate::stats::median;
use crate::vision::frame::config::CameraModel;
use crate::vision::optics::camera::{BallView, Pixel};

/// A frame that agrees so well lies where it was expected: right ones agreed by 0.93 in the middle, and 0.82 at the 5th percentile.
const SURE: f64 = 0.8;
/// A frame that agrees less, next to where it was expected, is not placed: frames that drifted off agreed by 0.60 to 0.66, right ones at
/// the 1st percentile by 0.77 (seed 35400001).
const AGREES: f64 = 0.65;
/// A frame that agrees by less than this part of the middle one so far is not taken into the surface.
const GROWS: f64 = 0.85;
/// After so many frames, and twice, four times .. as many, all of them are laid on the surface that they show.
pub(super) const FIRST_CHECK: usize = 16;
/// A frame that agrees less, anywhere on the ball, is not placed: in flight, where a part of the surface is known, nine of ten wrong
/// places agreed by less than 0.72, and nineteen of twenty right ones by more than 0.81; on treadmills, under a camera at a wrong
/// distance, half of the wrong ones by less than 0.75 (seed 35400001, 6 clips each).
const FOUND: f64 = 0.75;
/// A ball turns no farther between two frames, radians.
const NEAR: f64 = 0.9;
/// Surfaces made one from the other at the end.
const ROUNDS: usize = 3;

/// Steps of a fit of all at once, and the frames that take part at most.
const STEPS: usize = 4;
/// The fit has settled where a step moves what all views share by no more, radii of the outline: a shift feigns a turn of as many radians,
/// of which a fortieth of [`SYSTEMATIC`] is nothing.
const SETTLED: f64 = 3e-4;
const ASKED: usize = 150;

/// Standard deviation per axis that no number of pixels takes away, radians: light, outline and surface err alike in many of them.
/// By it, 95 % of the squared errors over their covariances, a third each, are below 2.0 on treadmills, 3.1 in hands and 2.0 in flight, where
/// 2.6 is expected (`bench painted --seed 35400003`, 8 clips each); most are far smaller.
pub(crate) const SYSTEMATIC: f64 = 0.012;

/// A frame on the surface.
#[derive(Debug, Clone, Copy)]
pub struct PaintedPose {
    /// Surface to camera frame, or to the view frame where the intrinsics are not known.
    pub rotation: Rotation,
    /// Covariance of the small rotation that leads from it to the true one, in the same frame, rad^2.
    pub covariance: Matrix3<f64>,
    /// Correlation of what the frame shows with the surface.
    pub agreement: f64,
    /// The ball in the picture, as the whole clip has its outline and the camera.
    pub view: BallView,
}

impl PaintedPose {
    /// Of a face that lies on the surface, under its view.
    pub(super) fn new(face: &Face, laid: &Laid, view: BallView) -> Self {
        let center = face.center_sigma().powi(2);
        let outline = Matrix3::from_diagonal(&[center, center, 0.0].into());
        let other = Matrix3::from_diagonal_element(SYSTEMATIC * SYSTEMATIC);
        let to_camera = view.to_camera();
        Self {
            rotation: to_camera * laid.rotation,
            covariance: turned_covariance(&to_camera, &(laid.covariance + outline + other)),
            agreement: laid.agreement,
            view,
        }
    }

    /// Where a direction of the surface is seen, pixels; `None` on the far side.
    pub fn project(&self, direction: &Vec3) -> Option<Pixel> {
        let seen = self.view.to_camera().inverse() * (self.rotation * direction);
        (seen.z > self.view.horizon()).then(|| self.view.project(&seen))
    }
}

/// Why a frame has no pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PaintedRejection {
    /// No outline was found.
    #[error("no ball is found")]
    NoBall,
    /// Nothing like it is on the surface.
    #[error("the paint that it shows lies nowhere on the ball as the other frames show it")]
    Lost,
}

/// The frames' poses, each or why there is none.
pub type PaintedPoses = Vec<std::result::Result<PaintedPose, PaintedRejection>>;

/// A clip on the surface that it shows.
#[derive(Debug)]
pub struct PaintedTrack {
    /// In the order of the frames, in the frame of the surface.
    pub poses: PaintedPoses,
    /// The surface, in the view frame of the first frame with a pose.
    pub surface: SurfaceMap,
}

/// Finds painted balls' orientations.
#[derive(Debug)]
pub struct PaintedTracker {
    pub(super) grid: PlaceGrid,
    pub(super) search: Search,
    pub(super) maker: FaceMaker,
    pub(super) camera: CameraModel,
}

impl PaintedTracker {
    /// Of a camera, or of one whose distance is not known.
    pub fn new(camera: &CameraModel) -> Self {
        Self {
            grid: PlaceGrid::default(),
            search: Search::new(),
            maker: FaceMaker::default(),
            camera: *camera,
        }
    }

    /// The poses of a clip's frames, in the order of time, relative to the first of them, and the surface.
    pub fn track(&self, frames: &[PaintedFrame]) -> PaintedTrack {
        let mut clip = Clip::new(frames, &self.camera, Views::of(&self.camera));
        let mut laid = self.grow(&mut clip);
        for _ in 0..ROUNDS {
            let is_settled;
            (laid, is_settled) = self.together(&mut clip, laid);
            if is_settled {
                break;
            }
        }
        if !have_order(&laid) || !self.decoys(&clip.faces).are_beaten(&laid) {
            // The first is where the surface begins, and says nothing.
            let first = laid.iter().position(Option::is_some);
            let others = laid.iter_mut().enumerate();
            others
                .filter(|(k, _)| Some(*k) != first)
                .for_each(|(_, laid)| *laid = None);
        }
        if let Some(first) = laid.iter().flatten().next().map(|l| l.rotation.inverse()) {
            for laid in laid.iter_mut().flatten() {
                laid.rotation *= first;
            }
        }
        PaintedTrack {
            surface: self.surface(&clip.faces, &laid),
            poses: poses(&clip, &laid),
        }
    }

    /// The poses on a surface that an earlier clip made, each frame alone.
    pub fn place(&self, frames: &[PaintedFrame], surface: &SurfaceMap) -> PaintedPoses {
        let blurred = self.search.blurred(&self.grid, surface);
        let mut clip = Clip::new(frames, &self.camera, Views::of(&self.camera));
        clip.reach(clip.len(), &self.maker);
        let mut laid = concurrency::map(&clip.faces, |face| {
            let face = face.as_ref()?;
            self.lost(&mut FitSpace::default(), surface, &blurred, face, None)
        });
        self.fit_views(&mut clip, surface, &mut laid);
        let mut laid = self.settle(&clip.faces, surface, &laid);
        if !self.decoys(&clip.faces).are_beaten_on(surface, &laid) {
            laid.fill(None);
        }
        poses(&clip, &laid)
    }

    /// What the views of a clip share, by frames that lie on a surface which others made.
    pub(super) fn fit_views(
        &self,
        clip: &mut Clip<'_>,
        surface: &SurfaceMap,
        laid: &mut [Option<Laid>],
    ) {
        let asked = asked(laid);
        for _ in 0..STEPS {
            let step = bundle::step(&self.grid, surface, Paint::Known, clip, &asked, laid);
            let Some(shared) = step.filter(|step| step.amax() > SETTLED) else {
                break;
            };
            clip.correct(&shared, &asked, &self.maker);
        }
        clip.catch_up(&asked, &self.maker);
    }

    pub(super) fn decoys<'a>(&'a self, faces: &'a [Option<Face>]) -> Decoys<'a> {
        Decoys {
            grid: &self.grid,
            search: &self.search,
            faces,
        }
    }

    /// All frames so far, the surface and what the views share, fitted together; then each frame by itself. Says whether what the views share
    /// stayed as it was.
    fn together(
        &self,
        clip: &mut Clip<'_>,
        mut laid: Vec<Option<Laid>>,
    ) -> (Vec<Option<Laid>>, bool) {
        let asked = asked(&laid);
        let mut surface = self.surface(&clip.faces, &laid);
        let mut steps = 0;
        while steps < STEPS {
            let step = bundle::step(&self.grid, &surface, Paint::Own, clip, &asked, &mut laid);
            let Some(shared) = step.filter(|step| step.amax() > SETTLED) else {
                break;
            };
            steps += 1;
            clip.correct(&shared, &asked, &self.maker);
            let mut fitted = vec![None; laid.len()];
            asked.iter().for_each(|k| fitted[*k] = laid[*k]);
            surface = self.surface(&clip.faces, &fitted);
        }
        clip.catch_up(&asked, &self.maker);
        (self.settle(&clip.faces, &surface, &laid), steps == 0)
    }

    /// Frame after frame, each on what those before it show.
    fn grow(&self, clip: &mut Clip<'_>) -> Vec<Option<Laid>> {
        let mut surface = SurfaceMap::unknown();
        let mut blurred: Option<Blurred> = None;
        let mut space = FitSpace::default();
        let mut all: Vec<Option<Laid>> = Vec::with_capacity(clip.len());
        let mut added: Option<Rotation> = None;
        let mut check = FIRST_CHECK;
        clip.reach(check, &self.maker);
        for k in 0..clip.len() {
            if k == check {
                (all, _) = self.together(clip, all);
                surface = self.surface(&clip.faces, &all);
                blurred = None;
                added = all.iter().rev().flatten().next().map(|l| l.rotation);
                check *= 2;
                clip.reach(check, &self.maker);
            }
            let Some(face) = &clip.faces[k] else {
                all.push(None);
                continue;
            };
            if added.is_none() {
                let first = Laid::first();
                surface.add(&self.grid, face, &first);
                added = Some(first.rotation);
                all.push(Some(first));
                continue;
            }
            let best = self.next(
                &mut space,
                &surface,
                || blurred.get_or_insert_with(|| self.search.blurred(&self.grid, &surface)),
                face,
                all.iter().rev(),
            );
            if let Some(laid) = best
                .as_ref()
                .filter(|b| b.agreement >= GROWS * middle(&all))
                && added.is_none_or(|a| rotation_angle(&a, &laid.rotation) > TURNED)
            {
                surface.add(&self.grid, face, laid);
                added = Some(laid.rotation);
                blurred = None;
            }
            all.push(best);
        }
        all
    }

    /// Where a face lies that comes after others, which are given from the newest on: where their turn leads, else near the newest, else
    /// anywhere, for which `blurred` is asked.
    pub(super) fn next<'l, 'b>(
        &self,
        space: &mut FitSpace,
        surface: &SurfaceMap,
        blurred: impl FnOnce() -> &'b Blurred,
        face: &Face,
        mut before: impl Iterator<Item = &'l Option<Laid>> + Clone,
    ) -> Option<Laid> {
        let mut best: Option<Laid> = None;
        let is_sure = |best: &Option<Laid>| best.as_ref().is_some_and(|b| b.agreement >= SURE);
        for start in starts(before.clone()) {
            best = better(best, space.lay(&self.grid, surface, face, &start));
            if is_sure(&best) {
                break;
            }
        }
        if !is_sure(&best) {
            let newest = before.next().and_then(|laid| laid.as_ref());
            let near = newest.map(|laid| laid.rotation);
            best = better(best, self.lost(space, surface, blurred(), face, near));
        }
        best.filter(|b| b.agreement >= AGREES)
    }

    /// Where a face lies of which nothing is known, or a neighbor's rotation.
    fn lost(
        &self,
        space: &mut FitSpace,
        surface: &SurfaceMap,
        blurred: &Blurred,
        face: &Face,
        neighbor: Option<Rotation>,
    ) -> Option<Laid> {
        let mut best = None;
        let near = neighbor.as_ref().map(|r| (r, NEAR));
        for (near, least) in [(near, AGREES), (None, FOUND)] {
            if near.is_none() && least == AGREES {
                continue;
            }
            let found = self.search.find(blurred, face, near);
            for (rotation, _) in found.iter().take(LAID) {
                let laid = space.lay(&self.grid, surface, face, rotation);
                best = better(best, laid.filter(|l| l.agreement >= least));
            }
            if best.as_ref().is_some_and(|b: &Laid| b.agreement >= SURE) {
                break;
            }
        }
        best
    }

    fn surface(&self, faces: &[Option<Face>], laid: &[Option<Laid>]) -> SurfaceMap {
        SurfaceMap::of(&self.grid, &apart(faces, laid))
    }

    /// All frames on one surface, each from where it lay; lost ones from their neighbors, or anywhere.
    fn settle(
        &self,
        faces: &[Option<Face>],
        surface: &SurfaceMap,
        laid: &[Option<Laid>],
    ) -> Vec<Option<Laid>> {
        let blurred = self.search.blurred(&self.grid, surface);
        let numbers: Vec<usize> = (0..faces.len()).collect();
        concurrency::map(&numbers, |&k| {
            let face = faces[k].as_ref()?;
            let mut space = FitSpace::default();
            let own = laid[k].as_ref();
            let best = own.and_then(|l| space.lay(&self.grid, surface, face, &l.rotation));
            if best.as_ref().is_some_and(|b| b.agreement >= SURE) {
                return best;
            }
            let beside = [k.checked_sub(1), Some(k + 1)];
            let mut neighbors = beside.into_iter().flatten();
            let neighbor = neighbors.find_map(|j| Some(laid.get(j)?.as_ref()?.rotation));
            let found = self.lost(&mut space, surface, &blurred, face, neighbor);
            better(best, found).filter(|b| b.agreement >= AGREES)
        })
    }
}

/// The middle of the agreements so far, of the frames after the first.
fn middle(laid: &[Option<Laid>]) -> f64 {
    let mut all: Vec<f64> = laid.iter().skip(1).flatten().map(|l| l.agreement).collect();
    median(&mut all)
}

fn better(one: Option<Laid>, other: Option<Laid>) -> Option<Laid> {
    match (one, other) {
        (Some(a), Some(b)) => Some(if b.agreement > a.agreement { b } else { a }),
        (a, b) => a.or(b),
    }
}

/// Frames that are placed, so many as fit all at once.
fn asked(laid: &[Option<Laid>]) -> Vec<usize> {
    few(&numbers(laid), ASKED)
}

/// Where a frame may lie beside others, the nearest first: where their turn leads, and as the nearest one.
pub(crate) fn starts<'a>(
    mut beside: impl Iterator<Item = &'a Option<Laid>>,
) -> impl Iterator<Item = Rotation> {
    let mut next = || Some(beside.next()?.as_ref()?.rotation);
    let (one, two) = (next(), next());
    let ahead = one.zip(two).map(|(one, two)| one * two.inverse() * one);
    ahead.into_iter().chain(one)
}

fn poses(clip: &Clip<'_>, laid: &[Option<Laid>]) -> PaintedPoses {
    let pose = |k: usize| {
        let face = clip.faces[k].as_ref().ok_or(PaintedRejection::NoBall)?;
        let laid = laid[k].ok_or(PaintedRejection::Lost)?;
        let view = clip.view(k).ok_or(PaintedRejection::NoBall)?;
        Ok(PaintedPose::new(face, &laid, view))
    };
    (0..laid.len()).map(pose).collect()
}
