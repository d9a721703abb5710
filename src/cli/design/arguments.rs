//! The arguments of `spindoe design`, and the command that repeats a design.

use std::num::NonZero;
use std::path::PathBuf;
use std::time::Duration;

use clap::builder::{ArgPredicate, PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};

#[cfg(feature = "vision")]
use super::camera::FRAMES;
use crate::ball::Ball;
#[cfg(feature = "vision")]
use crate::cli::camera::CameraSource;
#[cfg(feature = "vision")]
use crate::cli::output::Counter;
use crate::cli::output::{command_line, one_of, quoted};
use crate::cli::pattern::MIN_DOT_PX;
use crate::design::constraints::max_separation;
use crate::design::objective::PARTS;
#[cfg(feature = "vision")]
use crate::design::objective::TooFewDots;
use crate::design::objective::bound::BoundSummary;
use crate::design::{
    DescentMethod, DesignConfig, DesignRequest, DesignViews, KeepOut, ObjectiveName, Shard,
};
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::recognize::RecognizerName;
use crate::report::DesignJob;
#[cfg(feature = "plot")]
use crate::report::plots::PictureFormat;
use crate::stencil::StencilConfig;
use crate::view::ProtocolName;

#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Random starts descend on the objective under the constraints; the best are evaluated by Monte Carlo, and
the winner once more on trials of seeds used nowhere else.
The folder then holds pattern.csv, table.npz, report.json, report.html, sensitivity.csv and stencil/.

Ctrl-C ends the search and finishes with the best so far; --resume continues a search that was ended or
killed, also with another --budget.

Examples:
  spindoe design
  spindoe design --seed 7 --budget 30m -o my-ball
  spindoe design --seed 7 --budget 30m -o my-ball --resume
  spindoe design --dots 12 --dot-diameter-mm 6 -o twelve
  spindoe design old.csv --keep-out 0,0,1,25 -o with-logo
  spindoe design my-ball --add 4 -o my-ball-and-4
  spindoe design --camera camera.toml -o for-my-camera
  spindoe design --protocol image --ball-px 40 --config pixel_noise=0.7 -o small")]
