//! Do the ball's outlines contradict the camera's intrinsics?
//!
//! Off the optical axis a ball's outline is drawn out, in inverse proportion to the square of the focal length ([`Oval`]). With the focal
//! lengths `g` times as long as the intrinsics have them, `s_i(g)` is the stretch that they give the outline of frame `i` where it is seen.
//! What the rim shows beyond `s_i(1)` is
//!
//! ```text
//! x_i = s_i(g) - s_i(1) + o + r_i m + e_i
//! ```
//!
//! with `o` what light and lens draw out all outlines alike, `m` what a rolling shutter does to a ball that moves, and `e_i` of Student's
//! distribution, so that a frame with a hand at the ball counts little. The intrinsics are contradicted where every `g` near 1 is less
//! likely than the best one by [`CLEAR`].
//!
//! Guarantees: silence where the outlines cannot say, as those of a ball on the axis. Not guaranteed: that wrong intrinsics are found;
//! a wrong principal point shows in [`Intrinsics::size_doubt`] alone.

use nalgebra::{Matrix2, Matrix2x4, Vector2, Vector4};

use super::batch::Batch;
use super::work::Work;
use crate::fit::{Normal, Student};
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::FrameEstimate;
use crate::vision::optics::camera::{BallCircle, BallView, Camera};
use crate::vision::optics::intrinsics::Intrinsics;
use crate::vision::optics::oval::{Oval, stretch_px};

/// Focal lengths that are tried, over those given: up to so many times as long or as short, in steps of this part.
const FARTHEST: f64 = 5.0;
const STEP: f64 = 0.1;
/// Those up to so many times as long or as short are not far off.
const NEAR: f64 = 1.25;
/// ln of the odds by which none of these may fit. By the right intrinsics nothing whatever fits 29 rendered clips better than them by more
/// than 6.1 (`bench focal`, docs/measurements/intrinsics.md).
const CLEAR: f64 = 8.0;
/// That of the range that is given: 95 % of a normal distribution.
const WITHIN: f64 = 1.92;
/// Frames that have a say, spread over those that show an outline, and how many are as good as independent: light and motion of frames
/// near in time are alike.
const MAX_FRAMES: usize = 32;
const INDEPENDENT: f64 = 12.0;
/// Fewer say nothing.
const MIN_FRAMES: usize = 3;
/// Standard deviations of what draws outlines out beside the camera, pixels, over the radius where that is more: of all outlines
/// alike, and of each.
const SHARED: (f64, f64) = (0.1, 0.002);
const SINGLE: (f64, f64) = (0.05, 0.001);
/// Part of what a rolling shutter does that changes from frame to frame: most motions are even.
const UNEVEN: f64 = 0.1;
/// The loss of a frame's error.
const LOSS: Student = Student::new(4, 2);
/// Steps of the reweighted fit.
const STEPS: usize = 4;

/// Intrinsics that the ball's outlines contradict by far.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct FocalDoubt {
    /// The focal lengths that fit the outlines best, over those given.
    pub ratio: f64,
    /// The least and the greatest within 95 %.
    pub range: [f64; 2],
    /// Number of outlines.
    pub frames: usize,
}

impl std::fmt::Display for FocalDoubt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            ratio,
            range: [low, high],
            frames,
        } = self;
        write!(
            f,
            "the ball's outlines contradict the intrinsics: they fit focal lengths {ratio:.2} times these ({low:.2} to {high:.2}; {frames} frames); is K that of images of another size?"
        )
    }
}

/// A ball's outline in a frame.
#[derive(Debug, Clone, Copy)]
pub struct SeenOval {
    /// The outline as the intrinsics have it.
    pub circle: BallCircle,
    /// By how much it is drawn out beyond that.
    pub oval: Oval,
    /// By how much a rolling shutter may have drawn it out, over the radius: half the ball's way from the frame before over the picture's
    /// rows; 0 without one.
    pub rolling: f64,
}

impl SeenOval {
    /// That of an estimate, where it has one.
    pub fn of(frame: &FrameEstimate, rolling: f64) -> Option<Self> {
        let (circle, oval) = frame.oval?;
        Some(Self {
            circle,
            oval,
            rolling,
        })
    }

    /// By how much focal lengths so many times as long draw it out, pixels.
    fn expected_px(&self, k: &Intrinsics, ratio: f64) -> Option<Vector2<f64>> {
        let scaled = Intrinsics {
            fx: k.fx * ratio,
            fy: k.fy * ratio,
            skew: k.skew * ratio,
            ..*k
        };
        stretch_px(&BallView::new(&Camera::Perspective(scaled), self.circle).ok()?)
    }
}

