//! The page of an estimate: frames, orientations over time, the spin, rejected frames by reason.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use super::{PageData, rounded};
use crate::ball::Ball;
use crate::clip::{NamedFrame, SequenceOutcome};
use crate::design::KeepOut;
use crate::error::Result;
use crate::geometry::{CameraFrame, to_wxyz};
use crate::spin::SpinRejection;
use crate::spin::estimate::FittedMotion;
use crate::spin::free::Knot;
use crate::spin::golf;
use crate::spin::orientations::Orientations;
use crate::spin::robust::standard_deviations;
use crate::spin::summary::SpinSummary;
use crate::stats::quantile;
use crate::surface::{PaintedPose, PaintedPoses, PaintedRejection, SurfaceMap};
use crate::vision::frame::estimate::FrameRejection;

/// Bytes that the pictures of a page may take together: with all else it stays below 6 MB.
const MAX_PICTURES: usize = 5_000_000;
/// Shares of a chart's values that are darker than its darkest and its lightest shade.
const SHADES: [f64; 2] = [0.02, 0.98];
/// A golf ball measures 42.67 mm or a little more.
const GOLF_WITHIN_MM: f64 = 0.2;

/// What the page of an estimate shows: one ball, or several one after the other.
#[derive(Debug, Serialize)]
pub struct EstimatePage {
    balls: Vec<PageBall>,
}

/// What a ball carries.
#[derive(Debug, Clone, Copy)]
pub enum Carried<'a> {
    /// Dots.
    Dots(&'a Ball),
    /// Marks of any shape.
    Paint {
        /// What is known of them.
        surface: &'a SurfaceMap,
        /// The frames' poses on the surface.
        poses: &'a PaintedPoses,
    },
}

/// A ball that a page is to show.
#[derive(Debug, Clone)]
pub struct ShownBall<'a> {
    /// What it carries.
    pub carries: Carried<'a>,
    /// Its number, where there are several.
    pub number: Option<usize>,
    /// The frames that show it, or might.
    pub frames: Vec<NamedFrame<'a>>,
    /// The rows of these frames.
    pub orientations: Orientations,
    /// What was found of the spin and its motion, in the axes of [`CameraFrame::Camera`], where the frames have times.
    pub spin: Option<std::result::Result<(SpinSummary, FittedMotion), SpinRejection>>,
    /// What the frames are to each other.
    pub sequence: &'a SequenceOutcome,
}

/// A ball in the page. Orientations map the pattern's frame to the camera's, or to the view frame where the camera
/// is unknown (x right, y up, z from the ball towards the camera).
#[derive(Debug, Serialize)]
pub struct PageBall {
    number: Option<usize>,
    camera_frame: CameraFrame,
    dots: Vec<[f64; 3]>,
    /// The radius of a dot as an angle.
    dot_angle_rad: f64,
    /// Of a painted ball its surface.
    paint: Option<PagePaint>,
    /// Whether the ball is of golf's size, whose spins are said in turns a minute.
    is_golf: bool,
    keep_out: Vec<KeepOut>,
    frames: Vec<PageFrame>,
    spin: Option<PageSpin>,
    spin_rejection: Option<String>,
}

/// A painted ball's surface in the page, by latitude and longitude as a [`SurfaceChart`](crate::surface::SurfaceChart) has it.
#[derive(Debug, Serialize)]
struct PagePaint {
    columns: usize,
    rows: usize,
    /// Row by row, a byte each, as base64: 0 where nothing is known, else 1 for dark to 255 for light.
    values: String,
    /// Share of the ball that is known.
    known: f64,
}

impl PagePaint {
    fn new(surface: &SurfaceMap) -> Self {
        let chart = surface.chart();
        let [columns, rows] = chart.size();
        let mut known: Vec<f64> = chart
            .values()
            .iter()
            .flatten()
            .map(|v| f64::from(*v))
            .collect();
        known.sort_unstable_by(f64::total_cmp);
        let [dark, light] = match known.is_empty() {
            true => [0.0, 1.0],
            false => SHADES.map(|share| quantile(&known, share)),
        };
        let byte = |value: &Option<f32>| {
            let shade = value.map(|v| (f64::from(v) - dark) / (light - dark).max(1e-6));
            shade.map_or(0, |shade| {
                (1.0 + 254.0 * shade.clamp(0.0, 1.0)).round() as u8
            })
        };
        let bytes: Vec<u8> = chart.values().iter().map(byte).collect();
        Self {
            columns,
            rows,
            values: STANDARD.encode(bytes),
            known: rounded(surface.known()),
        }
    }
}