pub struct Arguments {
    /// Improve this pattern (a shipped one by its name, a CSV, a table, or a folder) instead of starting at random.
    #[arg(value_name = "PATTERN", conflicts_with = "dots")]
    pub(super) pattern: Option<PathBuf>,
    /// Add K dots to those of PATTERN, a ball that is already drawn (the folder of its calibration): its dots
    /// stay exactly where they are. Rates are then of correct orientations, of all views.
    #[arg(long, value_name = "K", requires = "pattern")]
    pub(super) add: Option<NonZero<usize>>,
    /// Number of dots, 4 to 64 [default: 20; with --camera the best of a few numbers].
    #[arg(long, value_name = "N")]
    pub(super) dots: Option<usize>,
    /// Seed of the random starts; the seeds of all trials are derived from it.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,
    /// Number of random starts per round.
    #[arg(hide = true, long, value_name = "N", default_value_t = DesignConfig::default().starts)]
    pub(super) starts: usize,
    /// Number of rounds.
    #[arg(
        hide = true,
        long,
        value_name = "N",
        default_value_t = DesignConfig::default().rounds,
        conflicts_with = "budget"
    )]
    pub(super) rounds: usize,
    /// Begin rounds until this time is spent, for instance 90s, 30m or 2h.
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    pub(super) budget: Option<Duration>,
    /// Continue the search saved in the folder.
    #[arg(long, requires = "output")]
    pub(super) resume: bool,
    /// Search only shard K of N, and leave its rounds in the folder for `spindoe merge`: each shard is a
    /// search with a seed of its own, from --seed on.
    #[arg(long, value_name = "K/N", value_parser = str::parse::<Shard>, requires = "output", conflicts_with = "budget")]
    pub(in crate::cli) shard: Option<Shard>,
    /// Search all N shards one after another, and merge them: what N machines and `spindoe merge`
    /// give.
    #[arg(hide = true, long, value_name = "N", conflicts_with_all = ["shard", "budget"])]
    pub(super) shards: Option<usize>,
    /// Objective that a descent minimizes; by default failure-rate, for more than 24 dots whitened-nn.
    /// With --camera failure-rate counts what that camera detects.
    #[arg(hide = true, long, value_parser = objective_name(), value_name = "OBJECTIVE", default_value_if("preset", ArgPredicate::IsPresent, "mean-nn"))]
    objective: Option<ObjectiveName>,
    /// Weight of the orientation bound's worst direction beside the objective.
    #[arg(hide = true, long, value_name = "W", default_value_t = DesignConfig::default().bound_weight, default_value_if("preset", ArgPredicate::IsPresent, "0"), allow_negative_numbers = true)]
    bound_weight: f64,
    /// Orientation bound, mean and worst over the directions in units of a dot's noise, that is
    /// preferred: a pattern short of it is chosen only where none reaches it. By default, from 20
    /// dots on, that of the published SpinDOE pattern, 0.686,0.894; 1e9,1e9 prefers none.
    #[arg(hide = true, long, value_name = "MEAN,WORST", value_parser = bound_goal, default_value_if("preset", ArgPredicate::IsPresent, "1e9,1e9"))]
    bound_goal: Option<BoundSummary>,
    /// Weight of the pairs' quality as bases, for the paper's recognizer (1 to 4).
    #[arg(hide = true, long, value_name = "W", default_value_t = DesignConfig::default().basis_weight, allow_negative_numbers = true)]
    basis_weight: f64,
    /// Descent steps from every start.
    #[arg(hide = true, long, value_name = "N", default_value_t = DesignConfig::default().scout_steps)]
    scout_steps: u64,
    /// Further descent steps of the best quarter of the starts.
    #[arg(hide = true, long, value_name = "N", default_value_t = DesignConfig::default().climb_steps)]
    climb_steps: u64,
    /// Monte Carlo trials per candidate, again for each protocol of the winner's evaluation, and a
    /// tenth of it for each point of the sensitivity sweeps.
    #[arg(long, value_name = "N", default_value_t = DesignConfig::default().samples)]
    samples: u64,
    /// Settings and views together: paper is the way of the SpinDOE paper, steepest descent on the mean nearest-neighbor
    /// distance of the hash features, tried on the paper's views with the paper's recognizer.
    #[arg(hide = true, long, value_enum)]
    preset: Option<DesignPreset>,
    /// The views to optimize for; mixed is sparse, image and clutter in equal parts. With --add clutter, where nothing else is asked for.
    #[arg(long, value_parser = one_of(&DesignViews::ALL, DesignViews::as_str), default_value_t = DesignViews::Mixed, default_value_ifs([("add", ArgPredicate::IsPresent, Some("clutter")), ("preset", ArgPredicate::IsPresent, Some("paper"))]))]
    protocol: DesignViews,
    /// The recognizer that candidates are tried with.
    #[arg(hide = true, long, value_parser = one_of(&RecognizerName::ALL, RecognizerName::as_str), default_value_t = RecognizerName::Robust, default_value_if("preset", ArgPredicate::IsPresent, "voting"))]
    recognizer: RecognizerName,
    /// How a descent finds its steps: program (sequential convex programming), lbfgs or gradient (steepest descent over
    /// spherical coordinates, as in the SpinDOE paper).
    #[arg(hide = true, long, value_parser = one_of(&DescentMethod::ALL, DescentMethod::as_str), default_value_t = DescentMethod::Program, default_value_if("preset", ArgPredicate::IsPresent, "gradient"))]
    descent: DescentMethod,
    /// Minimum angle between two dots, degrees; by default the separation that the stencil's holes
    /// need, at least 18. With preset=paper and no PATTERN 0.72 of the largest that so many dots can have.
    #[arg(hide = true, long, value_name = "DEG", allow_negative_numbers = true)]
    min_separation_deg: Option<f64>,
    /// Minimum number of visible dots from any direction; by default 3 in 10 of them.
    #[arg(hide = true, long, value_name = "N")]
    min_visible: Option<usize>,
    /// Minimum angle between a dot and the stencil's seam, degrees; 0 sets no limit. By
    /// default 10, less for more than 24 dots.
    #[arg(hide = true, long, value_name = "DEG", allow_negative_numbers = true)]
    seam_margin_deg: Option<f64>,
    /// A cone without dots, such as a logo: its axis and half angle in degrees. May be repeated. By
    /// default the zones of PATTERN.
    #[arg(long, value_name = "X,Y,Z,DEG", value_parser = keep_out, allow_hyphen_values = true)]
    keep_out: Vec<Cone>,
    /// Diameter of the ball that the stencil fits, mm. Table-tennis balls measure 40.0 to 40.6:
    /// measure yours.
    #[arg(long, value_name = "MM", default_value_t = StencilConfig::default().ball_diameter_mm, allow_negative_numbers = true)]
    pub(super) ball_diameter_mm: f64,
    /// Diameter of a dot, which is that of the stencil's holes at the ball, mm [default: a tenth of the ball; with --camera the largest that the
    /// number of dots leaves room for].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub(super) dot_diameter_mm: Option<f64>,
    /// Diameter of the ball in the camera's image, pixels; sets the noise of --protocol image, and shows
    /// whether the dots are too small to be detected.
    #[arg(
        long,
        value_name = "PX",
        default_value_t = DesignRequest::default().ball_px,
        allow_negative_numbers = true
    )]
    ball_px: f64,
    /// Error of a detected dot per image axis, pixels; sets the noise of --protocol image.
    #[arg(
        hide = true,
        long,
        value_name = "PX",
        default_value_t = DesignRequest::default().pixel_noise,
        allow_negative_numbers = true
    )]
    pixel_noise: f64,
    /// Length of the motion blur at the ball, pixels; an eighth of it counts as further error per
    /// axis.
    #[arg(
        hide = true,
        long,
        value_name = "PX",
        default_value_t = DesignRequest::default().blur,
        allow_negative_numbers = true
    )]
    blur: f64,
    /// The camera that the pattern is for, as for `spindoe advise`: it chooses the number of dots where --dots
    /// is not given, and ranks the finalists on rendered frames. That takes some 5 minutes of one core.
    #[cfg(feature = "vision")]
    #[arg(long, value_name = "dark|any|CAMERA.toml")]
    pub(super) camera: Option<CameraSource>,
    /// How often its views show too few dots, where that is known for this number of them.
    #[cfg(feature = "vision")]
    #[arg(skip)]
    pub(super) too_few: Option<TooFewDots>,
    /// Frames of the camera for each pattern that is not clearly worse than another, of which half choose and half
    /// measure; some 15 ms a frame and core, in any surroundings some 30.
    #[cfg(feature = "vision")]
    #[arg(hide = true, long, value_name = "N", requires = "camera", default_value_t = FRAMES)]
    pub(super) camera_frames: u64,
    /// The folder to write to; by default spindoe-design, with a number where that is taken.
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,
    /// Draw the ball, its features, its rates and the search into the folder too, in these formats.
    #[cfg(feature = "plot")]
    #[arg(long, value_name = "png,svg", value_delimiter = ',', value_parser = one_of(&PictureFormat::ALL, PictureFormat::as_str))]
    pub(super) pictures: Vec<PictureFormat>,
    /// Print the report as one JSON object on standard output.
    #[arg(long)]
    pub(super) json: bool,
}