/// What an outline shows, whatever the focal lengths.
struct OutlineShows {
    seen: SeenOval,
    /// By how much it is drawn out in all, pixels.
    stretch_px: Vector2<f64>,
    /// Inverse covariance of that, 1/px^2.
    inverse: Matrix2<f64>,
}

impl OutlineShows {
    fn new(k: &Intrinsics, seen: SeenOval) -> Option<Self> {
        let radius = seen.circle.radius;
        let single = floor(SINGLE, radius).hypot(UNEVEN * seen.rolling * radius);
        let covariance = seen.oval.covariance + Matrix2::from_diagonal_element(single * single);
        Some(Self {
            stretch_px: seen.oval.stretch_px + seen.expected_px(k, 1.0)?,
            inverse: covariance.try_inverse()?,
            seen,
        })
    }
}

/// A deviation at a radius: so many pixels, or the part of the radius where that is more.
fn floor((px, part): (f64, f64), radius: f64) -> f64 {
    (part * radius).max(px)
}

/// Whether outlines contradict the intrinsics by far.
pub fn focal_doubt(k: &Intrinsics, seen: &[SeenOval]) -> Option<FocalDoubt> {
    let stride = seen.len().div_ceil(MAX_FRAMES).max(1);
    let seen = seen.iter().step_by(stride);
    let seen: Vec<OutlineShows> = seen
        .map(|one| OutlineShows::new(k, *one))
        .collect::<Option<_>>()?;
    if seen.len() < MIN_FRAMES {
        return None;
    }
    let most = (FARTHEST.ln() / STEP).round() as i32;
    let tried = (-most..=most).map(|step| (STEP * f64::from(step)).exp());
    let tried: Vec<(f64, f64)> = tried
        .filter_map(|ratio| Some((ratio, unlikeliness(k, ratio, &seen)?)))
        .collect();
    let best = tried.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let near = tried.iter();
    let near = near.filter(|(ratio, _)| (1.0 / NEAR..=NEAR).contains(ratio));
    let least = near.map(|(_, worse)| *worse).min_by(f64::total_cmp)?;
    let is_far = least > best.1 + CLEAR;
    let fits = |(_, worse): &&(f64, f64)| *worse <= best.1 + WITHIN;
    let range = |of: fn(f64, f64) -> f64, start: f64| {
        let all = tried.iter().filter(fits).map(|(ratio, _)| *ratio);
        all.fold(start, of)
    };
    let range = [range(f64::min, f64::MAX), range(f64::max, 0.0)];
    is_far.then_some(FocalDoubt {
        ratio: best.0,
        range,
        frames: seen.len(),
    })
}

/// -ln of the likelihood of the outlines where the focal lengths are so many times as long; `None` where such a camera does not see them.
fn unlikeliness(k: &Intrinsics, ratio: f64, seen: &[OutlineShows]) -> Option<f64> {
    let mut errors = Vec::with_capacity(seen.len());
    for one in seen {
        let left = one.stretch_px - one.seen.expected_px(k, ratio)?;
        errors.push((left, one.inverse, one.seen.circle.radius));
    }
    let count = seen.len() as f64;
    let (radius, rolling) = seen.iter().fold((0.0, 0.0), |(r, m), one| {
        let SeenOval {
            circle, rolling, ..
        } = one.seen;
        (r + circle.radius / count, m + rolling / count)
    });
    let shared = floor(SHARED, radius).powi(-2);
    let rolled = rolling.max(1e-6).powi(-2);
    let prior = Vector4::new(shared, shared, rolled, rolled);
    let worth = (INDEPENDENT / count).min(1.0);
    let mut common = Vector4::zeros();
    let by = |radius: f64| {
        let (one, r) = (Matrix2::identity(), Matrix2::from_diagonal_element(radius));
        let mut by = Matrix2x4::zeros();
        by.fixed_columns_mut::<2>(0).copy_from(&one);
        by.fixed_columns_mut::<2>(2).copy_from(&r);
        by
    };
    let squared = |common: &Vector4<f64>, (left, inverse, radius): &(_, Matrix2<f64>, f64)| {
        let off: Vector2<f64> = left - by(*radius) * common;
        off.dot(&(inverse * off))
    };
    for _ in 0..STEPS {
        let mut normal = Normal::<4>::default();
        normal.information.set_diagonal(&prior);
        for error in &errors {
            let (left, inverse, radius) = error;
            let weight = worth * LOSS.weight(squared(&common, error));
            normal.add(&by(*radius), left, &(inverse * weight));
        }
        common = normal.step()?;
    }
    let frames: f64 = errors
        .iter()
        .map(|error| 0.5 * LOSS.cost(squared(&common, error)))
        .sum();
    let held = 0.5 * common.dot(&prior.component_mul(&common));
    let sum = worth * frames + held;
    sum.is_finite().then_some(sum)
}

