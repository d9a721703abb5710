//! What is asked of a design, and the configuration that follows from it.

use serde::{Deserialize, Serialize};

use super::config::DesignConfig;
use super::constraints::{Constraints, KeepOut};
use super::descent::DescentMethod;
use super::objective::bound::BoundSummary;
use super::objective::{FailureRate, Objective, ObjectiveName, TooFewDots};
use super::search::feasible::packed_separation;
use super::views::DesignViews;
use crate::ball::USUAL_BALL_MM;
use crate::error::{Error, Result, require};
use crate::pattern::{MAX_DOTS, MIN_DOTS, Pattern};
use crate::recognize::RecognizerName;
use crate::stencil::StencilConfig;
use crate::view::{Noise, Protocol, ProtocolName, ViewModel};

/// Dots of the published SpinDOE pattern, and its orientation bound.
const PUBLISHED_DOTS: usize = 20;
const PUBLISHED_BOUND: BoundSummary = BoundSummary {
    mean: 0.686,
    worst: 0.894,
};
/// Fraction of a blur's length that counts as error of a dot's center, per axis.
const BLUR_SHARE: f64 = 0.125;
/// Minimum separation for any hole size, degrees: nearer dots merge in a small image.
const MIN_SEPARATION_DEG: f64 = 18.0;

/// What one decides of a design. What is left open (`None`) follows from the rest:
/// [`DesignRequest::config`] settles it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DesignRequest {
    /// A pattern to improve instead of starting at random; or, with `add`, the ball's dots as they are drawn.
    #[serde(skip)]
    pub pattern: Option<Pattern>,
    /// Dots to add to those of `pattern`, which stay where they are.
    #[serde(default)]
    pub add: usize,
    /// Number of dots, 4 to 64. Open: those of `pattern`, else 20.
    pub dots: Option<usize>,
    /// Seed of the random starts; the seeds of all trials are derived from it.
    pub seed: u64,
    /// Random starts per round.
    pub starts: usize,
    /// Rounds.
    pub rounds: usize,
    /// Descent steps from every start.
    pub scout_steps: u64,
    /// Further descent steps of the best quarter of the starts.
    pub climb_steps: u64,
    /// Monte Carlo trials per candidate, again for each protocol of the winner's evaluation, and a
    /// tenth of it for each point of the sensitivity sweeps.
    pub samples: u64,
    /// How a descent finds its steps.
    pub descent: DescentMethod,
    /// The views to optimize for.
    pub protocol: DesignViews,
    /// The recognizer that candidates are tried with.
    pub recognizer: RecognizerName,
    /// Diameter of the ball in the image, pixels; sets the noise of [`ProtocolName::Image`].
    pub ball_px: f64,
    /// Error of a detected dot per image axis, pixels; sets the noise of [`ProtocolName::Image`].
    pub pixel_noise: f64,
    /// Length of the motion blur at the ball, pixels; an eighth of it counts as further error per axis.
    pub blur: f64,
    /// Objective that a descent minimizes. Open: [`ObjectiveName::for_dots`].
    pub objective: Option<ObjectiveName>,
    /// Weight of the orientation bound's worst direction beside the objective.
    pub bound_weight: f64,
    /// Orientation bound, in units of a dot's noise, that is preferred: a pattern short of it is chosen only
    /// where none reaches it. Open: from 20 dots on that of the published SpinDOE pattern.
    pub bound_goal: Option<BoundSummary>,
    /// Weight of the pairs' quality as bases, for the paper's recognizer.
    pub basis_weight: f64,
    /// Minimum angle between two dots, radians. Open: the separation that the stencil's holes need,
    /// at least 18 degrees; between added dots, which a hand draws, a dot's width of bare ball, at least as much.
    pub min_separation_rad: Option<f64>,
    /// Minimum number of visible dots from any direction. Open: 3 in 10 of them.
    pub min_visible: Option<usize>,
    /// Minimum angle between a dot and the stencil's seam, radians; 0 sets no limit. Open: 10 degrees,
    /// less for more than 24 dots.
    pub seam_margin_rad: Option<f64>,
    /// Cones without dots. Empty: the zones of `pattern`.
    pub keep_out: Vec<KeepOut>,
    /// Diameter of the ball that the stencil fits, mm.
    pub ball_diameter_mm: f64,
    /// Diameter of a dot, which is that of the stencil's holes at the ball, mm. Open: a tenth of the ball.
    pub dot_diameter_mm: Option<f64>,
}

impl Default for DesignRequest {
    /// The values of [`DesignConfig::default`] and [`StencilConfig::default`], a ball of 60 pixels
    /// with an error of 1 pixel, and everything else open.
    fn default() -> Self {
        let config = DesignConfig::default();
        Self {
            pattern: None,
            add: 0,
            dots: None,
            seed: config.seed,
            starts: config.starts,
            rounds: config.rounds,
            scout_steps: config.scout_steps,
            climb_steps: config.climb_steps,
            samples: config.samples,
            descent: config.descent,
            protocol: config.views,
            recognizer: config.recognizer,
            ball_px: 60.0,
            pixel_noise: 1.0,
            blur: 0.0,
            objective: None,
            bound_weight: config.bound_weight,
            bound_goal: None,
            basis_weight: config.basis_weight,
            min_separation_rad: None,
            min_visible: None,
            seam_margin_rad: None,
            keep_out: Vec::new(),
            ball_diameter_mm: USUAL_BALL_MM,
            dot_diameter_mm: None,
        }
    }
}

