//! Single images that do not show the ball: how often are they answered?
//!
//! Each kind is estimated with the table of `dots20` or of another design, each image alone, as `estimate`
//! does it. Half of the rendered images are taken in good conditions, half in all. Photographs come from a folder:
//! crops of all sizes, none of them used in training.

use std::path::{Path, PathBuf};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::Result;
use spindoe::geometry::Rotation;
use spindoe::image::RgbImage;
use spindoe::pattern::{Pattern, random_pattern};
use spindoe::synth::dataset::independent_frame;
use spindoe::synth::{SynthConfig, SynthKind};
use spindoe::validate::ORIENTATION_FAILURE_RAD;
use spindoe::vision::frame::Hypothesis;
use spindoe::vision::pose::{PoseEvidence, TrustMap};
use spindoe::vision::{DetectorName, Estimator, EstimatorConfig};
use spindoe_studies::frames::{all_conditions, alone, estimator, good_conditions};
use spindoe_studies::noise::NoiseField;
use spindoe_studies::pictures::pictures;
use spindoe_studies::score::{Claim, bins, claimed, share};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

use super::verdicts::DESIGNS;

/// The design whose table is used, and those on which the map of confidences is fitted and shown.
const OWN: &str = "dots20";
const FITTED: [&str; 3] = ["dots12", "dots20", "dots32"];
/// The published pattern, where it is here.
const PUBLISHED: &str = "../shared/data/spindoe2023/ref_pattern.csv";
/// Minimum angle between random dots, radians: that of dots of 40 mm balls that hardly touch.
const MIN_SEPARATION_RAD: f64 = 0.25;
/// Sides of a photograph's crop, pixels.
const CROP_PX: [f64; 2] = [40.0, 400.0];

/// What an image shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// The ball: for comparison.
    Ball,
    /// The ball in a mirror.
    Mirrored,
    /// A ball of another design.
    OtherDesign,
    /// A ball with as many random dots.
    RandomDots,
    /// What the synthesis offers.
    Rendered(SynthKind),
    /// Noise of several spectra all over the image.
    NoiseField,
    /// A crop of a photograph.
    Photograph,
}

/// All kinds, by name.
fn kinds() -> Vec<(String, Kind)> {
    let rendered = SynthKind::ALL.into_iter().filter(|k| !k.has_pattern());
    let mut all = vec![
        ("ball (for comparison)".to_owned(), Kind::Ball),
        ("mirrored ball".to_owned(), Kind::Mirrored),
        ("other design".to_owned(), Kind::OtherDesign),
        ("random dots".to_owned(), Kind::RandomDots),
    ];
    all.extend(rendered.map(|k| (k.as_str().to_owned(), Kind::Rendered(k))));
    all.push(("noise field".into(), Kind::NoiseField));
    all.push(("photograph".into(), Kind::Photograph));
    all
}

/// What the images are made of.
struct Sources {
    own: Pattern,
    others: Vec<Pattern>,
    photographs: Vec<RgbImage>,
}

impl Sources {
    /// The other designs, the published pattern where it is here, and the photographs of a folder.
    fn new(own: &str, photographs: Option<&Path>) -> Result<Self> {
        let design = |name: &str| Pattern::read_csv(format!("designs/{name}/pattern.csv").as_ref());
        let others = DESIGNS.iter().filter(|d| **d != own);
        let mut others: Vec<Pattern> = others.map(|d| design(d)).collect::<Result<_>>()?;
        if Path::new(PUBLISHED).exists() {
            others.push(Pattern::read_csv(PUBLISHED.as_ref())?);
        }
        Ok(Self {
            own: design(own)?,
            others,
            photographs: photographs.map_or(Ok(Vec::new()), pictures)?,
        })
    }

    /// An image, and the orientation where it shows the ball.
    fn image(&self, kind: Kind, seed: u64, k: u64) -> Result<(RgbImage, Option<Rotation>)> {
        let config = match k % 2 {
            0 => good_conditions().config,
            _ => all_conditions().config,
        };
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(k);
        let render = |pattern: &Pattern, config: &SynthConfig| {
            Ok(independent_frame(pattern, config, seed, k as usize)?.image)
        };
        let image = match kind {
            Kind::Ball => {
                let frame = independent_frame(&self.own, &config, seed, k as usize)?;
                return Ok((frame.image, Some(frame.truth.orientation())));
            }
            Kind::Mirrored => mirrored(&render(&self.own, &config)?),
            Kind::OtherDesign => {
                let other = rng.random_range(0..self.others.len());
                render(&self.others[other], &config)
            }
            Kind::RandomDots => {
                let pattern = random_pattern(self.own.len(), MIN_SEPARATION_RAD, &mut rng)?;
                render(&pattern, &config)
            }
            Kind::Rendered(kind) => render(&self.own, &SynthConfig { kind, ..config }),
            Kind::NoiseField => {
                let field = NoiseField::random(&mut rng, k);
                let values = field.values.iter().map(|x| [*x; 3]).collect();
                RgbImage::new(field.side, field.side, values)
            }
            Kind::Photograph => crop(&self.photographs, &mut rng),
        };
        Ok((image?, None))
    }
}