/// The minimum separation of the preset `paper`, as a part of the largest: the paper's recognizer takes two dots for its
/// basis and fails where they are near each other. Right by it at 18, 30, 34 and 35.3 degrees, 10 000 trials of seed 11:
/// 94.4, 97.9, 98.2 and 98.5 %.
const PAPER_SEPARATION: f64 = 0.72;

/// What is set together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum DesignPreset {
    Paper,
}

impl Arguments {
    /// Dots to add to those of the pattern.
    fn added(&self) -> usize {
        self.add.map_or(0, NonZero::get)
    }

    /// The minimum separation that is asked for, or that comes with the preset, degrees.
    fn separation_deg(&self) -> Option<f64> {
        let of_preset = |_| {
            let largest = max_separation(self.dots.unwrap_or(DesignConfig::default().dots));
            let asked = (10.0 * PAPER_SEPARATION * largest.to_degrees()).round() / 10.0;
            // Not that of `request`, which asks for this.
            let holes = DesignRequest {
                ball_diameter_mm: self.ball_diameter_mm,
                dot_diameter_mm: self.dot_diameter_mm,
                ..DesignRequest::default()
            };
            asked.max(holes.usual_separation_deg())
        };
        let preset = self.preset.filter(|_| self.pattern.is_none());
        self.min_separation_deg.or(preset.map(of_preset))
    }