/// A frame in the page.
#[derive(Debug, Serialize)]
pub struct PageFrame {
    name: String,
    time_s: Option<f64>,
    orientation_wxyz: Option<[f64; 4]>,
    confidence: Option<f64>,
    residual_deg: Option<f64>,
    /// Of a painted ball the correlation with its surface.
    agreement: Option<f64>,
    dots: usize,
    matched: usize,
    rejection: Option<String>,
    rejection_kind: Option<&'static str>,
    /// The overlay as a data URI.
    picture: Option<String>,
}

/// The spin in the page.
#[derive(Debug, Serialize)]
pub struct PageSpin {
    spin_rad_s: [f64; 3],
    rps: f64,
    axis: [f64; 3],
    std_rad_s: Option<[f64; 3]>,
    std_rps: Option<f64>,
    sigma_deg: Option<f64>,
    inliers: usize,
    lack_of_fit: Option<f64>,
    time_s: f64,
    orientation_wxyz: [f64; 4],
    motion: &'static str,
    decay_per_s: f64,
    /// The rotation that is fixed in the ball at that time, pattern frame.
    body_rate_rad_s: [f64; 3],
    /// The spin over time, of a free motion; what is said of the spin is then the mean.
    over_time: Option<Vec<PageKnot>>,
    alternatives: Vec<PageAlternative>,
}

/// A free motion at a time.
#[derive(Debug, Serialize)]
struct PageKnot {
    time_s: f64,
    orientation_wxyz: [f64; 4],
    spin_rad_s: [f64; 3],
    rps: f64,
    std_rps: f64,
}

impl PageKnot {
    fn new(knot: &Knot) -> Self {
        let axis = knot.spin.try_normalize(0.0).unwrap_or_default();
        let rps = |rad_s: f64| rad_s / std::f64::consts::TAU;
        Self {
            time_s: knot.time_s,
            orientation_wxyz: to_wxyz(&knot.orientation),
            spin_rad_s: knot.spin.into(),
            rps: rps(knot.spin.norm()),
            std_rps: rps(axis.dot(&(knot.spin_covariance * axis)).max(0.0).sqrt()),
        }
    }
}

#[derive(Debug, Serialize)]
struct PageAlternative {
    rps: f64,
    axis: [f64; 3],
    log_likelihood_ratio: f64,
}