fn mirrored(image: &RgbImage) -> Result<RgbImage> {
    let rows = image.values().chunks_exact(image.width());
    let values = rows.flat_map(|row| row.iter().rev().copied()).collect();
    RgbImage::new(image.width(), image.height(), values)
}

/// A square of a photograph, of any size and place, at its own scale or made smaller.
fn crop(photographs: &[RgbImage], rng: &mut ChaCha8Rng) -> Result<RgbImage> {
    let image = &photographs[rng.random_range(0..photographs.len())];
    let largest = image.width().min(image.height()) as f64;
    let [low, high] = CROP_PX;
    let side = low * (high.min(largest) / low).max(1.0).powf(rng.random());
    let side = side.min(largest) as usize;
    let left = rng.random_range(0..=image.width() - side);
    let top = rng.random_range(0..=image.height() - side);
    let part = image.part(left, top, side, side)?;
    match side > 200 {
        true => part.resized(200, 200),
        false => Ok(part),
    }
}

/// What became of an image.
#[derive(Debug, Clone, Copy)]
pub struct Answer {
    /// What speaks for its best pose, accepted or not.
    pub evidence: PoseEvidence,
    /// The same of the pose of its detections and whether that is the ball's, where another was looked for.
    pub earlier: Option<Judged>,
    /// The probability reported; `None` where there is no answer.
    pub confidence: Option<f64>,
    /// Whether the best pose, accepted or not, is the ball's.
    pub is_correct: bool,
    /// Whether the image shows the ball.
    pub is_ball: bool,
}

/// A pose that was not accepted.
#[derive(Debug, Clone, Copy)]
pub struct Judged {
    /// What speaks for it.
    pub evidence: PoseEvidence,
    /// Whether it is the ball's.
    pub is_correct: bool,
}

/// Estimates an image; `truth` where it shows the ball. `None` where no dots were identified.
fn answer(estimator: &Estimator, image: &RgbImage, truth: Option<Rotation>) -> Option<Answer> {
    let out = alone(estimator, image, &mut estimator.workspace());
    let is_correct = |found: Option<Rotation>| {
        let off = truth.zip(found).map(|(t, r)| t.angle_to(&r));
        off.is_some_and(|o| o < ORIENTATION_FAILURE_RAD)
    };
    let judged = |h: &Hypothesis| Judged {
        evidence: h.evidence,
        is_correct: is_correct(Some(h.rotation)),
    };
    let mut hypotheses = out.hypotheses().map(judged);
    let (last, earlier) = (hypotheses.next_back()?, hypotheses.next());
    let pose = out.pose();
    Some(Answer {
        evidence: last.evidence,
        earlier,
        confidence: pose.map(|p| p.confidence),
        is_correct: pose.map_or(last.is_correct, |p| is_correct(Some(p.rotation))),
        is_ball: truth.is_some(),
    })
}

/// The answers to images of a kind, in their order; `None` where no dots were identified.
fn answers(
    estimator: &Estimator,
    sources: &Sources,
    kind: Kind,
    images: std::ops::Range<u64>,
    seed: u64,
) -> Result<Vec<Option<Answer>>> {
    images
        .into_par_iter()
        .map(|k| {
            let (image, truth) = sources.image(kind, seed, k)?;
            Ok(answer(estimator, &image, truth))
        })
        .collect()
}

#[derive(clap::Args)]
pub struct Args {
    /// Images of a kind.
    #[arg(long, default_value_t = 3_000)]
    images: u64,
    /// Seed of the images.
    #[arg(long, default_value_t = crate::TRUST_SEED)]
    seed: u64,
    /// The design of the table.
    #[arg(long, default_value = OWN)]
    design: String,
    /// Folder of photographs that show no ball.
    #[arg(long)]
    photographs: Option<PathBuf>,
    /// Beginnings of the kinds' names; all kinds by default.
    kinds: Vec<String>,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (images, seed, own) = (self.images, self.seed, &self.design);
        let sources = Sources::new(own, self.photographs.as_deref())?;
        let estimator = estimator(&sources.own)?;
        println!("{images} images a kind, seed {seed}, table of {own}");
        let headings = [
            "images",
            "answered",
            "above 0.9",
            "above 0.99",
            "of the answers right",
        ];
        let table = Table::new(headings);
        for (name, kind) in kinds() {
            let is_wanted = self.kinds.is_empty() || self.kinds.iter().any(|w| name.starts_with(w));
            if !is_wanted || (kind == Kind::Photograph && sources.photographs.is_empty()) {
                continue;
            }
            let found = answers(&estimator, &sources, kind, 0..images, seed)?;
            let confidence = |a: &Option<Answer>| a.as_ref().and_then(|a| a.confidence);
            let above = [0.0, 0.9, 0.99]
                .map(|limit| share(&found, |a| confidence(a).is_some_and(|p| p > limit)));
            let answered = found.iter().flatten().filter(|a| a.confidence.is_some());
            let answered: Vec<&Answer> = answered.collect();
            let right = (kind == Kind::Ball).then(|| share(&answered, |a| a.is_correct));
            row!(table; name; above; [right]);
        }
        Ok(())
    }
}

