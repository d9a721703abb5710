//! Verdicts over clips: the right table, a wrong one, a mirrored ball, one of several tables.

use rayon::prelude::*;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::independent_frame;
use spindoe::validate::Proportion;
use spindoe::vision::verdict::{FrameScore, Hypothesis, Scorer, Verdict, decide, mirrored_pattern};
use spindoe::vision::{
    Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, NamedDetector, Prior,
};

/// The designs.
pub const DESIGNS: [&str; 5] = ["dots12", "dots16", "dots20", "dots24", "dots32"];
/// The published pattern, where it is here.
pub const PUBLISHED: &str = "../shared/data/spindoe2023/ref_pattern.csv";
/// The ball in the images: the design of this number, and the published pattern.
const BALL: usize = 2;

/// Scores of a frame: by table, directly and mirrored.
type Scores = Vec<[FrameScore; 2]>;

struct Table {
    name: String,
    /// Directly and mirrored.
    estimators: [Estimator<NamedDetector>; 2],
}

fn tables() -> spindoe::Result<Vec<Table>> {
    let mut paths: Vec<(String, String)> = DESIGNS
        .map(|d| (d.to_owned(), format!("designs/{d}/pattern.csv")))
        .into();
    if std::path::Path::new(PUBLISHED).exists() {
        paths.push(("published".into(), PUBLISHED.into()));
    }
    let detector = DetectorName::Cnn.build()?;
    let table = |(name, path): (String, String)| {
        let pattern = Pattern::read_csv(path.as_ref())?;
        let config = EstimatorConfig::default();
        let direct = Estimator::new(&pattern, config, detector.clone())?;
        let mirrored = direct.for_pattern(&mirrored_pattern(&pattern)?)?;
        Ok(Table {
            name,
            estimators: [direct, mirrored],
        })
    };
    paths.into_iter().map(table).collect()
}

/// Frames of a ball, each in conditions of its own, scored under all hypotheses.
fn scored(tables: &[Table], ball: usize, frames: u64, seed: u64) -> spindoe::Result<Vec<Scores>> {
    let own = &tables[ball].estimators[0];
    let config = SynthConfig::good();
    (0..frames)
        .into_par_iter()
        .map(|k| {
            let frame = independent_frame(own.pattern(), &config, seed, k as usize)?;
            let mut seen = FrameEstimate::default();
            own.estimate(
                &frame.image,
                &Prior::default(),
                &Budget::default(),
                &mut own.workspace(),
                &mut seen,
            );
            tables
                .iter()
                .map(|table| {
                    let [direct, mirrored] = &table.estimators;
                    let score =
                        |e| Ok::<_, spindoe::Error>(Scorer::new(e)?.identify(&mut seen.clone()));
                    Ok([score(direct)?, score(mirrored)?])
                })
                .collect()
        })
        .collect()
}

/// The verdict on a clip under some of the hypotheses: tables, and which of the two directions is
/// the true one (exchanged, the images are mirrored).
fn verdict(clip: &[Scores], tables: &[usize], is_flipped: bool) -> (Verdict, Vec<Hypothesis>) {
    let mut hypotheses = Vec::new();
    for &table in tables {
        for direction in 0..2 {
            hypotheses.push(Hypothesis {
                table,
                is_mirrored: direction == 1,
                frames: clip
                    .iter()
                    .map(|f| f[table][direction ^ usize::from(is_flipped)])
                    .collect(),
                has_common_motion: false,
            });
        }
    }
    (decide(&hypotheses), hypotheses)
}

fn count(clips: &[&[Scores]], of: impl Fn(&[Scores]) -> bool) -> Proportion {
    let n = clips.iter().filter(|c| of(c)).count();
    Proportion::new(n as u64, clips.len() as u64)
}

pub fn print(frames: u64, seed: u64) -> spindoe::Result<()> {
    let tables = tables()?;
    println!(
        "{frames} frames a ball in good conditions, each its own, seed {seed}; no motion helps\n"
    );
    println!("| ball | frames a clip | what is asked | share |\n|---|---|---|---|");
    let mut balls = vec![BALL];
    balls.extend((tables.len() > DESIGNS.len()).then_some(DESIGNS.len()));
    for ball in balls {
        let all = scored(&tables, ball, frames, seed)?;
        let name = &tables[ball].name;
        for length in [5, 10] {
            let clips: Vec<&[Scores]> = all.chunks_exact(length).collect();
            let fits = |clip: &[Scores], tables: &[usize], flipped: bool, mirrored: bool| {
                let (verdict, hypotheses) = verdict(clip, tables, flipped);
                matches!(verdict, Verdict::Fits { hypothesis, .. }
                    if hypotheses[hypothesis].table == ball
                        && hypotheses[hypothesis].is_mirrored == mirrored)
            };
            let row = |what: &str, p: Proportion| println!("| {name} | {length} | {what} | {p} |");
            row(
                "the right table: it fits",
                count(&clips, |c| fits(c, &[ball], false, false)),
            );
            row(
                "the right table, flipped images: mirrored",
                count(&clips, |c| fits(c, &[ball], true, true)),
            );
            let every: Vec<usize> = (0..tables.len()).collect();
            row(
                &format!("{} tables: the right one is chosen", tables.len()),
                count(&clips, |c| fits(c, &every, false, false)),
            );
            let wrong = every.iter().filter(|&&t| t != ball);
            let mut accepted = (0, 0);
            for &table in wrong {
                let answered = |c: &[Scores]| {
                    let (verdict, hypotheses) = verdict(c, &[table], false);
                    match verdict {
                        Verdict::Fits { hypothesis, .. } => !hypotheses[hypothesis].is_mirrored,
                        Verdict::Tied { .. } => true,
                        Verdict::Open => hypotheses[0].answered() > 0,
                        Verdict::None { .. } => false,
                    }
                };
                let p = count(&clips, answered);
                accepted = (accepted.0 + p.successes, accepted.1 + p.trials);
            }
            row(
                "a wrong table: some frame keeps its answer",
                Proportion::new(accepted.0, accepted.1),
            );
        }
    }
    Ok(())
}