impl DesignRequest {
    /// A bound that every pattern meets: as a goal it prefers none.
    pub const NO_GOAL: BoundSummary = BoundSummary {
        mean: 1e9,
        worst: 1e9,
    };
    /// Number of rounds where something else ends the search.
    pub const UNLIMITED_ROUNDS: usize = 1 << 32;

    /// The whole configuration, checked.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the field that is outside its domain, or holes so large that the
    /// dots do not fit.
    pub fn config(&self) -> Result<DesignConfig> {
        let measured = |name, dots| Objective::for_views(name, &self.views()?, dots);
        self.config_with(&measured)
    }

    fn views(&self) -> Result<Vec<ViewModel>> {
        Ok(self.protocols()?.iter().map(|p| *p.view()).collect())
    }

    /// As [`config`](Self::config) before a camera: `too_few` says how often its views of so many dots show too few,
    /// and is asked where the objective counts that.
    ///
    /// # Errors
    /// As [`config`](Self::config); those of `too_few`.
    pub fn config_by(&self, too_few: &dyn Fn(usize) -> Result<TooFewDots>) -> Result<DesignConfig> {
        self.config_with(&|name, dots| match name {
            ObjectiveName::FailureRate => {
                let rate = FailureRate::of_camera(too_few(dots)?, dots);
                Ok(Objective::FailureRate(rate))
            }
            _ => Objective::for_views(name, &self.views()?, dots),
        })
    }

    /// The whole configuration, checked before `objective` is asked: it takes thousands of trials, or frames.
    fn config_with(
        &self,
        objective: &dyn Fn(ObjectiveName, usize) -> Result<Objective>,
    ) -> Result<DesignConfig> {
        let dots = self.dot_count()?;
        let expected = format!("{MIN_DOTS} to {MAX_DOTS}");
        let inside = (MIN_DOTS..=MAX_DOTS).contains(&dots);
        require(inside, "dots", &expected, dots)?;
        let protocols = self.protocols()?;
        let name = self.objective.unwrap_or(ObjectiveName::for_dots(dots));
        let mut config = DesignConfig {
            dots,
            seed: self.seed,
            starts: self.starts,
            rounds: self.rounds,
            scout_steps: self.scout_steps,
            climb_steps: self.climb_steps,
            samples: self.samples,
            descent: self.descent,
            views: self.protocol,
            protocols,
            recognizer: self.recognizer,
            constraints: self.constraints(dots),
            objective: Objective::for_views(name, &[], dots)?,
            bound_weight: self.bound_weight,
            bound_goal: self.bound_goal(dots)?,
            basis_weight: self.basis_weight,
            from: self
                .pattern
                .as_ref()
                .map(|p| p.dots().iter().map(|d| [d.x, d.y, d.z]).collect()),
        };
        self.stencil().validate().map_err(of_dots)?;
        self.check_holes(dots)?;
        self.check_added(&config.constraints)?;
        config.check()?;
        config.objective = objective(name, dots)?;
        Ok(config)
    }

    /// The constraints. Beside dots that are drawn none depends on the stencil: one may not even be possible.
    fn constraints(&self, dots: usize) -> Constraints {
        let is_added = self.add > 0;
        let usual_margin_rad = match is_added {
            true => 0.0,
            false => Self::usual_seam_margin_deg(dots).to_radians(),
        };
        Constraints {
            min_separation_rad: self
                .min_separation_rad
                .unwrap_or_else(|| self.usual_separation_deg().to_radians()),
            // More dots never leave fewer in view.
            min_visible: self
                .min_visible
                .unwrap_or(if is_added { 0 } else { 3 * dots / 10 }),
            seam_margin_rad: self.seam_margin_rad.unwrap_or(usual_margin_rad),
            keep_out: match &self.pattern {
                Some(pattern) if self.keep_out.is_empty() => pattern.keep_out().to_vec(),
                _ => self.keep_out.clone(),
            },
            stencil: (!is_added).then(|| self.stencil()),
            drawn: match &self.pattern {
                Some(pattern) if is_added => pattern.len(),
                _ => 0,
            },
            ..Constraints::default()
        }
    }

    /// Rejects what dots that are drawn already leave no choice in.
    fn check_added(&self, constraints: &Constraints) -> Result<()> {
        let Some(pattern) = self.pattern.as_ref().filter(|_| self.add > 0) else {
            return require(self.add == 0, "add", "a pattern to add dots to", "none");
        };
        let margin = constraints.seam_margin_rad.to_degrees();
        require(
            margin == 0.0,
            "seam_margin_rad",
            "0 beside drawn dots",
            margin,
        )?;
        let zones = constraints.keep_out.clone();
        pattern.clone().with_keep_out(zones).map(drop)
    }

