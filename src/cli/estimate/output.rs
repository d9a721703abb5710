//! The output of `spindoe estimate`.

use serde_json::{Value, json};

use super::{Arguments, Frame, Picture};
use crate::geometry::{Rotation, Vec3, to_wxyz};
use crate::spin::Fit;
use crate::spin::orientations::{OrientationRow, Orientations};
use crate::vision::FrameEstimate;
use crate::vision::estimator::{Batch, BatchFrame, SequenceOutcome};

/// Everything that is reported.
pub(super) struct Report<'a> {
    pub arguments: &'a Arguments,
    pub batch: &'a Batch<Picture>,
}

/// The outcome of a frame, in words.
pub(super) fn words(frame: &FrameEstimate) -> String {
    let second = match frame.fit.map_or(0, |f| f.rivals) {
        0 => "",
        _ => "; more than one ball in view",
    };
    match &frame.outcome {
        Ok(pose) => format!(
            "p = {:.2}, {} of {} dots, {:.1} deg, {:.2} px{}{second}",
            pose.pose_confidence,
            frame.matched(),
            frame.dots.len(),
            pose.residual_rad.to_degrees(),
            pose.residual_px,
            if pose.hinted { ", hinted" } else { "" },
        ),
        Err(rejection) => format!("{rejection}{second}"),
    }
}

impl Report<'_> {
    pub fn orientations_csv(&self) -> String {
        let frames = self.batch.frames.iter();
        let rows = frames.map(|shown| {
            let frame = &shown.estimate;
            let pose = frame.pose();
            OrientationRow {
                frame: shown.name.clone(),
                time_s: shown.time_s.unwrap_or(f64::NAN),
                orientation: pose.map(|p| in_output_frame(self.arguments, &p.rotation)),
                dots: Some(frame.dots.len()),
                matched: Some(frame.matched()),
                residual_rad: pose.map(|p| p.residual_rad),
                confidence: pose.map(|p| p.pose_confidence),
            }
        });
        Orientations {
            rows: rows.collect(),
        }
        .to_csv()
    }

    pub fn to_json(&self) -> Value {
        let frames = self.batch.frames.iter();
        let frames: Vec<Value> = frames.map(|frame| self.frame_json(frame)).collect();
        let mut json = json!({
            "detector": self.arguments.detector,
            "frame": match self.arguments.frame {
                Frame::Ours => "ours",
                Frame::Optical => "optical",
            },
            "frames": frames,
            "identified": self.batch.identified(),
        });
        if let SequenceOutcome::Estimated { spin, .. } = &self.batch.sequence {
            match spin {
                Ok(fit) => json["spin"] = self.spin_json(fit),
                Err(rejection) => json["spin_refusal"] = rejection.to_string().into(),
            }
        }
        json
    }

    fn spin_json(&self, fit: &Fit) -> Value {
        let (frames, identified) = (self.batch.frames.len(), self.batch.identified());
        fit_json(self.arguments, fit, frames, identified)
    }

    fn frame_json(&self, shown: &BatchFrame<Picture>) -> Value {
        let frame = &shown.estimate;
        let dots: Vec<Value> = frame
            .dots
            .iter()
            .zip(&frame.assignment)
            .map(|(dot, name)| {
                let c = dot.covariance;
                json!({
                    "u": dot.pixel.u,
                    "v": dot.pixel.v,
                    "covariance_px2": [[c[(0, 0)], c[(0, 1)]], [c[(1, 0)], c[(1, 1)]]],
                    "confidence": dot.confidence,
                    "name": name,
                })
            })
            .collect();
        let ms = |d: std::time::Duration| 1e3 * d.as_secs_f64();
        let mut json = json!({
            "frame": shown.name,
            "time_s": shown.time_s,
            "circle": frame.circle.map(|c| json!({
                "u": c.center.u, "v": c.center.v, "radius": c.radius,
            })),
            "dots": dots.len(),
            "detections": dots,
            "milliseconds": {
                "locate": ms(frame.timings.locate),
                "detect": ms(frame.timings.detect),
                "identify": ms(frame.timings.identify),
            },
        });
        if let Some(fit) = &frame.fit {
            json["outline"] = json!({
                "support": fit.support,
                "visible": fit.visible,
                "contrast": fit.contrast,
                "edge_width_px": fit.edge_width,
                "other_balls": fit.rivals,
            });
        }
        add_pose(self.arguments, frame, &mut json);
        json
    }

    /// Summarizes the outcome of the frames on standard error.
    pub fn say(&self) {
        for shown in &self.batch.frames {
            let (name, frame) = (&shown.name, &shown.estimate);
            let several = frame.fit.is_some_and(|f| f.rivals > 0);
            if frame.pose().is_none() || several {
                errln!("{name}: {}", words(frame));
            }
        }
        let count = self.batch.frames.len();
        errln!("{} of {count} frames identified", self.batch.identified());
        let SequenceOutcome::Estimated { summary, spin } = &self.batch.sequence else {
            return;
        };
        if summary.together > summary.alone {
            errln!("{} of them independently", summary.alone);
        }
        match spin {
            Ok(fit) => {
                let mut spin = fit.motion.spin;
                if self.arguments.frame == Frame::Optical {
                    spin = half_turn() * spin;
                }
                let axis = spin.try_normalize(0.0).unwrap_or_default();
                errln!(
                    "spin: {:.3} rps about [{:.4}, {:.4}, {:.4}], {} frames agree",
                    fit.motion.rps(),
                    axis.x,
                    axis.y,
                    axis.z,
                    fit.inliers
                );
            }
            Err(rejection) => errln!("spin: {rejection}"),
        }
    }
}

