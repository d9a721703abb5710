//! From an image to the ball's orientation, and from a sequence of images to all of them.
//!
//! A frame's way, for first, tracked, hinted and neighboring frames alike ([`Estimator::estimate`]):
//!
//! ```text
//! Prior: region, outline +- sigma, rotation          Budget: runs, deadline, depth of the search
//!        |                                                  |
//!        +------------------------+-------------------------+
//!                                 |
//! places    a plan (propose.rs): the outline that is believed | near the expected one, then farther around | the region
//!           of large regions first rough circles at a coarse scale: what stands out, what that outshone, without thin things,
//!           closer about the most promising; of larger ones smaller balls; last all edges, of those at a smaller scale
//!                                 |   one after the other, until one gives the answer or the budget ends
//! outlines  at a place (locate.rs): edges and net together, the edges' own where the net contradicts them, a circle
//!           for an ellipse; the one that dots without a pose ask for (align.rs); without a pose all other circles of the edges
//!                                 |   one after the other, until the dots are clear
//! dots      off the axis of a known camera: the view straight at the ball
//!           Patch -> DotDetector -> BallView: directions and covariances
//!                                 |   of a doubtful outline: five likely dots, or the next outline
//! names     likely dots under the camera's distances, the likeliest first, once with the mirrored view
//!           no clear pose: the detector's second look, likely and doubtful dots;
//!           none by these: the pattern matched with all places where dots may be
//!           a rotation expected, and none or another found: the dots weighed with it
//!                                 |
//! pose      probability by all evidence (TrustMap); refined on the dots in the image,
//!           which decide to which side of an unknown camera's axis an ellipse lies
//!                                 |   the answer: any pose of a likely outline, one that the dots make evident of another
//! pixels    each named dot as a cap in the image itself, and the pose refined on these
//! ```
//!
//! [`circle`](super::outline::circle) finds outlines, [`Patch`] cuts the ball out, a [`DotDetector`] finds dots, [`BallView`] lays them
//! on the sphere; their covariance is the detector's and that of the hand that drew them. The refinement fits the orientation
//! to the dots in the image, and takes up those that only now have a name.
//!
//! # What is promised
//! A frame is answered where the pose's probability is at least [`EstimatorConfig::min_confidence`], else
//! it has a [`FrameRejection`](crate::vision::FrameRejection): nothing is guessed. The same image gives the same answer whatever was seen before, but for the
//! hint that one may give. After the first frames of a size, the estimator allocates nothing.
//!
//! Orientations map the pattern's frame to the camera's (x right, y up, z towards the camera).

pub(crate) mod propose;
pub(crate) mod search;

use std::sync::OnceLock;

use nalgebra::Matrix3;

use super::dots::cap::CapFitter;
use super::dots::detector::{DetectorWorkspace, DotDetection, DotDetector};
use super::dots::heat::Heat;
use super::dots::patch::Patch;
use super::frame::config::{CameraModel, EstimatorConfig};
use super::frame::estimate::{EXPECTED_DOTS, FrameEstimate};
use super::frame::prior::Spending;
use super::optics::camera::{BallCircle, BallView, Camera, Intrinsics, Pixel};
use super::optics::crop::Images;
use super::outline::circle::coarse::CoarseSearch;
use super::outline::locate::Locator;
use super::outline::net::OutlineNet;
use super::outline::recenter::{Recentered, Recentering};
use super::outline::rim::RimFitter;
use super::pose::pixels::{PixelsMatcher, PlacedDot};
use super::pose::places::PosedOutline;
use super::pose::refine::{DrawnPlacement, Match, PoseRefiner};
use super::pose::rotations::{RotationMatch, RotationSearch, SearchWorkspace};
use crate::ball::Ball;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::pattern::Pattern;
use crate::recognize::Recognizer;
use crate::recognize::robust::{RobustConfig, RobustRecognizer, RobustWorkspace};
use crate::view::{FalseDots, ObservedDot, ViewModel};
use propose::Places;

/// The estimator: a pattern, a camera, a detector and the settings of everything between.
#[derive(Debug, Clone)]
pub struct Estimator {
    pub(crate) ball: Ball,
    pub(crate) detector: DotDetector,
    /// For the likely detections, and for all.
    pub(crate) recognizers: [RobustRecognizer; 2],
    pub(crate) refiner: PoseRefiner,
    /// Made when a frame first asks for it.
    pub(crate) rotation_search: OnceLock<RotationSearch>,
    /// Where the method uses it.
    pub(crate) outline_net: Option<OutlineNet>,
    /// Variance per tangent axis of the drawn dots' places that every observed dot is given, rad^2.
    pub(crate) placement_variance: f64,
    pub(crate) ball_radius_m: f64,
    pub(crate) config: EstimatorConfig,
}