    /// The stencil that draws the pattern.
    pub fn stencil(&self) -> StencilConfig {
        let usual = StencilConfig::for_ball(self.ball_diameter_mm);
        StencilConfig {
            hole_diameter_mm: self.dot_diameter_mm.unwrap_or(usual.hole_diameter_mm),
            ..usual
        }
    }

    fn dot_count(&self) -> Result<usize> {
        match (&self.pattern, self.dots) {
            (Some(pattern), Some(dots)) if pattern.len() != dots => {
                let problem = format!("expected none beside a pattern of {}", pattern.len());
                Err(Error::argument("dots", problem))
            }
            (Some(pattern), _) => Ok(pattern.len() + self.add),
            (None, dots) => Ok(dots.unwrap_or(DesignConfig::default().dots)),
        }
    }

    fn protocols(&self) -> Result<Vec<Protocol>> {
        let names = self.protocol.protocols().iter();
        names.map(|&name| self.protocol(name)).collect()
    }

    fn protocol(&self, name: ProtocolName) -> Result<Protocol> {
        let protocol = Protocol::standard(name);
        if let Noise::Pixel { .. } = protocol.view().noise {
            for (name, value, minimum) in [
                ("ball_px", self.ball_px, 4.0),
                ("pixel_noise", self.pixel_noise, 0.0),
                ("blur", self.blur, 0.0),
            ] {
                let expected = format!("at least {minimum} pixels");
                require(
                    value.is_finite() && value >= minimum,
                    name,
                    &expected,
                    value,
                )?;
            }
            return Ok(protocol.with_noise(Noise::Pixel {
                radius_px: 0.5 * self.ball_px,
                sigma_px: self.pixel_noise.hypot(BLUR_SHARE * self.blur),
            }));
        }
        Ok(protocol)
    }

    fn bound_goal(&self, dots: usize) -> Result<Option<BoundSummary>> {
        // Dots that are drawn decide most of it.
        let published = (dots >= PUBLISHED_DOTS && self.add == 0).then_some(PUBLISHED_BOUND);
        let goal = self.bound_goal.or(published);
        if let Some(BoundSummary { mean, worst }) = goal {
            let is_bound = mean > 0.0 && worst > 0.0 && mean.max(worst).is_finite();
            let found = format!("{mean}, {worst}");
            require(is_bound, "bound_goal", "two positive numbers", found)?;
        }
        Ok(goal.filter(|goal| *goal != Self::NO_GOAL))
    }

    /// The minimum separation where it is open, degrees: that of the holes, or of dots that a hand adds, rounded up to a tenth, so
    /// that a command reproduces it.
    pub(crate) fn usual_separation_deg(&self) -> f64 {
        let stencil = self.stencil();
        let needed = match self.add {
            0 => stencil.min_separation_rad(),
            // A dot's width of bare ball between two: see docs/hand-drawn.md.
            _ => 4.0 * (stencil.hole_diameter_mm / stencil.ball_diameter_mm).asin(),
        };
        MIN_SEPARATION_DEG.max((10.0 * needed.to_degrees()).ceil() / 10.0)
    }

    /// The seam's margin where it is open, degrees.
    pub(crate) fn usual_seam_margin_deg(dots: usize) -> f64 {
        if dots <= 24 {
            10.0
        } else {
            240.0 / dots as f64
        }
    }

    /// Rejects holes so large that the dots do not fit. The message is in millimeters, the unit of
    /// the field.
    fn check_holes(&self, dots: usize) -> Result<()> {
        // Other numbers of dots are rejected elsewhere.
        if self.min_separation_rad.is_some()
            || self.add > 0
            || !(MIN_DOTS..=MAX_DOTS).contains(&dots)
        {
            return Ok(());
        }
        let reached = packed_separation(dots);
        let fits = |stencil: &StencilConfig| stencil.min_separation_rad() <= reached;
        let asked = self.stencil();
        if fits(&asked) {
            return Ok(());
        }
        let smaller = |tenths: u32| StencilConfig {
            hole_diameter_mm: f64::from(tenths) / 10.0,
            ..asked.clone()
        };
        let hint = (5..(10.0 * asked.hole_diameter_mm) as u32)
            .rev()
            .map(smaller)
            .find(fits)
            .map_or("no hole fits".to_owned(), |s| {
                format!("holes of at most {:.1} mm fit", s.hole_diameter_mm)
            });
        let problem = format!(
            "{dots} holes of {} mm, with the wall that the stencil needs between them, must be {:.1} degrees apart \
             on a ball of {} mm, and the largest separation found for so many dots is {:.1}; {hint}",
            asked.hole_diameter_mm,
            asked.min_separation_rad().to_degrees(),
            asked.ball_diameter_mm,
            reached.to_degrees(),
        );
        Err(Error::argument("dot_diameter_mm", problem))
    }
}

/// The stencil's error by the field's name here: its holes are the dots.
fn of_dots(error: Error) -> Error {
    match error {
        Error::Argument { parameter, problem } if parameter.as_str() == "hole_diameter_mm" => {
            Error::argument("dot_diameter_mm", problem)
        }
        other => other,
    }
}
