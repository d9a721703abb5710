//! The robust recogniser: the rotation that the whole set of dots supports best.
//!
//! # Search
//! Pairs of observed dots, the best conditioned first, are laid on every ordered pair of pattern dots of
//! similar angle. Each such rotation is screened; what comes near the best is refined by
//! Gauss-Newton on its inliers and scored by the full model ([`RobustConfig`] holds its parameters). A
//! pass over one pair has seen every explanation in which both of its dots are real. The pairs are
//! disjoint as long as that is possible: an explanation that `k` such passes have not seen leaves out
//! `k` dots at least, and that bounds its worth. The search stops when the best explanation so far is
//! beyond doubt, or when what has not been seen cannot be better.
//!
//! # Confidence
//! The best explanation's share of the evidence of all that were found, of their near alternatives, and
//! of "these are not the pattern's dots".
//!
//! What it does not do: prove that no better explanation exists. See the validation for how often the
//! best one found is the right one.

mod config;
mod model;
mod pairs;
mod posterior;
mod refine;
mod screen;

pub use config::{NoiseShape, RobustConfig};

use nalgebra::Rotation3;

use super::{Identification, ObservedDot, Recogniser, Refusal};
use crate::error::Result;
use crate::geometry::{Rotation, Vec3, angle_between};
use crate::pattern::Pattern;
use model::{Dot, Model};
use pairs::{PatternPairs, frame};
use posterior::{Explanation, Foreign, Found};
use refine::{Refined, Refiner, UNASSIGNED};
use screen::{Screen, ScreenModel};

/// Fewest dots that can be identified without a hint.
const MIN_DOTS: usize = 3;
/// Pairs nearer to parallel or opposite than this sine leave the rotation too uncertain to start from.
const LEAST_SINE: f64 = 0.15;
/// Nats by which the best explanation must lead every rival and "foreign" to end the search early.
const DOUBT: f64 = 9.0;
/// Hypotheses refined in a row without coming near the best before a pass ends.
const PATIENCE: usize = 4;
/// Nats that a refinement hardly ever adds to the screening's score, less [`DOUBT`].
const HOPELESS: f64 = 16.0;
/// Nats by which the best explanation must exceed what the unseen ones can reach at most.
const UNSEEN: f64 = 4.0;
/// Observed dots that a new workspace has room for; more of them make it grow.
const ROOM: usize = 64;

/// Scratch memory of [`RobustRecogniser`].
#[derive(Debug, Default)]
pub struct RobustWorkspace {
    dots: Vec<Dot>,
    pairs: Vec<ObservedPair>,
    used: Vec<bool>,
    screen: Screen,
    refiner: Refiner,
    found: Found,
}

/// A pair of observed dots.
#[derive(Debug, Clone, Copy)]
struct ObservedPair {
    /// How well it conditions the rotation.
    quality: f64,
    dots: [u16; 2],
}

/// The default recogniser. See the module's documentation.
#[derive(Debug, Clone)]
pub struct RobustRecogniser {
    dots: Vec<Vec3>,
    pairs: PatternPairs,
    model: Model,
    screen: ScreenModel,
    foreign: Foreign,
    config: RobustConfig,
}

impl RobustRecogniser {
    /// Prepares the recogniser for a pattern.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a parameter outside its domain.
    pub fn new(pattern: &Pattern, config: RobustConfig) -> Result<Self> {
        config.check()?;
        let dots = pattern.dots().to_vec();
        let pairs = PatternPairs::new(&dots);
        let model = Model::new(&config);
        Ok(Self {
            screen: ScreenModel::new(&config, &model, dots.len(), &pairs),
            foreign: Foreign::new(&config, dots.len()),
            dots,
            pairs,
            model,
            config,
        })
    }

    /// The parameters in use.
    pub fn config(&self) -> &RobustConfig {
        &self.config
    }

    /// Prepares the dots and their pairs.
    fn prepare(
        &self,
        dots: &[ObservedDot],
        ws: &mut RobustWorkspace,
    ) -> std::result::Result<(), Refusal> {
        ws.found.clear(dots.len());
        ws.dots.clear();
        for dot in dots {
            ws.dots
                .push(self.model.prepare(dot).ok_or(Refusal::Degenerate)?);
        }
        ws.pairs.clear();
        for (i, a) in ws.dots.iter().enumerate() {
            for (j, b) in ws.dots[..i].iter().enumerate() {
                let sine2 = 1.0 - a.direction.dot(&b.direction).powi(2);
                if sine2 > LEAST_SINE * LEAST_SINE {
                    ws.pairs.push(ObservedPair {
                        quality: sine2 / (a.sigma_max + b.sigma_max).powi(2),
                        dots: [i as u16, j as u16],
                    });
                }
            }
        }
        ws.used.clear();
        ws.used.resize(dots.len(), false);
        if ws.pairs.is_empty() {
            return Err(Refusal::Degenerate);
        }
        Ok(())
    }