    /// What these arguments ask for, without the pattern.
    fn request(&self) -> DesignRequest {
        DesignRequest {
            pattern: None,
            add: self.added(),
            dots: self.dots,
            seed: self.seed,
            starts: self.starts,
            rounds: match self.budget {
                Some(_) => DesignRequest::UNLIMITED_ROUNDS,
                None => self.rounds,
            },
            scout_steps: self.scout_steps,
            climb_steps: self.climb_steps,
            samples: self.samples,
            descent: self.descent,
            protocol: self.protocol,
            recognizer: self.recognizer,
            ball_px: self.ball_px,
            pixel_noise: self.pixel_noise,
            blur: self.blur,
            objective: self.objective,
            bound_weight: self.bound_weight,
            bound_goal: self.bound_goal,
            basis_weight: self.basis_weight,
            min_separation_rad: self.separation_deg().map(f64::to_radians),
            min_visible: self.min_visible,
            seam_margin_rad: self.seam_margin_deg.map(f64::to_radians),
            keep_out: self.keep_out.iter().map(|c| c.keep_out).collect(),
            ball_diameter_mm: self.ball_diameter_mm,
            dot_diameter_mm: self.dot_diameter_mm,
        }
    }

    /// What these arguments ask for.
    ///
    /// # Errors
    /// Those of reading the pattern.
    fn whole_request(&self) -> Result<DesignRequest> {
        let pattern = match &self.pattern {
            Some(path) => Some(Ball::read(path)?.into_pattern()),
            None => None,
        };
        Ok(DesignRequest {
            pattern,
            ..self.request()
        })
    }

    /// What these arguments ask for, checked, where another program hands out the shards.
    ///
    /// # Errors
    /// [`Error::Argument`] for what that program decides, and what shards have no part in.
    pub(in crate::cli) fn sharded_request(&self) -> Result<DesignRequest> {
        let given = [
            ("budget", self.budget.is_some()),
            ("resume", self.resume),
            ("shard", self.shard.is_some()),
            ("shards", self.shards.is_some()),
            ("output", self.output.is_some()),
            ("json", self.json),
            #[cfg(feature = "vision")]
            ("camera", self.camera.is_some()),
            #[cfg(feature = "plot")]
            ("pictures", !self.pictures.is_empty()),
        ];
        if let Some((flag, _)) = given.into_iter().find(|(_, is_given)| *is_given) {
            return Err(Error::argument(flag, "expected none in a search in shards"));
        }
        let request = self.whole_request()?;
        request.config()?;
        Ok(request)
    }

    /// The configuration of the search; how often views show too few dots is that of the camera, where one is given.
    pub(super) fn config(&self) -> Result<DesignConfig> {
        let request = self.whole_request()?;
        #[cfg(feature = "vision")]
        if let Some(camera) = &self.camera {
            return request.config_by(&|dots| self.coverage(camera, dots));
        }
        request.config()
    }

