//! Dots that are taken for others where views are not identified.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use crate::concurrency;
use crate::geometry::rotation_angle;
use crate::recognize::robust::RobustRecognizer;
use crate::recognize::{ORIENTATION_FAILURE_RAD, Recognizer};
use crate::validate::Trials;
use crate::view::Trial;

/// Lookalikes are named where they are in this share of the views that are not identified, and in so many of them: of 60
/// random patterns of 8 to 20 dots (2 000 views of protocol `clutter` each), 3 have such a pair of dots.
const SHARE: f64 = 0.2;
const MIN_VIEWS: usize = 8;
/// Dots belong together that are in this share of the views of the pair that is found most.
const TOGETHER: f64 = 0.5;
/// Maximum number of sets that are named.
const MAX_SETS: usize = 3;

/// Dots that are taken for others, all in the same turn of the pattern.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lookalike {
    /// The dots.
    pub dots: Vec<u16>,
    /// What each of them is taken for; or they for it.
    pub like: Vec<u16>,
    /// Views in which that is so, of those that are not right.
    pub views: usize,
    /// Views that are not right and have another explanation.
    pub of: usize,
}

/// Which dots are taken for which in a view.
type Taken = Vec<(u16, u16)>;

/// The lookalikes of the failed trials.
pub(super) fn lookalikes(
    trials: &Trials<'_>,
    recognizer: &RobustRecognizer,
    failed: &[u64],
) -> Vec<Lookalike> {
    let range = 0..failed.len() as u64;
    let taken = concurrency::map_range(range, |k| taken(trials, recognizer, failed[k as usize]));
    let mut views: Vec<Taken> = taken
        .into_iter()
        .filter(|pairs| !pairs.is_empty())
        .collect();
    let of = views.len();
    let enough = (SHARE * of as f64).ceil() as usize;
    let mut found = Vec::new();
    while found.len() < MAX_SETS {
        let Some((pair, count)) = most_frequent(views.iter()) else {
            break;
        };
        if count < enough.max(MIN_VIEWS) {
            break;
        }
        let (these, others): (Vec<Taken>, Vec<Taken>) = views
            .into_iter()
            .partition(|view| turned(view, pair).is_some());
        views = others;
        found.push(named(&these, pair, of));
    }
    found
}

/// What is taken for what by the most probable explanation with another orientation; nothing where there is none.
fn taken(trials: &Trials<'_>, recognizer: &RobustRecognizer, index: u64) -> Taken {
    let mut trial = Trial::default();
    trials.generator().generate(index, &mut trial);
    let mut workspace = recognizer.workspace();
    let Ok(found) = recognizer.explain(&trial.dots, None, &mut workspace) else {
        return Taken::new();
    };
    let mut all = std::iter::once(found.best()).chain(found.rivals());
    let other =
        all.find(|e| rotation_angle(&e.rotation, &trial.rotation) >= ORIENTATION_FAILURE_RAD);
    let Some(other) = other else {
        return Taken::new();
    };
    let pairs = trial.truth.iter().zip(&other.assignment);
    let pairs = pairs.filter_map(|(is, like)| Some(((*is)?, (*like)?)));
    pairs.filter(|(is, like)| is != like).collect()
}

/// The pair of dots that most views take for one another, with their number; of several the one of smallest numbers.
fn most_frequent<'a>(views: impl Iterator<Item = &'a Taken>) -> Option<((u16, u16), usize)> {
    let mut counts: HashMap<(u16, u16), usize> = HashMap::new();
    for view in views {
        let mut pairs: Taken = view.iter().map(|&(a, b)| (a.min(b), a.max(b))).collect();
        pairs.sort_unstable();
        pairs.dedup();
        for pair in pairs {
            *counts.entry(pair).or_default() += 1;
        }
    }
    let counts = counts.into_iter();
    counts.max_by(|(a, n), (b, m)| n.cmp(m).then(b.cmp(a)))
}

/// What is taken for what in a view, so that `pair` is among it; none where it is not, nor the other way round.
fn turned(view: &Taken, pair: (u16, u16)) -> Option<Taken> {
    let back: Taken = view.iter().map(|&(a, b)| (b, a)).collect();
    [view.clone(), back]
        .into_iter()
        .find(|pairs| pairs.contains(&pair))
}

/// The set of dots that the views of a pair have in common.
fn named(views: &[Taken], pair: (u16, u16), of: usize) -> Lookalike {
    let mut counts: HashMap<(u16, u16), usize> = HashMap::new();
    for pairs in views.iter().filter_map(|view| turned(view, pair)) {
        for pair in pairs {
            *counts.entry(pair).or_default() += 1;
        }
    }
    let enough = TOGETHER * views.len() as f64;
    let mut pairs: Taken = counts
        .into_iter()
        .filter(|(_, count)| *count as f64 >= enough)
        .map(|(pair, _)| pair)
        .collect();
    pairs.sort_unstable();
    // A half turn takes each of two dots for the other: said once.
    let both = pairs.clone();
    pairs.retain(|&(a, b)| a < b || !both.contains(&(b, a)));
    Lookalike {
        dots: pairs.iter().map(|p| p.0).collect(),
        like: pairs.iter().map(|p| p.1).collect(),
        views: views.len(),
        of,
    }
}