/// Working memory of an [`Estimator`], one a thread.
#[derive(Debug)]
pub struct EstimatorWorkspace {
    pub(crate) images: Images,
    pub(crate) places: Places,
    /// At a coarse scale; the second for smaller balls.
    pub(crate) searches: [CoarseSearch; 2],
    /// The estimate at a place.
    pub(crate) there: FrameEstimate,
    /// That for an outline there.
    pub(crate) within: FrameEstimate,
    pub(crate) spending: Spending,
    pub(crate) locator: Locator,
    /// Only where the camera's intrinsics are known.
    pub(crate) recentering: Recentering,
    /// How the ball of the last patch was recentered.
    pub(crate) recentered: Option<Recentered>,
    pub(crate) patch: Patch,
    /// Outlines of other balls over that in hand, pixels of the frame, and whether they add light rather than hide it.
    pub(crate) covers: Vec<BallCircle>,
    pub(crate) covers_add: bool,
    pub(crate) detector: DetectorWorkspace,
    pub(crate) recognizer: RobustWorkspace,
    pub(crate) search: SearchWorkspace,
    pub(crate) heat: Heat,
    pub(crate) aligned: Vec<RotationMatch<PosedOutline>>,
    pub(crate) by_pixels: PixelsMatcher,
    pub(crate) placed: Vec<PlacedDot>,
    /// The dots handed to the recognizer, and their detections.
    pub(crate) observed: Vec<ObservedDot>,
    pub(crate) indices: Vec<usize>,
    pub(crate) matches: Vec<Match>,
    pub(crate) caps: CapFitter,
    pub(crate) rim: RimFitter,
    /// The dots of a frame, before those of a pose by its pixels take their place.
    pub(crate) detected: Vec<DotDetection>,
}

/// Standard deviation per tangent axis of what a measured dot's middle does beyond its covariance, radians:
/// ink and light change from view to view.
const MEASURED_DOT: f64 = 0.004;

/// Covariances of measured dots as an image shows them, rad^2, pattern frame.
fn measured_dots(dots: &[Vec3], covariances: &[Matrix3<f64>]) -> Vec<Matrix3<f64>> {
    let dots = dots.iter().zip(covariances);
    dots.map(|(dot, covariance)| {
        let tangent = Matrix3::identity() - dot * dot.transpose();
        covariance + tangent * MEASURED_DOT.powi(2)
    })
    .collect()
}

impl Estimator {
    /// An estimator for balls with this pattern.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a setting outside its domain.
    pub fn new(
        pattern: &Pattern,
        config: EstimatorConfig,
        detector: impl Into<DotDetector>,
    ) -> Result<Self> {
        Self::for_ball(&Ball::new(pattern.clone()), config, detector)
    }

    /// An estimator for a ball. Where its dots were measured, their own covariances take the place
    /// of [`EstimatorConfig::placement_sigma_rad`].
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a setting outside its domain.
    pub fn for_ball(
        ball: &Ball,
        config: EstimatorConfig,
        detector: impl Into<DotDetector>,
    ) -> Result<Self> {
        Self::with_net(ball, config, detector.into(), config.outline.net()?)
    }

    /// As [`Estimator::for_ball`], with the net for outlines at hand: another ball does not read it
    /// anew.
    pub(crate) fn with_net(
        ball: &Ball,
        config: EstimatorConfig,
        detector: DotDetector,
        outline_net: Option<OutlineNet>,
    ) -> Result<Self> {
        config.check()?;
        let likely = config.recognizer.view;
        let view = ViewModel {
            false_dots: FalseDots::Poisson(likely.false_dots.mean() + config.doubtful_false_dots),
            ..likely
        };
        let doubtful = RobustConfig {
            view,
            ..config.recognizer
        };
        let ball_mm = ball.sizes_mm(None, None)[0];
        let ball_radius_m = config.ball_radius_m.unwrap_or(0.5e-3 * ball_mm);
        let refiner = PoseRefiner::new(&config, ball_radius_m);
        let (refiner, placement_variance) = match (ball.dot_covariances(), ball.placement()) {
            (Some(covariances), Some(placement)) => {
                let measured = measured_dots(ball.pattern().dots(), covariances);
                (
                    refiner.with_placement(DrawnPlacement::Measured(measured)),
                    placement.common_rad2 + MEASURED_DOT.powi(2),
                )
            }
            _ => (refiner, config.placement_sigma_rad.powi(2)),
        };
        Ok(Self {
            ball: ball.clone(),
            detector,
            recognizers: [
                RobustRecognizer::for_ball(ball, config.recognizer)?,
                RobustRecognizer::for_ball(ball, doubtful)?,
            ],
            refiner,
            rotation_search: OnceLock::new(),
            outline_net,
            placement_variance,
            ball_radius_m,
            config,
        })
    }