/// Asks the outlines of a camera's frames, in every mode: frames go in one by one, in their order.
///
/// Memory and work a frame do not grow with their number: of a long stream the outlines that have a say are spread over all of it.
#[derive(Debug, Clone)]
pub struct CameraCheck {
    k: Intrinsics,
    /// Whether balls need a pose to be known.
    by_poses: bool,
    /// The balls of the frame before.
    before: Vec<BallCircle>,
    seen: Vec<SeenOval>,
    /// Every so many outlines one is kept.
    stride: usize,
    /// Outlines that there were.
    count: usize,
}

impl CameraCheck {
    /// For a camera, where its intrinsics are known.
    pub fn of_camera(camera: &CameraModel) -> Option<Self> {
        match camera {
            CameraModel::Known(Camera::Perspective(k)) => Some(Self::new(*k, true)),
            _ => None,
        }
    }

    fn new(k: Intrinsics, by_poses: bool) -> Self {
        Self {
            k,
            by_poses,
            before: Vec::new(),
            seen: Vec::with_capacity(2 * MAX_FRAMES),
            stride: 1,
            count: 0,
        }
    }

    /// Takes the next frame, by its picture's rows, and its balls; those without a pose have no say. It is taken for the next one
    /// of a clip: times say nothing of whether it is, and single images, far from each other, are then said to be drawn out by
    /// more.
    pub fn push<'a>(&mut self, rows: usize, balls: impl IntoIterator<Item = &'a FrameEstimate>) {
        let mut circles = Vec::new();
        let by_poses = self.by_poses;
        let known = balls
            .into_iter()
            .filter(|ball| !by_poses || ball.pose().is_some());
        for (ball, circle) in known.filter_map(|b| Some((b, b.circle?))) {
            circles.push(circle);
            let way = self
                .before
                .iter()
                .map(|b| (b.center.u - circle.center.u).hypot(b.center.v - circle.center.v))
                .fold(f64::INFINITY, f64::min);
            let rolling = match way.is_finite() {
                true => 0.5 * way / rows.max(1) as f64,
                false => 0.0,
            };
            if let Some(oval) = SeenOval::of(ball, rolling) {
                self.keep(oval);
            }
        }
        if !circles.is_empty() {
            self.before = circles;
        }
    }

    fn keep(&mut self, oval: SeenOval) {
        if self.count.is_multiple_of(self.stride) {
            if self.seen.len() == 2 * MAX_FRAMES {
                let mut at = 0;
                self.seen.retain(|_| {
                    at += 1;
                    at % 2 == 1
                });
                self.stride *= 2;
            }
            self.seen.push(oval);
        }
        self.count += 1;
    }

    /// What the outlines say, after all frames.
    pub fn doubt(&self) -> Option<FocalDoubt> {
        focal_doubt(&self.k, &self.seen)
    }
}

/// Asks a [`CameraCheck`] while its frames come in: as soon as it can say, and each time that there are half as many outlines more.
#[derive(Debug, Clone)]
pub struct LiveCheck {
    /// None without intrinsics, and once there is a doubt.
    check: Option<CameraCheck>,
    next: usize,
}

impl LiveCheck {
    /// For a camera; silent where its intrinsics are not known.
    pub fn new(camera: &CameraModel) -> Self {
        Self {
            check: CameraCheck::of_camera(camera),
            next: MIN_FRAMES,
        }
    }

    /// Takes the next frame; the doubt, once, as soon as there is one.
    pub fn push<'a>(
        &mut self,
        rows: usize,
        balls: impl IntoIterator<Item = &'a FrameEstimate>,
    ) -> Option<FocalDoubt> {
        let check = self.check.as_mut()?;
        check.push(rows, balls);
        if check.count < self.next {
            return None;
        }
        self.next = check.count + check.count.div_ceil(2);
        let doubt = check.doubt()?;
        self.check = None;
        Some(doubt)
    }

    /// The doubt at the end of a stream, or of a part of it, where there was none before.
    pub fn end(&mut self) -> Option<FocalDoubt> {
        let doubt = self.check.as_ref()?.doubt()?;
        self.check = None;
        Some(doubt)
    }
}

impl FocalDoubt {
    /// What the frames of a clip say of the camera of a work.
    pub(super) fn of_clip(work: &Work<'_>, batch: &Batch) -> Option<Self> {
        let mut check = match work {
            Work::Outlines(finder) => CameraCheck::new(finder.intrinsics()?, false),
            _ => CameraCheck::of_camera(work.tables().first()?.camera())?,
        };
        for frame in &batch.frames {
            let rows = frame.size.map_or(1, |[_, rows]| rows);
            check.push(rows, frame.balls.iter().map(|ball| &ball.frame));
        }
        check.doubt()
    }
}
