//! Verdicts over clips: the right table, a wrong one, a mirrored ball, one of several tables.

use std::path::PathBuf;

use rayon::prelude::*;
use spindoe::clip::verdict::{
    BallHypothesis, FrameScore, Scorer, Verdict, decide, mirrored_pattern,
};
use spindoe::pattern::Pattern;
use spindoe::stats::Proportion;
use spindoe::synth::dataset::{SynthFrame, independent_frame};
use spindoe::vision::Estimator;
use spindoe_studies::frames::{alone, estimator, good_conditions, name_of};
use spindoe_studies::score::share;
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// The designs.
pub const DESIGNS: [&str; 5] = ["dots12", "dots16", "dots20", "dots24", "dots32"];
/// The ball in the images: the design of this number, and the patterns that are given.
const BALL: usize = 2;

/// Scores of a frame: by table, directly and mirrored.
type Scores = Vec<[FrameScore; 2]>;

struct CandidateTable {
    name: String,
    /// Directly and mirrored.
    estimators: [Estimator; 2],
}

impl CandidateTable {
    fn read(path: PathBuf) -> spindoe::Result<Self> {
        let pattern = Pattern::read_csv(&path)?;
        let direct = estimator(&pattern)?;
        let mirrored = direct.for_pattern(&mirrored_pattern(&pattern)?)?;
        Ok(Self {
            name: name_of(&path),
            estimators: [direct, mirrored],
        })
    }
}

/// Frames of a ball, each in conditions of its own, scored under all hypotheses.
fn scored(
    tables: &[CandidateTable],
    ball: usize,
    frames: u64,
    seed: u64,
) -> spindoe::Result<Vec<Scores>> {
    let own = &tables[ball].estimators[0];
    let set = good_conditions();
    let one = |k: u64| {
        let SynthFrame { image, .. } =
            independent_frame(own.pattern(), &set.config, seed, k as usize)?;
        let seen = alone(own, &image, &mut own.workspace());
        let scores = tables.iter().map(|table| {
            let [direct, mirrored] = &table.estimators;
            let score = |e| Ok::<_, spindoe::Error>(Scorer::new(e)?.identify(&mut seen.clone()));
            Ok([score(direct)?, score(mirrored)?])
        });
        scores.collect()
    };
    (0..frames).into_par_iter().map(one).collect()
}

/// The verdict on a clip under some of the hypotheses: tables, and which of the two directions is
/// the true one (exchanged, the images are mirrored).
fn verdict(clip: &[Scores], tables: &[usize], is_flipped: bool) -> (Verdict, Vec<BallHypothesis>) {
    let mut hypotheses = Vec::new();
    for &table in tables {
        for direction in 0..2 {
            hypotheses.push(BallHypothesis {
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

#[derive(clap::Args)]
pub struct Args {
    /// Frames.
    #[arg(long, default_value_t = 1_000)]
    frames: u64,
    /// Seed of the frames.
    #[arg(long, default_value_t = crate::TRUST_SEED)]
    seed: u64,
    /// Patterns beside five of the designs.
    #[arg(value_name = "PATTERN.csv")]
    patterns: Vec<PathBuf>,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (frames, seed) = (self.frames, self.seed);
        let designs = DESIGNS.map(|d| PathBuf::from(format!("designs/{d}/pattern.csv")));
        let paths = designs.into_iter().chain(self.patterns.iter().cloned());
        let tables: Vec<_> = paths
            .map(CandidateTable::read)
            .collect::<spindoe::Result<_>>()?;
        println!(
            "{frames} frames a ball in good conditions, each its own, seed {seed}; no motion helps"
        );
        let table = Table::new(["ball", "frames a clip", "what is asked", "share of clips"]);
        for ball in [BALL].into_iter().chain(DESIGNS.len()..tables.len()) {
            let all = scored(&tables, ball, frames, seed)?;
            for length in [5, 10] {
                let clips: Vec<&[Scores]> = all.chunks_exact(length).collect();
                let fits = |clip: &[Scores], tables: &[usize], flipped: bool| {
                    let (verdict, hypotheses) = verdict(clip, tables, flipped);
                    matches!(verdict, Verdict::Fits { hypothesis, .. }
                        if hypotheses[hypothesis].table == ball
                            && hypotheses[hypothesis].is_mirrored == flipped)
                };
                let row = |what: &str, p: Proportion| {
                    row!(table; &tables[ball].name, length, what, p);
                };
                row(
                    "the right table: it fits",
                    share(&clips, |c| fits(c, &[ball], false)),
                );
                row(
                    "the right table, mirrored images: named as such",
                    share(&clips, |c| fits(c, &[ball], true)),
                );
                let every: Vec<usize> = (0..tables.len()).collect();
                row(
                    &format!("{} tables: the right one is chosen", tables.len()),
                    share(&clips, |c| fits(c, &every, false)),
                );
                let is_answered = |(table, clip): &(usize, &[Scores])| {
                    let (verdict, hypotheses) = verdict(clip, &[*table], false);
                    match verdict {
                        Verdict::Fits { hypothesis, .. } => !hypotheses[hypothesis].is_mirrored,
                        Verdict::Tied { .. } => true,
                        Verdict::Open => hypotheses[0].answered() > 0,
                        Verdict::None { .. } => false,
                    }
                };
                let wrong = every.into_iter().filter(|&t| t != ball);
                let wrong = wrong.flat_map(|t| clips.iter().map(move |c| (t, *c)));
                row(
                    "a wrong table: some frame keeps its answer",
                    share(&wrong.collect::<Vec<_>>(), is_answered),
                );
            }
        }
        Ok(())
    }
}