impl EstimatePage {
    /// The page of balls. `picture` gives a frame's overlay as a PNG file where there is one, by the ball's and the frame's place; where all
    /// together are too large, evenly chosen ones are shown.
    ///
    /// # Errors
    /// Those of `picture`.
    pub fn new(
        balls: &[ShownBall<'_>],
        mut picture: impl FnMut(usize, usize) -> Result<Option<Vec<u8>>>,
    ) -> Result<Self> {
        let bytes = MAX_PICTURES / balls.len().max(1);
        let balls = balls.iter().enumerate();
        let balls = balls.map(|(k, ball)| PageBall::new(ball, bytes, |at| picture(k, at)));
        Ok(Self {
            balls: balls.collect::<Result<_>>()?,
        })
    }

    /// The page as HTML.
    ///
    /// # Errors
    /// [`crate::Error::Internal`] where the data are no JSON.
    pub fn html(&self) -> Result<String> {
        let frames = || self.balls.iter().flat_map(|ball| &ball.frames);
        let posed = frames().filter(|f| f.orientation_wxyz.is_some()).count();
        let identified = format!("{posed} of {} frames identified", frames().count());
        let (title, subject) = match &self.balls[..] {
            [one] => (
                "Orientations and spin of a ball",
                match &one.paint {
                    None => format!("{} dots", one.dots.len()),
                    Some(paint) => format!("painted, {:.0} % of it shown", 100.0 * paint.known),
                },
            ),
            several => (
                "Orientations and spins of balls",
                format!("{} balls", several.len()),
            ),
        };
        PageData {
            kind: "estimate",
            title,
            subtitle: &format!(
                "{identified}, {subject}, spindoe {}",
                env!("CARGO_PKG_VERSION")
            ),
            content: self,
        }
        .html()
    }
}

impl PageBall {
    /// With pictures of so many bytes at most.
    fn new(
        shown: &ShownBall<'_>,
        bytes: usize,
        mut picture: impl FnMut(usize) -> Result<Option<Vec<u8>>>,
    ) -> Result<Self> {
        let axes = shown.orientations.camera_frame.unwrap_or_default();
        let rows = shown.frames.iter().zip(&shown.orientations.rows);
        let rows = rows.enumerate().map(|(k, (frame, row))| {
            let orientation = row.orientation.map(|q| axes.turn() * q);
            let outcome = match shown.carries {
                Carried::Dots(_) => PageFrame::by_dots(frame),
                Carried::Paint { poses, .. } => PageFrame::by_paint(frame, poses.get(k)),
            };
            PageFrame {
                orientation_wxyz: orientation.as_ref().map(to_wxyz),
                ..outcome
            }
        });
        let mut frames: Vec<PageFrame> = rows.collect();
        let mut left = bytes;
        for k in evenly(frames.len()) {
            let Some(png) = picture(k)? else {
                continue;
            };
            let text = format!("data:image/png;base64,{}", STANDARD.encode(&png));
            // In the order of ever finer steps: what fits is spread over the sequence.
            let Some(rest) = left.checked_sub(text.len()) else {
                break;
            };
            left = rest;
            frames[k].picture = Some(text);
        }
        let spin = shown.spin.as_ref();
        Ok(Self {
            frames,
            spin: spin
                .and_then(|spin| spin.as_ref().ok())
                .map(|(summary, motion)| PageSpin::new(summary, motion)),
            spin_rejection: match shown.sequence {
                SequenceOutcome::NoTimes => Some("the frames have no times".to_owned()),
                SequenceOutcome::TimesNotIncreasing => Some("the times do not increase".to_owned()),
                _ => spin
                    .and_then(|spin| spin.as_ref().err())
                    .map(ToString::to_string),
            },
            ..Self::empty(shown, CameraFrame::Camera.of_view(axes.is_view()))
        })
    }

    /// What it carries, before any frame.
    fn empty(shown: &ShownBall<'_>, camera_frame: CameraFrame) -> Self {
        let bare = Self {
            number: shown.number,
            camera_frame,
            dots: Vec::new(),
            dot_angle_rad: 0.0,
            paint: None,
            is_golf: false,
            keep_out: Vec::new(),
            frames: Vec::new(),
            spin: None,
            spin_rejection: None,
        };
        match shown.carries {
            Carried::Dots(ball) => {
                let pattern = ball.pattern();
                let [ball_mm, dot_mm] = ball.sizes_mm(None, None);
                Self {
                    dots: pattern.dots().iter().map(|d| (*d).into()).collect(),
                    dot_angle_rad: (dot_mm / ball_mm).min(1.0).asin(),
                    is_golf: (ball_mm - golf::BALL_MM).abs() < GOLF_WITHIN_MM,
                    keep_out: pattern.keep_out().to_vec(),
                    ..bare
                }
            }
            Carried::Paint { surface, .. } => Self {
                paint: Some(PagePaint::new(surface)),
                ..bare
            },
        }
    }
}

/// 0 to `n - 1`, each once: first the ends and the middle, then ever finer steps between.
fn evenly(n: usize) -> Vec<usize> {
    let mut order = Vec::with_capacity(n);
    let mut taken = vec![false; n];
    let mut step = n.max(1);
    loop {
        for k in (0..n).step_by(step) {
            if !std::mem::replace(&mut taken[k], true) {
                order.push(k);
            }
        }
        if step == 1 {
            return order;
        }
        step = step.div_ceil(2);
    }
}

impl PageFrame {
    /// What stands in every frame, without an outcome.
    fn named(shown: &NamedFrame<'_>) -> Self {
        Self {
            name: shown.name.to_owned(),
            time_s: shown.time_s,
            orientation_wxyz: None,
            confidence: None,
            residual_deg: None,
            agreement: None,
            dots: 0,
            matched: 0,
            rejection: None,
            rejection_kind: None,
            picture: None,
        }
    }

