//! What the estimator expects of images.

use super::estimate::FrameEstimate;
use crate::error::{Error, Result, require};
use crate::recognize::MIN_CONFIDENCE_IMAGES;
use crate::recognize::robust::RobustConfig;
use crate::view::{Detection, FalseDots, ViewModel};
use crate::vision::dots::detector::LIKELY_DOT;
use crate::vision::optics::camera::{BallView, Camera};
use crate::vision::outline::circle::CircleConfig;
use crate::vision::pose::trust::TrustMap;

/// Standard deviation of a distance that was measured, over the distance.
const MEASURED: f64 = 0.03;
/// And at least: no picture shows less.
const LEAST_SIGMA: f64 = 1e-4;

/// How far the camera is: what is known before the dots are seen, or estimated from them.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CameraDistance {
    /// Expected value of the ball radii over the distance from the camera to the ball's center.
    pub inverse_distance: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

impl Default for CameraDistance {
    /// Cameras from some 6 ball radii to infinity.
    fn default() -> Self {
        Self {
            inverse_distance: 0.07,
            sigma: 0.05,
        }
    }
}

/// What is known of the camera.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum CameraModel {
    /// Neither its intrinsics nor its distance: the distance is estimated with the orientation.
    Unknown(CameraDistance),
    /// All that is needed.
    Known(Camera),
}

impl CameraModel {
    /// The largest inverse distance that an estimate may have: the ball fills 35 degrees of the view.
    pub(crate) const MAX_INVERSE_DISTANCE: f64 = 0.3;

    /// A camera that is so many ball radii away from the ball's center, measured to some 3 %, and whose axis is not known;
    /// parallel rays for infinity.
    ///
    /// # Errors
    /// [`Error::Argument`] for a distance of less than 10/3 radii, where the ball would fill more than 35 degrees of the view.
    pub fn at_distance(radii: f64) -> Result<Self> {
        if radii == f64::INFINITY {
            return Ok(Self::Known(Camera::Orthographic));
        }
        let inverse_distance = 1.0 / radii;
        let inside = inverse_distance > 0.0 && inverse_distance <= Self::MAX_INVERSE_DISTANCE;
        let domain = "more than 3.3 ball radii";
        require(inside, "camera_distance_radii", domain, radii)?;
        Ok(Self::Unknown(CameraDistance {
            inverse_distance,
            sigma: (MEASURED * inverse_distance).max(LEAST_SIGMA),
        }))
    }

    /// Whether orientations are in the view frame, since the intrinsics are unknown.
    pub fn is_view(&self) -> bool {
        !matches!(self, Self::Known(Camera::Perspective(_)))
    }

    /// The camera under which a ball is seen: at the distance that was estimated with its pose, else as it is known or
    /// expected.
    pub(crate) fn at(&self, estimated: Option<CameraDistance>) -> Camera {
        match (estimated, *self) {
            (None, Self::Known(camera)) => camera,
            (Some(distance), _) | (None, Self::Unknown(distance)) => Camera::Near {
                inverse_distance: distance.inverse_distance,
            },
        }
    }

    /// The camera of a match that was made at a distance: that one, unless the camera is known.
    pub(crate) fn at_inverse_distance(&self, inverse_distance: f64) -> Camera {
        match *self {
            Self::Known(camera) => camera,
            Self::Unknown(_) => Camera::Near { inverse_distance },
        }
    }

    /// The view of a frame's ball; `None` where it has no outline in the camera's domain.
    pub(crate) fn view_of(&self, frame: &FrameEstimate) -> Option<BallView> {
        let estimated = frame.pose().and_then(|pose| pose.distance);
        BallView::new(&self.at(estimated), frame.circle?).ok()
    }

    /// The cameras under which dots are identified, the likeliest first.
    pub(crate) fn hypotheses(&self) -> [Option<Camera>; 3] {
        match *self {
            Self::Known(camera) => [Some(camera), None, None],
            Self::Unknown(CameraDistance {
                inverse_distance,
                sigma,
            }) => {
                let near = |steps: f64| {
                    let at = inverse_distance + steps * sigma;
                    let inverse_distance = at.clamp(0.0, Self::MAX_INVERSE_DISTANCE);
                    Some(Camera::Near { inverse_distance })
                };
                // A hypothesis serves some 0.03 to either side.
                match sigma > 0.02 {
                    true => [near(0.0), near(1.2), near(-1.1)],
                    false => [near(0.0), None, None],
                }
            }
        }
    }
}

impl Default for CameraModel {
    fn default() -> Self {
        Self::Unknown(CameraDistance::default())
    }
}

impl From<Camera> for CameraModel {
    fn from(camera: Camera) -> Self {
        Self::Known(camera)
    }
}

/// How the ball's outline is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OutlineMethod {
    /// By its edges alone.
    Edges,
    /// By its edges where they show it whole, else with a net.
    #[default]
    Net,
}