    /// How often the camera's views of so many dots show too few.
    #[cfg(feature = "vision")]
    fn coverage(&self, camera: &CameraSource, dots: usize) -> Result<TooFewDots> {
        use crate::camera::{COVERAGE_FRAMES, coverage};

        if let Some(known) = self.too_few {
            return Ok(known);
        }
        let conditions = super::camera::conditions(camera, &self.stencil())?;
        let counter = Counter::new(COVERAGE_FRAMES, "frames of the camera");
        let measured = coverage(&conditions, dots, &|n| counter.add(n))?;
        counter.finish();
        Ok(measured)
    }

    /// A warning where the camera sees the dots so small that its detector misses many.
    pub(super) fn dot_size_warning(&self) -> Option<String> {
        let per_mm = self.ball_px / self.ball_diameter_mm;
        let hole_diameter_mm = self.stencil().hole_diameter_mm;
        let width_px = hole_diameter_mm * per_mm;
        (width_px < MIN_DOT_PX).then(|| {
            format!(
                "warning: --dot-diameter-mm: dots of {} mm are {width_px:.1} pixels wide on a ball of {} pixels; \
                 below {MIN_DOT_PX} pixels 5 to 20 of 100 frames more go without an answer; here that takes \
                 {:.1} mm",
                hole_diameter_mm,
                self.ball_px,
                (10.0 * MIN_DOT_PX / per_mm).ceil() / 10.0,
            )
        })
    }

    pub(super) fn stencil(&self) -> StencilConfig {
        self.request().stencil()
    }

    /// The command that reproduces this design, independent of other versions' defaults.
    pub(super) fn command(&self, config: &DesignConfig) -> String {
        let mut words = vec!["spindoe design".to_owned()];
        let mut add = |word: String| words.push(word);
        match &self.pattern {
            Some(path) => {
                add(quoted(&path.to_string_lossy()));
                if let Some(count) = self.add {
                    add(format!("--add {count}"));
                }
            }
            None => add(format!("--dots {}", config.dots)),
        }
        add(format!("--seed {}", config.seed));
        add(format!("--samples {}", config.samples));
        add(format!("--protocol {}", self.protocol));
        for cone in &self.keep_out {
            add(format!(
                "--keep-out {}",
                cone.given.map(|x| x.to_string()).join(",")
            ));
        }
        add(format!("--ball-diameter-mm {}", self.ball_diameter_mm));
        add(format!(
            "--dot-diameter-mm {}",
            self.stencil().hole_diameter_mm
        ));
        #[cfg(feature = "vision")]
        if let Some(camera) = &self.camera {
            add(format!("--camera {}", quoted(&camera.to_string())));
        }
        if self.protocol.include(ProtocolName::Image) {
            add(format!("--ball-px {}", self.ball_px));
        }
        for (key, value) in self.settings(config) {
            add(format!("--config {key}={value}"));
        }
        words.join(" ")
    }

    /// The command that continues this search: the one that was given, with what it left open.
    pub(super) fn resume_command(&self, job: &DesignJob) -> String {
        let mut words = command_line();
        #[cfg(feature = "vision")]
        if self.camera.is_some() && self.pattern.is_none() && !words.contains("--dots") {
            words += &format!(" --dots {}", job.config.dots);
            if !words.contains("--dot-diameter-mm") {
                words += &format!(" --dot-diameter-mm {}", job.stencil.hole_diameter_mm);
            }
        }
        if self.output.is_none() {
            words += &format!(" -o {}", quoted(&job.dir.to_string_lossy()));
        }
        if !self.resume {
            words += " --resume";
        }
        words
    }