    /// Lays one observed pair on every similar pattern pair and refines what comes near the best.
    fn pass(&self, [a, b]: [usize; 2], ws: &mut RobustWorkspace) {
        let done = ws.screen.run(&self.screen, &self.pairs, &ws.dots, (a, b));
        if done.is_none() {
            return;
        }
        let observed = frame(&ws.dots[a].direction, &ws.dots[b].direction);
        let mut fruitless = 0;
        for k in 0..ws.screen.kept().len() {
            let best = ws.found.best().map(|e| e.refined);
            let hypothesis = ws.screen.kept()[k];
            let behind = |r: &Refined| r.ln_evidence - r.ln_volume - f64::from(hypothesis.score);
            if fruitless == PATIENCE || best.is_some_and(|b| behind(&b) > HOPELESS) {
                break;
            }
            let pair = self.pairs.pair(hypothesis.pair as usize);
            let [p, q] = [pair.first, pair.second].map(|d| &self.dots[usize::from(d)]);
            let start = observed * frame(p, q).transpose();
            let least = best.map_or(f64::NEG_INFINITY, |b| b.ln_evidence - DOUBT);
            let view = refine::View {
                model: &self.model,
                pattern: &self.dots,
                dots: &ws.dots,
            };
            let refined = ws.refiner.refine(&view, &start, least);
            fruitless += 1;
            if let Some(refined) = refined {
                if refined.ln_evidence > least {
                    fruitless = 0;
                }
                ws.found.add(refined, ws.refiner.assignment());
            }
        }
    }

    /// Whether the search may end after a pass over the pair. `unseen` bounds the log-likelihood ratio
    /// of what no pass has seen, but for the share of rotations.
    fn settled(&self, [a, b]: [usize; 2], unseen: f64, ws: &RobustWorkspace) -> bool {
        let Some(best) = ws.found.best() else {
            return false;
        };
        let evidence = best.refined.ln_evidence;
        if evidence > unseen + UNSEEN {
            return true;
        }
        let assignment = ws.found.assignment(best);
        let explains_pair = assignment[a] != UNASSIGNED && assignment[b] != UNASSIGNED;
        let rival = ws
            .found
            .best_rival(best)
            .max(self.foreign.ln_evidence(ws.dots.len()));
        explains_pair && evidence - rival > DOUBT
    }

    /// Runs passes until the best explanation is settled.
    fn search(&self, ws: &mut RobustWorkspace) {
        // The best conceivable explanation matches every dot perfectly.
        let mut unseen: f64 = ws.dots.iter().map(|d| d.most).sum();
        for _ in 0..self.config.passes {
            let Some((pair, disjoint)) = next_pair(ws) else {
                return;
            };
            self.pass(pair, ws);
            if disjoint {
                unseen -= ws.dots[pair[0]].most.min(ws.dots[pair[1]].most);
            }
            if self.settled(pair, unseen + self.least_volume(ws), ws) {
                return;
            }
        }
    }

    /// A bound on the share of rotations that an explanation leaves, ln: that of the best one found.
    fn least_volume(&self, ws: &RobustWorkspace) -> f64 {
        ws.found.best().map_or(0.0, |e| e.refined.ln_volume)
    }

    /// Writes an explanation into `out`.
    fn report(&self, explanation: &Explanation, ws: &RobustWorkspace, out: &mut Identification) {
        let confidence = ws.found.confidence(explanation, &self.foreign);
        let rotation = explanation.refined.rotation;
        let (mut squared, mut matched) = (0.0, 0usize);
        out.assignment.clear();
        for (dot, &j) in ws.dots.iter().zip(ws.found.assignment(explanation)) {
            out.assignment.push((j != UNASSIGNED).then_some(j));
            if j != UNASSIGNED {
                let q = rotation * self.dots[usize::from(j)];
                squared += angle_between(&q, &dot.direction).powi(2);
                matched += 1;
            }
        }
        out.rotation = Rotation::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        out.residual_rad = (squared / matched.max(1) as f64).sqrt();
        out.confidence = confidence.identity;
        out.pose_confidence = confidence.pose;
    }
}

impl Recogniser for RobustRecogniser {
    type Workspace = RobustWorkspace;

    fn workspace(&self) -> RobustWorkspace {
        RobustWorkspace {
            dots: Vec::with_capacity(ROOM),
            pairs: Vec::with_capacity(ROOM * ROOM / 2),
            used: Vec::with_capacity(ROOM),
            screen: Screen::with_room(ROOM, self.pairs.row()),
            refiner: Refiner::with_room(ROOM, self.dots.len()),
            found: Found::with_room(ROOM),
        }
    }

    fn min_dots(&self) -> usize {
        MIN_DOTS
    }

    fn identify_into(
        &self,
        dots: &[ObservedDot],
        ws: &mut RobustWorkspace,
        out: &mut Identification,
    ) -> std::result::Result<(), Refusal> {
        if dots.len() < MIN_DOTS {
            return Err(Refusal::TooFewDots {
                found: dots.len(),
                needed: MIN_DOTS,
            });
        }
        self.prepare(dots, ws)?;
        self.search(ws);
        let best = ws.found.best().ok_or(Refusal::NoHypothesis)?;
        self.report(best, ws, out);
        Ok(())
    }
}

/// Takes the best pair left, disjoint from those before it while there is one; whether it is.
fn next_pair(ws: &mut RobustWorkspace) -> Option<([usize; 2], bool)> {
    let best = |disjoint: bool| {
        ws.pairs
            .iter()
            .enumerate()
            .filter(|(_, p)| !disjoint || p.dots.iter().all(|&d| !ws.used[usize::from(d)]))
            .max_by(|a, b| a.1.quality.total_cmp(&b.1.quality))
            .map(|(k, _)| k)
    };
    let (k, disjoint) = match best(true) {
        Some(k) => (k, true),
        None => (best(false)?, false),
    };
    let pair = ws.pairs.swap_remove(k).dots.map(usize::from);
    if disjoint {
        pair.into_iter().for_each(|d| ws.used[d] = true);
    }
    Some((pair, disjoint))
}
