//! A dot of a clip that is calibrated: one of the nominal pattern, or a mark.

use nalgebra::Matrix2;

use super::bundle::DotPrior;
use super::marks::FoundMark;
use super::presence::{DotPresence, FindRecord, Looks};
use super::result::{CalibratedDot, DotState};
use crate::geometry::{Vec3, angle_between};

/// Standard deviation per axis of what may be print beside a dot, radians: on rendered balls it is 1.2 deg.
pub(super) const PRINT_SIGMA_RAD: f64 = 0.021;

/// A dot of the fit: one of the nominal pattern, or a mark.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClipDot {
    /// What is known of its place before the clip.
    pub(super) prior: DotPrior,
    pub(super) direction: Vec3,
    pub(super) covariance: Matrix2<f64>,
    pub(super) views: usize,
    /// The detector's mean probability that this is a dot, over that of the ball's middle dot.
    pub(super) likeness: f64,
    /// Whether a frame of the last fit names it.
    pub(super) named: bool,
    pub(super) record: FindRecord,
    pub(super) presence: DotPresence,
    /// Where something lies that was taken for it and is not.
    pub(super) rejected: Option<Vec3>,
    /// As a mark: see [`SteadyMark`](super::result::SteadyMark).
    pub(super) mark: Option<FoundMark>,
}

impl ClipDot {
    /// One of the pattern, that is drawn near its place by this deviation.
    pub(super) fn of_pattern(direction: &Vec3, sigma_rad: f64) -> Self {
        Self {
            prior: DotPrior {
                direction: *direction,
                sigma_rad,
                designed: true,
            },
            direction: *direction,
            covariance: Matrix2::identity() * sigma_rad.powi(2),
            views: 0,
            likeness: 1.0,
            named: false,
            record: FindRecord::default(),
            presence: DotPresence::There,
            rejected: None,
            mark: None,
        }
    }

    /// A mark.
    pub(super) fn of_mark(mark: &FoundMark, sigma_rad: f64) -> Self {
        let mut dot = Self::of_pattern(&mark.direction, sigma_rad);
        dot.prior.designed = false;
        (dot.views, dot.mark) = (mark.found, Some(*mark));
        dot
    }

    /// Not left out.
    pub(super) fn is_active(&self) -> bool {
        self.presence != DotPresence::Missing
    }

    /// Angle from its nominal place, radians; 0 for a mark.
    pub(super) fn offset(&self) -> f64 {
        match self.mark {
            None => angle_between(&self.prior.direction, &self.direction),
            Some(_) => 0.0,
        }
    }

    /// Takes what the views say of it.
    pub(super) fn judge(&mut self, record: FindRecord, looks: &Looks) {
        self.record = record;
        self.presence = record.presence(looks);
        match self.presence {
            DotPresence::There => {}
            DotPresence::Doubtful => {
                self.covariance += Matrix2::identity() * PRINT_SIGMA_RAD.powi(2);
            }
            DotPresence::Hidden | DotPresence::Missing => {
                // What was taken for it lies elsewhere, or it is found too seldom: then a mark may be it.
                let is_other = looks.likeness < looks.limit || self.presence == DotPresence::Hidden;
                if self.views > 0 && is_other {
                    self.rejected = Some(self.direction);
                }
                self.direction = self.prior.direction;
                self.covariance = Matrix2::identity() * self.prior.sigma_rad.powi(2);
                self.views = 0;
            }
        }
    }

    /// As the calibration has it; what no view shows is as likely anywhere near its place as a dot before the clip, by this deviation.
    pub(super) fn calibrated(&self, unseen_sigma_rad: f64) -> CalibratedDot {
        let state = match self.presence {
            DotPresence::Missing => DotState::Missing,
            _ if self.views == 0 => DotState::Unseen,
            DotPresence::Doubtful => DotState::Doubtful,
            _ => DotState::Measured,
        };
        let is_seen = matches!(state, DotState::Measured | DotState::Doubtful);
        let (direction, covariance) = if is_seen {
            (self.direction, self.covariance)
        } else {
            let variance = unseen_sigma_rad.powi(2);
            (self.prior.direction, Matrix2::identity() * variance)
        };
        CalibratedDot {
            nominal: self.prior.direction,
            direction,
            covariance,
            views: if is_seen { self.views } else { 0 },
            facing_frames: self.record.views,
            facing_views: self.record.found,
            expected_views: self.record.expected,
            likeness: if is_seen { self.likeness } else { 1.0 },
            state,
        }
    }
}