    /// The settings that the design follows from.
    fn settings(&self, config: &DesignConfig) -> Vec<(&'static str, String)> {
        let goal = config.bound_goal.unwrap_or(DesignRequest::NO_GOAL);
        let separation_deg = self
            .separation_deg()
            .unwrap_or_else(|| self.request().usual_separation_deg());
        let usual = match self.added() {
            0 => DesignRequest::usual_seam_margin_deg(config.dots),
            _ => 0.0,
        };
        let margin_deg = self.seam_margin_deg.unwrap_or(usual);
        let mut all = vec![
            ("starts", config.starts.to_string()),
            ("rounds", config.rounds.to_string()),
            ("scout_steps", config.scout_steps.to_string()),
            ("climb_steps", config.climb_steps.to_string()),
            ("objective", config.objective.name().to_string()),
            ("descent", config.descent.to_string()),
            ("recognizer", config.recognizer.to_string()),
            ("bound_weight", config.bound_weight.to_string()),
            ("bound_goal", format!("{},{}", goal.mean, goal.worst)),
            ("basis_weight", config.basis_weight.to_string()),
            ("min_separation_deg", separation_deg.to_string()),
            ("min_visible", config.constraints.min_visible.to_string()),
            ("seam_margin_deg", margin_deg.to_string()),
        ];
        if let Some(count) = self.shards.or(self.shard.map(|shard| shard.count)) {
            all.push(("shards", count.to_string()));
        }
        #[cfg(feature = "vision")]
        if self.camera.is_some() && self.camera_frames != FRAMES {
            all.push(("camera_frames", self.camera_frames.to_string()));
        }
        if self.protocol.include(ProtocolName::Image) {
            all.push(("pixel_noise", self.pixel_noise.to_string()));
            all.push(("blur", self.blur.to_string()));
        }
        all
    }
}

/// Takes the name of an objective; for the one that was renamed it says what replaced it.
fn objective_name() -> impl TypedValueParser<Value = ObjectiveName> {
    let names = ObjectiveName::ALL.map(|name| PossibleValue::new(name.as_str()));
    let before = PARTS.map(|name| PossibleValue::new(name).hide(true));
    PossibleValuesParser::new(names.into_iter().chain(before))
        .try_map(|name| name.parse::<ObjectiveName>())
}

/// Parses `MEAN,WORST`.
fn bound_goal(text: &str) -> std::result::Result<BoundSummary, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .filter_map(|n| n.trim().parse().ok())
        .collect();
    match numbers.as_slice() {
        &[mean, worst] if mean > 0.0 && worst > 0.0 && mean.max(worst).is_finite() => {
            Ok(BoundSummary { mean, worst })
        }
        _ => Err("expected two positive numbers MEAN,WORST".to_owned()),
    }
}

/// A cone without dots, with the numbers as given: the command in the report reproduces them, since
/// an axis that is normalized twice may differ in its last bit.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cone {
    given: [f64; 4],
    keep_out: KeepOut,
}

/// Parses `X,Y,Z,DEG` into a cone.
#[cfg(feature = "mark")]
pub(in crate::cli) fn cone(text: &str) -> std::result::Result<KeepOut, String> {
    keep_out(text).map(|cone| cone.keep_out)
}

/// Parses `X,Y,Z,DEG`.
fn keep_out(text: &str) -> std::result::Result<Cone, String> {
    let numbers: std::result::Result<Vec<f64>, _> =
        text.split(',').map(|n| n.trim().parse::<f64>()).collect();
    let Ok(&[x, y, z, deg]) = numbers.as_deref() else {
        return Err("expected four numbers X,Y,Z,DEG".to_owned());
    };
    let axis = Vec3::new(x, y, z)
        .try_normalize(1e-9)
        .filter(|axis| axis.iter().all(|c| c.is_finite()))
        .ok_or("expected an axis that is not zero")?;
    Ok(Cone {
        given: [x, y, z, deg],
        keep_out: KeepOut {
            axis,
            half_angle_rad: deg.to_radians(),
        },
    })
}