impl OutlineMethod {
    /// All methods.
    pub const ALL: [Self; 2] = [Self::Edges, Self::Net];

    /// The name on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Edges => "edges",
            Self::Net => "net",
        }
    }
}

impl std::fmt::Display for OutlineMethod {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

impl std::str::FromStr for OutlineMethod {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "outline", name)
    }
}

/// Settings of the estimator.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct EstimatorConfig {
    /// What is known of the camera.
    pub camera: CameraModel,
    /// What is accepted as a ball.
    pub circle: CircleConfig,
    /// How the outline is found.
    pub outline: OutlineMethod,
    /// What the recognizer expects of the dots that are likely enough.
    pub recognizer: RobustConfig,
    /// Standard deviation of a drawn dot's place from the pattern's, along one tangent axis, radians.
    pub placement_sigma_rad: f64,
    /// Minimum probability of the detections that are used first, and where these leave doubt.
    pub dot_probability: [f64; 2],
    /// False dots expected beyond the recognizer's where doubtful detections are used.
    pub doubtful_false_dots: f64,
    /// From the recognizer's probability of a pose to the one that is reported; poses found with a
    /// hint keep the recognizer's.
    pub trust: TrustMap,
    /// Minimum probability of a pose that is accepted.
    pub min_confidence: f64,
    /// Radius of the ball, m: with the camera's intrinsics it says where the ball is. By default that of the ball's table.
    #[serde(default)]
    pub ball_radius_m: Option<f64>,
    /// Width of the outline's edge, in radii, from which on a refusal is put down to blur.
    pub max_blur: f64,
    /// Whether it is measured how the named dots are blurred: [`FrameEstimate::blurs`](super::estimate::FrameEstimate::blurs).
    #[serde(default)]
    pub measures_blur: bool,
}

impl Default for EstimatorConfig {
    /// A camera at an unknown distance; dots from z = 0.2, 85 % of them detected, one false dot a frame (a logo); drawn to
    /// 1.2 deg; detections likelier dots than not, then those down to 0.15, with 1.5 false dots more; poses from
    /// [`MIN_CONFIDENCE_IMAGES`] on.
    fn default() -> Self {
        Self {
            camera: CameraModel::default(),
            circle: CircleConfig::default(),
            outline: OutlineMethod::default(),
            recognizer: RobustConfig {
                view: ViewModel {
                    visibility_limit: 0.2,
                    detection: Detection::Each { probability: 0.85 },
                    false_dots: FalseDots::Poisson(1.0),
                    false_dot_limit: 0.2,
                    ..ViewModel::default()
                },
                // With 64, frames without an answer take a third longer, and no more are answered.
                passes: 10,
                // A near-symmetric pattern fits its mirror image with any confidence.
                mirror_doubt: 1.0,
                ..RobustConfig::default()
            },
            placement_sigma_rad: 1.2f64.to_radians(),
            dot_probability: [LIKELY_DOT, 0.15],
            doubtful_false_dots: 1.5,
            trust: TrustMap::default(),
            min_confidence: MIN_CONFIDENCE_IMAGES,
            ball_radius_m: None,
            max_blur: 0.6,
            measures_blur: false,
        }
    }
}

impl EstimatorConfig {
    /// Checks the domains of all settings.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the setting.
    pub fn check(&self) -> Result<()> {
        self.recognizer.check()?;
        if let CameraModel::Unknown(prior) = self.camera {
            let inside =
                (0.0..=CameraModel::MAX_INVERSE_DISTANCE).contains(&prior.inverse_distance);
            require(
                inside,
                "inverse_distance",
                "0 to 0.3",
                prior.inverse_distance,
            )?;
            let positive = prior.sigma > 0.0 && prior.sigma.is_finite();
            require(
                positive,
                "inverse_distance_sigma",
                "a positive number",
                prior.sigma,
            )?;
        }
        let fail =
            |name: &'static str, what: &str| Err(Error::argument(name, format!("expected {what}")));
        let is_probability = |p: f64| (0.0..=1.0).contains(&p);
        if !(self.placement_sigma_rad > 0.0 && self.placement_sigma_rad < 0.5) {
            return fail("placement_sigma_rad", "a positive angle below 0.5 rad");
        }
        if !self.dot_probability.into_iter().all(is_probability) {
            return fail("dot_probability", "probabilities");
        }
        if !is_probability(self.min_confidence) {
            return fail("min_confidence", "a probability");
        }
        if let Some(radius_m) = self.ball_radius_m {
            let inside = (0.5e-3..=0.5).contains(&radius_m);
            require(inside, "ball_radius_m", "0.0005 to 0.5 m", radius_m)?;
        }
        if !(self.doubtful_false_dots >= 0.0 && self.doubtful_false_dots.is_finite()) {
            return fail("doubtful_false_dots", "a number of dots");
        }
        Ok(())
    }
}