/// Edges of the bins in which claims are compared with the truth.
const EDGES: [f64; 6] = [0.2, 0.5, 0.7, 0.9, 0.99, 0.999];
/// Least probability of the recognizer for poses of detections that the map is fitted on.
const MIN_CONFIDENCE: f64 = 0.2;
/// The plausible poses of images of which every second shows the ball, for balls of few and of many dots, estimated
/// with a map of confidences: what is in doubt is re-examined, and the map decides what is. Accepted poses and
/// rejected ones both count.
pub fn fitting_answers(trust: TrustMap, images: u64, seed: u64) -> Result<Vec<Judged>> {
    let config = EstimatorConfig {
        trust,
        ..EstimatorConfig::default()
    };
    let all = FITTED.map(|own| mixture(own, config, images, seed));
    let all: Vec<Answer> = all.into_iter().collect::<Result<Vec<_>>>()?.concat();
    let both = |a: Answer| {
        let last = Judged {
            evidence: a.evidence,
            is_correct: a.is_correct,
        };
        a.earlier.into_iter().chain([last])
    };
    let is_plausible =
        |a: &Judged| !a.evidence.is_of_detections() || a.evidence.confidence >= MIN_CONFIDENCE;
    Ok(all
        .into_iter()
        .flat_map(both)
        .filter(is_plausible)
        .collect())
}

/// Compares the claims of the shipped map with the truth, on images that it was not fitted on.
#[derive(clap::Args)]
pub struct ConfidenceArgs {
    /// Images for each of the designs.
    #[arg(long, default_value_t = 12_000)]
    images: u64,
    /// Seed of the images.
    #[arg(long, default_value_t = crate::TRUST_SEED)]
    seed: u64,
}

impl ConfidenceArgs {
    pub fn run(&self) -> Outcome {
        let (images, seed, shipped) = (self.images, self.seed, EstimatorConfig::default());
        println!(
            "{images} images for each of {}, seed {seed}",
            FITTED.join(", ")
        );
        let table = Table::new(["images", "claimed", "poses", "mean claim", "right"]);
        let print = |label: &str, shown: &[&Answer]| {
            let claims = shown.iter().map(|a| Claim {
                confidence: shipped.trust.probability(&a.evidence),
                is_right: a.is_correct,
            });
            let claims: Vec<Claim> = claims.collect();
            for bin in bins(&EDGES) {
                let (mean, right) = claimed(&claims, bin);
                if right.trials == 0 {
                    continue;
                }
                let mean = figure(100.0 * mean, 2, "%");
                row!(table; label, bin.named(""), right.trials, mean, right);
            }
        };
        let mut all = Vec::new();
        for own in FITTED {
            let shown = mixture(own, shipped, images, seed)?;
            print(own, &shown.iter().collect::<Vec<_>>());
            all.extend(shown);
        }
        print("all", &all.iter().collect::<Vec<_>>());
        let balls: Vec<&Answer> = all.iter().filter(|a| a.is_ball).collect();
        print("images of the ball alone", &balls);
        Ok(())
    }
}

/// The best poses of images of which every second shows the ball.
fn mixture(own: &str, config: EstimatorConfig, images: u64, seed: u64) -> Result<Vec<Answer>> {
    let sources = Sources::new(own, None)?;
    let detector = DetectorName::Cnn.build()?;
    let estimator = Estimator::new(&sources.own, config, detector)?;
    let mut others: Vec<Kind> = kinds().into_iter().map(|(_, kind)| kind).collect();
    others.retain(|k| !matches!(k, Kind::Ball | Kind::Photograph));
    let each = (images / 2).div_ceil(others.len() as u64);
    let balls = 0..each * others.len() as u64;
    let mut all = answers(&estimator, &sources, Kind::Ball, balls, seed)?;
    for &kind in &others {
        all.extend(answers(&estimator, &sources, kind, 0..each, seed)?);
    }
    Ok(all.into_iter().flatten().collect())
}
