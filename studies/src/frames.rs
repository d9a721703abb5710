//! Sets of frames, and how they are estimated: each alone, with the settings of `spindoe estimate`.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use spindoe::Result;
use spindoe::camera::FrameOutcome;
use spindoe::image::ImageView;
use spindoe::pattern::{Pattern, shipped_designs};
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{FrameTruth, SynthFrame, independent_frame};
use spindoe::vision::estimator::EstimatorWorkspace;
use spindoe::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};

/// The pattern that most is measured with; it occurs in no training.
pub const DOTS20: &str = "designs/dots20/pattern.csv";

/// Frames of a kind.
#[derive(Debug, Clone)]
pub struct FrameSet {
    /// In words.
    pub name: &'static str,
    /// What the frames are drawn from.
    pub config: SynthConfig,
}

/// What the nets are trained for.
pub fn all_conditions() -> FrameSet {
    FrameSet {
        name: "all conditions",
        config: SynthConfig::default(),
    }
}

/// What a user would arrange; balls of 60 px.
pub fn good_conditions() -> FrameSet {
    FrameSet {
        name: "good conditions, 60 px",
        config: SynthConfig::good(),
    }
}

/// An estimator with the built-in nets and the default settings.
///
/// # Errors
/// A pattern that cannot be estimated.
pub fn estimator(pattern: &Pattern) -> Result<Estimator> {
    let detector = DetectorName::Cnn.build()?;
    Estimator::new(pattern, EstimatorConfig::default(), detector)
}

/// One that measures how dots are blurred, too.
pub fn blur_estimator(pattern: &Pattern) -> Result<Estimator> {
    let config = EstimatorConfig {
        measures_blur: true,
        ..EstimatorConfig::default()
    };
    Estimator::new(pattern, config, DetectorName::Cnn.build()?)
}

/// The workspace of such an estimator.
pub type Workspace = EstimatorWorkspace;

/// That of each estimator, on the heap: rayon holds one in each part that it splits its work into, on the stack.
#[inline(never)]
pub fn workspaces<const N: usize>(estimators: &[Estimator; N]) -> Box<[Workspace; N]> {
    Box::new(estimators.each_ref().map(Estimator::workspace))
}

/// An image, without a prior.
pub fn alone<'a>(
    estimator: &Estimator,
    image: impl Into<ImageView<'a>>,
    ws: &mut Workspace,
) -> FrameEstimate {
    let mut found = FrameEstimate::default();
    let (prior, budget) = (Prior::default(), Budget::default());
    estimator.estimate(image, &prior, &budget, ws, &mut found);
    found
}

/// What became of a frame.
pub fn outcome(found: &FrameEstimate, truth: &FrameTruth) -> FrameOutcome {
    FrameOutcome::of(found, &truth.orientation())
}

/// The first `count` frames of a seed, each given to all estimators, and judged.
///
/// # Errors
/// Settings that cannot be drawn from.
pub fn each<T: Send, const N: usize>(
    estimators: &[Estimator; N],
    config: &SynthConfig,
    seed: u64,
    count: usize,
    judge: impl Fn(&SynthFrame, [FrameEstimate; N]) -> T + Sync,
) -> Result<Vec<T>> {
    let one = |ws: &mut Box<[Workspace; N]>, k: usize| {
        let frame = independent_frame(estimators[0].pattern(), config, seed, k)?;
        let found = std::array::from_fn(|i| alone(&estimators[i], &frame.image, &mut ws[i]));
        Ok(judge(&frame, found))
    };
    (0..count)
        .into_par_iter()
        .map_init(|| workspaces(estimators), one)
        .collect()
}

/// Patterns that a table compares, on the command line.
#[derive(Debug, clap::Args)]
pub struct Patterns {
    /// Patterns before those of the shipped designs.
    #[arg(value_name = "PATTERN.csv")]
    given: Vec<PathBuf>,
    /// Not the shipped designs.
    #[arg(long, requires = "given")]
    only: bool,
}

impl Patterns {
    /// The patterns with their names.
    ///
    /// # Errors
    /// A file that is no pattern.
    pub fn read(&self) -> Result<Vec<(String, Pattern)>> {
        let given = self
            .given
            .iter()
            .map(|path| Ok((name_of(path), Pattern::read_csv(path)?)));
        let mut all = given.collect::<Result<Vec<_>>>()?;
        if !self.only {
            let shipped = shipped_designs()?.into_iter();
            all.extend(shipped.map(|design| (design.name.to_string(), design.pattern)));
        }
        Ok(all)
    }
}

/// A pattern's name: that of its file, or of its folder where the file is a `pattern.csv`.
pub fn name_of(path: &Path) -> String {
    let stem = |path: &Path| Some(path.file_stem()?.to_string_lossy().into_owned());
    let own = stem(path).unwrap_or_default();
    match own.as_str() {
        "pattern" => path.parent().and_then(stem).unwrap_or(own),
        _ => own,
    }
}
