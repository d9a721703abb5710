//! Which places of a map are dots by their looks: see [`crate::calibrate::looks`].

use super::map::Map;
use crate::calibrate::looks::unlike_limit;

/// What is less likely a dot than this share of the middle dot's probability looks unlike the others. Of 751 places
/// on 40 rendered balls this tells 47 of 54 marks and 11 of 697 dots, most of them on print.
const UNLIKE: f64 = 0.93;

impl Map<'_> {
    /// Those of these dots of the map that look like dots, in their order: where their number is known, so
    /// many of the likeliest, else those that look like the others.
    pub fn like_dots(&self, names: &[usize], expected: Option<usize>) -> Vec<usize> {
        let probabilities: Vec<f64> = names.iter().map(|&j| self.probability(j)).collect();
        let mut limit = unlike_limit(probabilities.iter().copied(), UNLIKE);
        if let Some(expected) = expected {
            let mut sorted = probabilities.clone();
            sorted.sort_by(|a, b| b.total_cmp(a));
            limit = sorted.get(expected.saturating_sub(1)).map_or(0.0, |p| *p);
        }
        let dots = names.iter().zip(&probabilities);
        dots.filter(|(_, p)| **p >= limit)
            .map(|(j, _)| *j)
            .collect()
    }

    /// The detector's mean probability of a dot at this place of the map.
    fn probability(&self, j: usize) -> f64 {
        let (mut sum, mut views) = (0.0, 0usize);
        for (frame, placed) in self.frames.iter().zip(&self.placed) {
            let Some(placed) = placed else { continue };
            let dots = &self.estimates[frame.index].dots;
            for (dot, name) in frame.dots.iter().zip(&placed.names) {
                if *name == Some(j) {
                    sum += dots[dot.detection].confidence;
                    views += 1;
                }
            }
        }
        sum / views.max(1) as f64
    }
}