/// An orientation in the requested frame.
fn in_output_frame(arguments: &Arguments, rotation: &Rotation) -> Rotation {
    match arguments.frame {
        Frame::Ours => *rotation,
        Frame::Optical => half_turn() * rotation,
    }
}

/// A spin in the requested frame.
pub(super) fn fit_json(
    arguments: &Arguments,
    fit: &Fit,
    frames: usize,
    identified: usize,
) -> Value {
    let mut motion = fit.motion;
    let mut covariance = fit.spin_covariance;
    if arguments.frame == Frame::Optical {
        let turn = half_turn();
        motion.spin = turn * motion.spin;
        motion.orientation = turn * motion.orientation;
        let matrix = turn.to_rotation_matrix();
        covariance = covariance.map(|c| matrix.matrix() * c * matrix.matrix().transpose());
    }
    let turned = Fit {
        motion,
        spin_covariance: covariance,
        ..*fit
    };
    crate::cli::spin::fit_json(&turned, frames, identified)
}

/// Adds a frame's orientation, or why there is none.
pub(super) fn add_pose(arguments: &Arguments, frame: &FrameEstimate, json: &mut Value) {
    match &frame.outcome {
        Ok(pose) => {
            let rotation = in_output_frame(arguments, &pose.rotation);
            json["orientation_wxyz"] = json!(to_wxyz(&rotation));
            json["matched"] = frame.matched().into();
            json["residual_deg"] = pose.residual_rad.to_degrees().into();
            json["residual_px"] = pose.residual_px.into();
            json["confidence"] = pose.confidence.into();
            json["pose_confidence"] = pose.pose_confidence.into();
            json["hinted"] = pose.hinted.into();
            if let Some(distance) = pose.distance {
                json["inverse_distance"] = distance.inverse_distance.into();
                json["inverse_distance_sigma"] = distance.sigma.into();
            }
        }
        Err(rejection) => json["refusal"] = rejection.to_string().into(),
    }
}

/// From our camera frame to the optical one: diag(1, -1, -1), a half-turn about x.
fn half_turn() -> Rotation {
    Rotation::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI)
}
