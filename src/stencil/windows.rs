//! Windows over the zones that a pattern keeps free of dots: a logo stays in view and can be aligned.
//!
//! A window is a round opening along the zone's axis, as wide as the zone where holes, rim, hinge and
//! tab leave space for it, else as wide as they allow. Where not even a small one fits, an arrow is
//! engraved that points to the zone's center ([`super::marks`]).

use crate::geometry::{Vec3, angle_between};
use crate::pattern::KeepOut;

use super::joint::Joint;
use super::{HalfName, StencilConfig};

/// Zones wider than this get a window of this half angle: what remains must carry the shell.
const MAX_HALF_ANGLE_DEG: f64 = 50.0;
/// A window narrower than this part of its zone, or than this radius, mm, is none.
const MIN_SHARE: f64 = 0.35;
const MIN_RADIUS_MM: f64 = 2.0;
/// Step in which smaller windows are tried, mm.
const STEP_MM: f64 = 0.1;
/// Distance of the points that stand for a window in the search of the numbers' places, mm.
const SPACING_MM: f64 = 0.8;

/// A round opening over a zone.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Window {
    /// The zone, as counted in [`crate::Pattern::keep_out`].
    pub zone: usize,
    /// Direction of its middle, stencil frame.
    pub axis: Vec3,
    /// The half that it opens.
    pub half: HalfName,
    /// Its radius, mm.
    pub radius_mm: f64,
    /// Radius of the zone on the ball, mm: the window's where there is space for it.
    pub zone_radius_mm: f64,
}

/// A zone that has no window.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ClosedZone {
    /// The zone, as counted in [`crate::Pattern::keep_out`].
    pub zone: usize,
    /// Direction of its middle, stencil frame.
    pub axis: Vec3,
    /// Radius of the zone on the ball, mm.
    pub zone_radius_mm: f64,
}

/// What windows keep clear of.
pub(super) struct Around<'a> {
    /// The dots, stencil frame.
    pub dots: &'a [Vec3],
    /// Points on the hinge, in a half's own frame.
    pub hinge: &'a [Vec3],
    /// Points on the tab, stencil frame.
    pub tab: &'a [Vec3],
}

/// Windows for `zones` (stencil frame), and the zones that get none.
pub(super) fn windows(
    zones: &[KeepOut],
    around: &Around<'_>,
    config: &StencilConfig,
    joint: &Joint,
) -> (Vec<Window>, Vec<ClosedZone>) {
    let (mut open, mut closed): (Vec<Window>, Vec<ClosedZone>) = (Vec::new(), Vec::new());
    for (zone, cone) in zones.iter().enumerate() {
        let half = if cone.axis.z > 0.0 {
            HalfName::A
        } else {
            HalfName::B
        };
        let angle = cone.half_angle_rad.min(MAX_HALF_ANGLE_DEG.to_radians());
        let wanted = config.inner_radius_mm() * angle.sin();
        let least = (MIN_SHARE * wanted).max(MIN_RADIUS_MM);
        let zone_radius_mm = 0.5 * config.ball_diameter_mm * cone.half_angle_rad.sin();
        let steps = ((wanted - least) / STEP_MM).floor().max(-1.0) as i64;
        let window = (0..=steps)
            .map(|k| Window {
                zone,
                axis: cone.axis,
                half,
                radius_mm: wanted - STEP_MM * k as f64,
                zone_radius_mm,
            })
            .find(|w| w.fits(around, &open, config, joint));
        match window {
            Some(window) => open.push(window),
            None => closed.push(ClosedZone {
                zone,
                axis: cone.axis,
                zone_radius_mm,
            }),
        }
    }
    (open, closed)
}

impl Window {
    /// Angle of its rim from its axis on the sphere of `radius`, radians.
    fn angle(&self, radius: f64) -> f64 {
        (self.radius_mm / radius).min(1.0).asin()
    }

    fn fits(
        &self,
        around: &Around<'_>,
        others: &[Self],
        config: &StencilConfig,
        joint: &Joint,
    ) -> bool {
        let own = self.half.own_frame(&self.axis);
        let lowest = joint.lip_mm + joint.ledge_gap_mm + config.min_web_mm;
        let spheres = [
            (config.inner_radius_mm(), 0.5 * config.hole_diameter_mm),
            (config.outer_radius_mm(), config.opening_radius_mm()),
        ];
        let above_rim = spheres.iter().all(|(radius, _)| {
            let height = (radius * radius - self.radius_mm.powi(2)).max(0.0).sqrt();
            height * own.z - self.radius_mm * (1.0 - own.z * own.z).max(0.0).sqrt() >= lowest
        });
        let off_holes = spheres.iter().all(|(radius, hole)| {
            let apart = self.angle(*radius) + (hole / radius).asin() + config.min_web_mm / radius;
            around
                .dots
                .iter()
                .all(|dot| angle_between(dot, &self.axis) >= apart)
        });
        let off_others = others.iter().all(|other| {
            let radius = config.inner_radius_mm();
            let apart = self.angle(radius) + other.angle(radius) + config.min_web_mm / radius;
            angle_between(&other.axis, &self.axis) >= apart
        });
        let clear = |axis: &Vec3, points: &[Vec3]| {
            points.iter().all(|p| {
                let height = p.dot(axis);
                height < 0.0 || (p - height * axis).norm() >= self.radius_mm + config.min_web_mm
            })
        };
        let tab: &[Vec3] = match self.half {
            HalfName::A => around.tab,
            HalfName::B => &[],
        };
        above_rim && off_holes && off_others && clear(&own, around.hinge) && clear(&own, tab)
    }

    /// Points on the outer sphere that the window takes, in the half's own frame.
    pub(super) fn points(&self, config: &StencilConfig) -> Vec<Vec3> {
        let outer = config.outer_radius_mm();
        let axis = self.half.own_frame(&self.axis);
        let [u, v] = crate::geometry::tangent_frame(&axis);
        let rings = (self.radius_mm / SPACING_MM).ceil() as usize;
        let mut points = vec![outer * axis];
        for ring in 1..=rings {
            let r = self.radius_mm * ring as f64 / rings as f64;
            let height = (outer * outer - r * r).max(0.0).sqrt();
            let around = super::shapes::circle((0.0, 0.0), r, 6 * ring);
            points.extend(around.iter().map(|(a, b)| height * axis + *a * u + *b * v));
        }
        points
    }
}