    fn by_dots(shown: &NamedFrame<'_>) -> Self {
        let frame = shown.estimate;
        let pose = frame.pose();
        let rejection = frame.outcome.as_ref().err();
        Self {
            confidence: pose.map(|p| rounded(p.confidence)),
            residual_deg: pose.map(|p| rounded(p.residual_rad.to_degrees())),
            dots: frame.dots.len(),
            matched: frame.matched(),
            rejection: rejection.map(ToString::to_string),
            rejection_kind: rejection.map(kind),
            ..Self::named(shown)
        }
    }

    /// Of a painted ball; without a pose it was not processed.
    fn by_paint(
        shown: &NamedFrame<'_>,
        pose: Option<&std::result::Result<PaintedPose, PaintedRejection>>,
    ) -> Self {
        let found = shown.estimate.outcome.as_ref().err();
        let (rejection, kind) = match (pose, found) {
            (Some(Ok(_)), _) => (None, None),
            (_, Some(FrameRejection::Unreadable)) | (None, _) => {
                let why = found.unwrap_or(&FrameRejection::NotProcessed);
                (Some(why.to_string()), Some(kind(why)))
            }
            (Some(Err(why)), _) => {
                let kind = match why {
                    PaintedRejection::NoBall => "no ball",
                    PaintedRejection::Lost => "not this paint",
                };
                (Some(why.to_string()), Some(kind))
            }
        };
        let pose = pose.and_then(|pose| pose.as_ref().ok());
        Self {
            agreement: pose.map(|p| rounded(p.agreement)),
            rejection,
            rejection_kind: kind,
            ..Self::named(shown)
        }
    }
}

/// A rejection in a few words.
fn kind(rejection: &FrameRejection) -> &'static str {
    match rejection {
        FrameRejection::NotProcessed => "not processed",
        FrameRejection::NoBall(_) => "no ball",
        FrameRejection::TooBlurred { .. } => "too blurred",
        FrameRejection::TooFewDots { .. } => "too few dots",
        FrameRejection::Ambiguous { .. } => "ambiguous",
        FrameRejection::OutOfTime => "no time left",
        FrameRejection::Recognizer(_) | FrameRejection::Foreign => "not the pattern",
        FrameRejection::CamerasDisagree { .. } | FrameRejection::CamerasContradict => {
            "cameras disagree"
        }
        FrameRejection::Unreadable => "cannot be read",
    }
}

impl PageSpin {
    fn new(summary: &SpinSummary, motion: &FittedMotion) -> Self {
        let fit = &summary.fit;
        let axis = |v: &crate::geometry::Vec3| v.try_normalize(0.0).unwrap_or_default();
        let own = axis(&fit.motion.spin);
        let rps = |rad_s: f64| rad_s / std::f64::consts::TAU;
        Self {
            spin_rad_s: fit.motion.spin.into(),
            rps: fit.motion.rps(),
            axis: own.into(),
            std_rad_s: fit
                .spin_covariance
                .as_ref()
                .map(|c| standard_deviations(c).into()),
            std_rps: fit
                .spin_covariance
                .map(|c| rps(own.dot(&(c * own)).max(0.0).sqrt())),
            sigma_deg: fit.sigma_rad.map(f64::to_degrees),
            inliers: fit.inliers,
            lack_of_fit: fit.lack_of_fit,
            motion: motion.model().as_str(),
            decay_per_s: motion.decay_per_s(),
            body_rate_rad_s: motion.body_rate(fit.motion.time_s).into(),
            over_time: match motion {
                FittedMotion::Free(free) => Some(free.knots.iter().map(PageKnot::new).collect()),
                _ => None,
            },
            time_s: fit.motion.time_s,
            orientation_wxyz: to_wxyz(&fit.motion.orientation),
            alternatives: summary
                .alternatives
                .iter()
                .map(|a| PageAlternative {
                    rps: rps(a.spin.norm()),
                    axis: axis(&a.spin).into(),
                    log_likelihood_ratio: a.log_likelihood_ratio,
                })
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::evenly;

    #[test]
    fn every_frame_has_its_turn() {
        for n in [0, 1, 2, 7, 64, 101] {
            let mut order = evenly(n);
            if n > 2 {
                assert!(order[1] >= n / 3, "the second is far from the first");
            }
            order.sort_unstable();
            assert!(order.into_iter().eq(0..n));
        }
    }
}
