//! Which places of a map are dots by their looks: see [`crate::calibrate::looks`].

use super::ESTABLISHED;
use super::map::DotMap;
use super::tidy::FACING;
use crate::calibrate::looks::unlike_limit;

/// What is less likely a dot than this share of the middle dot's probability looks unlike the others: a decision, since no limit
/// separates marks from dots (`bench calibration-unknown` counts those missed and invented). Of 751 places
/// on 40 rendered balls this excludes 47 of 54 marks and 11 of 697 dots, most of them on print.
const UNLIKE: f64 = 0.93;

impl DotMap<'_> {
    /// Those of these dots of the map that look like dots, in their order: where their number is known, so
    /// many of the likeliest, else those that look like the others.
    pub fn like_dots(&self, names: &[usize], expected: Option<usize>) -> Vec<usize> {
        let probabilities: Vec<Option<f64>> = names.iter().map(|&j| self.probability(j)).collect();
        let known = || probabilities.iter().flatten().copied();
        let limit = match expected {
            None => unlike_limit(known(), UNLIKE),
            Some(expected) => {
                let mut sorted: Vec<f64> = known().collect();
                let kept = expected.saturating_sub(names.len() - sorted.len());
                sorted.sort_unstable_by(|a, b| b.total_cmp(a));
                sorted.get(kept.max(1) - 1).copied().unwrap_or(0.0)
            }
        };
        let dots = names.iter().zip(&probabilities);
        dots.filter(|(_, p)| p.is_none_or(|p| p >= limit))
            .map(|(j, _)| *j)
            .collect()
    }

    /// The detector's mean probability of a dot at this place of the map, over the views that it faces:
    /// at the limb dots are doubted too. `None` where there are hardly any.
    pub fn probability(&self, j: usize) -> Option<f64> {
        let (mut sum, mut views) = (0.0, 0usize);
        for (frame, placed) in self.frames.iter().zip(&self.placed) {
            let Some(placed) = placed else { continue };
            let dots = &self.estimates[frame.index].dots;
            for (dot, name) in frame.dots.iter().zip(&placed.names) {
                if *name == Some(j) && dot.depth >= FACING {
                    sum += dots[dot.detection].probability;
                    views += 1;
                }
            }
        }
        (views >= ESTABLISHED).then(|| sum / views as f64)
    }
}