    /// The same estimator for another pattern.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a setting outside its domain.
    pub fn for_pattern(&self, pattern: &Pattern) -> Result<Self> {
        let (detector, net) = (self.detector.clone(), self.outline_net.clone());
        // A pattern alone does not say how large its ball is.
        let config = EstimatorConfig {
            ball_radius_m: Some(self.ball_radius_m),
            ..self.config
        };
        Self::with_net(&Ball::new(pattern.clone()), config, detector, net)
    }

    /// The settings in use.
    pub fn config(&self) -> &EstimatorConfig {
        &self.config
    }

    /// Radius of the ball, m: as it is set, or else that of the table.
    pub fn ball_radius_m(&self) -> f64 {
        self.ball_radius_m
    }

    /// The ball to find.
    pub fn ball(&self) -> &Ball {
        &self.ball
    }

    /// The pattern to identify.
    pub fn pattern(&self) -> &Pattern {
        self.ball.pattern()
    }

    /// A new workspace.
    pub fn workspace(&self) -> EstimatorWorkspace {
        EstimatorWorkspace {
            images: Images::default(),
            places: Places::default(),
            searches: Default::default(),
            there: FrameEstimate::with_capacity(),
            within: FrameEstimate::with_capacity(),
            spending: Spending::default(),
            locator: Locator::new(self.config.circle),
            recentering: Recentering::new(self.config.circle),
            recentered: None,
            patch: Patch::default(),
            covers: Vec::new(),
            covers_add: false,
            detector: self.detector.workspace(),
            recognizer: self.recognizers[0].workspace(),
            search: SearchWorkspace::default(),
            heat: Heat::default(),
            aligned: Vec::new(),
            by_pixels: PixelsMatcher::default(),
            placed: Vec::with_capacity(EXPECTED_DOTS),
            observed: Vec::with_capacity(EXPECTED_DOTS),
            indices: Vec::with_capacity(EXPECTED_DOTS),
            matches: Vec::with_capacity(EXPECTED_DOTS),
            caps: CapFitter::default(),
            rim: RimFitter::default(),
            detected: Vec::with_capacity(EXPECTED_DOTS),
        }
    }

    /// The camera's intrinsics, where they are known.
    pub(crate) fn intrinsics(&self) -> Option<Intrinsics> {
        match self.config.camera {
            CameraModel::Known(Camera::Perspective(intrinsics)) => Some(intrinsics),
            _ => None,
        }
    }

    /// A ball's outline in a frame as the image shows it.
    pub(crate) fn shown_circle(&self, circle: &BallCircle) -> BallCircle {
        match self.intrinsics() {
            Some(k) => k.shown_of_ball(circle),
            None => *circle,
        }
    }

    /// The view of a frame's ball.
    pub(crate) fn view(&self, frame: &FrameEstimate) -> Option<BallView> {
        self.config.camera.view_of(frame)
    }

    /// Where the pattern's visible dots are expected in a frame with a pose: number, pixel and z.
    pub fn expected_dots(&self, frame: &FrameEstimate) -> Vec<(u16, Pixel, f64)> {
        let (Some(pose), Some(view)) = (frame.pose(), self.view(frame)) else {
            return Vec::new();
        };
        let to_view = view.to_camera().inverse() * pose.rotation;
        let dots = self.ball.pattern().dots().iter().enumerate();
        dots.map(|(j, dot)| (j as u16, to_view * dot))
            .filter(|(_, q)| q.z > view.horizon())
            .map(|(j, q)| (j, view.project(&q), q.z))
            .collect()
    }

    /// What is known of the camera.
    pub fn camera(&self) -> &CameraModel {
        &self.config.camera
    }
}
