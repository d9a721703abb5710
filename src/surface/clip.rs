//! The frames of a clip under one camera, and what their views share.

use nalgebra::{Vector2, Vector4};

use super::face::{Face, FaceMaker};
use super::frame::PaintedFrame;
use crate::concurrency;
use crate::geometry::Vec3;
use crate::vision::frame::config::CameraModel;
use crate::vision::optics::camera::{BallCircle, BallView, Camera};
use crate::vision::outline::steady::steady;

/// Steps of the differences by what the views share.
const STEP: f64 = 1e-4;
/// Standard deviations of what all outlines are off, over the radius: the center's u and v, and the radius. Blotches at a dark rim make
/// found outlines too small by up to 8 % in the middle of a clip (`bench painted --seed 35400002`).
const SHIFTS: [f64; 3] = [0.03, 0.03, 0.05];
/// Standard deviation of what is not to move.
pub(crate) const FIXED: f64 = 1e-6;
/// Outlines are shifted by no more, radii.
const MOST: f64 = 0.25;

/// Frames, their outlines and the camera.
#[derive(Debug)]
pub(crate) struct Clip<'a> {
    frames: &'a [PaintedFrame],
    /// The outlines, and the standard deviations of their centers, pixels.
    circles: Vec<Option<(BallCircle, f64)>>,
    camera: CameraModel,
    views: Views,
    /// What the frames show that were reached so far.
    pub faces: Vec<Option<Face>>,
}

/// What all views of a camera share.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Views {
    /// What all outlines are off, over the radius: u, v and radius.
    shift: [f64; 3],
    /// The camera's inverse distance, where it is not known.
    inverse_distance: Option<f64>,
}

impl Views {
    /// What is expected before any frame is seen.
    pub fn of(camera: &CameraModel) -> Self {
        Self {
            shift: [0.0; 3],
            inverse_distance: match camera {
                CameraModel::Known(_) => None,
                CameraModel::Unknown(expected) => Some(expected.inverse_distance),
            },
        }
    }
}

/// Something that all views share: how far it is from what was expected before any frame was seen, and the standard deviation of that.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SharedOffset {
    pub off: f64,
    pub sigma: f64,
}

impl<'a> Clip<'a> {
    /// Of a camera whose views share this, with no frame reached.
    pub fn new(frames: &'a [PaintedFrame], camera: &CameraModel, views: Views) -> Self {
        let circles: Vec<_> = frames.iter().map(PaintedFrame::circle).collect();
        Self {
            frames,
            circles: steady(&circles),
            camera: *camera,
            views,
            faces: Vec::new(),
        }
    }

    /// What all views share, as it is now.
    pub fn views(&self) -> Views {
        self.views
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Takes the faces of the frames up to this one, as far as they are not taken.
    pub fn reach(&mut self, frames: usize, maker: &FaceMaker) {
        let first = self.faces.len();
        self.faces
            .resize(frames.clamp(first, self.len().max(first)), None);
        let new: Vec<usize> = (first..self.faces.len()).collect();
        self.take(&new, maker);
    }

    /// Takes the faces of these frames.
    fn take(&mut self, frames: &[usize], maker: &FaceMaker) {
        let taken = concurrency::map(frames, |&k| self.face(k, maker));
        for (k, face) in frames.iter().zip(taken) {
            self.faces[*k] = face;
        }
    }

    /// What a frame shows of the ball.
    pub fn face(&self, k: usize, maker: &FaceMaker) -> Option<Face> {
        let (circle, sigma_px) = self.circles[k]?;
        maker.take(&self.frames[k], &self.view(k)?, sigma_px / circle.radius)
    }

    /// The outline of a frame, steadied by those of the others.
    pub fn circle(&self, k: usize) -> Option<BallCircle> {
        self.circles[k].map(|(circle, _)| circle)
    }

    /// The ball in a frame, where its outline was found.
    pub fn view(&self, k: usize) -> Option<BallView> {
        self.seen(k, &self.views)
    }

    fn seen(&self, k: usize, views: &Views) -> Option<BallView> {
        let Views {
            shift,
            inverse_distance,
        } = views;
        let near = |inverse_distance| Camera::Near { inverse_distance };
        let camera = inverse_distance.map_or_else(|| self.camera.at(None), near);
        let (mut circle, _) = self.circles[k]?;
        circle.center.u += shift[0] * circle.radius;
        circle.center.v += shift[1] * circle.radius;
        circle.radius *= 1.0 + shift[2];
        BallView::new(&camera, circle).ok()
    }

    /// What all views share: the shift of the outlines over their radii (u, v, radius), and the camera's inverse distance.
    pub fn shared(&self) -> [SharedOffset; 4] {
        let shift = |j: usize| SharedOffset {
            off: self.views.shift[j],
            sigma: SHIFTS[j],
        };
        let distance = match (self.views.inverse_distance, &self.camera) {
            (Some(now), CameraModel::Unknown(expected)) => SharedOffset {
                off: now - expected.inverse_distance,
                sigma: expected.sigma,
            },
            _ => SharedOffset {
                off: 0.0,
                sigma: FIXED,
            },
        };
        [shift(0), shift(1), shift(2), distance]
    }

    /// Moves what all views share, and takes the faces of the frames `asked` anew; [`Clip::catch_up`] takes those of the others.
    pub fn correct(&mut self, step: &Vector4<f64>, asked: &[usize], maker: &FaceMaker) {
        for (shift, step) in self.views.shift.iter_mut().zip(step.iter()) {
            *shift = (*shift + step).clamp(-MOST, MOST);
        }
        self.views.inverse_distance = self.farther(step[3]);
        self.take(asked, maker);
    }

    /// Takes the faces of all frames but those `asked`, which are in order, as the views are now.
    pub fn catch_up(&mut self, asked: &[usize], maker: &FaceMaker) {
        let others = (0..self.faces.len()).filter(|k| asked.binary_search(k).is_err());
        let others: Vec<usize> = others.collect();
        self.take(&others, maker);
    }

    fn farther(&self, step: f64) -> Option<f64> {
        let moved = |now: f64| (now + step).clamp(0.0, CameraModel::MAX_INVERSE_DISTANCE);
        self.views.inverse_distance.map(moved)
    }

    /// How the views of a frame differ by a step of each shared unknown.
    pub fn moved(&self, k: usize) -> Option<Moved> {
        let shifted = |j: usize| {
            let mut views = self.views;
            views.shift[j] += STEP;
            self.seen(k, &views)
        };
        let farther = Views {
            inverse_distance: self.farther(STEP),
            ..self.views
        };
        let farther = self.seen(k, &farther);
        Some(Moved {
            own: self.view(k)?,
            others: [shifted(0)?, shifted(1)?, shifted(2)?, farther?],
        })
    }
}

/// How directions move with what all views share.
pub(crate) struct Moved {
    own: BallView,
    others: [BallView; 4],
}

impl Moved {
    /// By how much a direction of the view frame is read elsewhere, over each shared unknown; `None` at the limb.
    pub fn by(&self, direction: &Vec3) -> Option<[Vec3; 4]> {
        let at = self.own.project(direction);
        let by_pixel = self.own.by_pixel(direction)?;
        let by = |other: &BallView| {
            let moved = other.project(direction);
            by_pixel * (Vector2::new(moved.u - at.u, moved.v - at.v) / STEP)
        };
        Some(self.others.each_ref().map(by))
    }
}
