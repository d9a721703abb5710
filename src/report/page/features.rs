//! The hash features of a design's page: their first two coordinates, and what they say of each dot.

use serde::Serialize;

use crate::ball::Feature;

/// Maximum number of features shown.
const MAX_FEATURES: usize = 4000;
/// Features within this quantile of all are shown.
const SHOWN: f64 = 0.95;

/// Hash features in a page.
#[derive(Debug, Serialize)]
pub(super) struct PageFeatures {
    total: usize,
    shown: usize,
    /// Half the side of the square that is shown.
    reach: f64,
    /// h1, h2, the basis' dots, the feature's dot, and the rank of its distance to the nearest other
    /// feature in [0, 1].
    points: Vec<(f64, f64, u16, u16, u16, f64)>,
}

/// What a dot's features say about it.
#[derive(Debug, Serialize)]
pub(super) struct DotFeatures {
    count: usize,
    /// Smallest and median distance of one of its features to the nearest other feature.
    nearest: f64,
    median: f64,
}

impl PageFeatures {
    /// The features within the range that holds most of them, thinned where there are many.
    pub fn new(features: &[Feature], distances: &[f64]) -> Self {
        let mut order: Vec<usize> = (0..distances.len()).collect();
        order.sort_unstable_by(|a, b| distances[*a].total_cmp(&distances[*b]));
        let mut rank = vec![0.0; distances.len()];
        for (k, i) in order.iter().enumerate() {
            rank[*i] = k as f64 / distances.len().max(1) as f64;
        }
        let extent = |f: &Feature| f.value[0].abs().max(f.value[1].abs());
        let mut extents: Vec<f64> = features.iter().map(extent).collect();
        extents.sort_unstable_by(f64::total_cmp);
        let last = extents.len().saturating_sub(1);
        let reach = extents
            .get((SHOWN * last as f64) as usize)
            .copied()
            .unwrap_or(1.0);
        let step = features.len().div_ceil(MAX_FEATURES).max(1);
        let points: Vec<_> = (0..features.len())
            .step_by(step)
            .filter(|&i| extent(&features[i]) <= reach)
            .map(|i| {
                let Feature { basis, dot, value } = features[i];
                let short = |x: f64| (1e3 * x).round() / 1e3;
                (
                    short(value[0]),
                    short(value[1]),
                    basis.first,
                    basis.second,
                    dot,
                    short(rank[i]),
                )
            })
            .collect();
        Self {
            total: features.len(),
            shown: features.len() / step,
            reach,
            points,
        }
    }
}

/// For each dot how far its features are from the nearest other ones.
pub(super) fn dot_features(
    dots: usize,
    features: &[Feature],
    distances: &[f64],
) -> Vec<DotFeatures> {
    let mut by_dot = vec![Vec::new(); dots];
    for (feature, distance) in features.iter().zip(distances) {
        by_dot[usize::from(feature.dot)].push(*distance);
    }
    by_dot
        .into_iter()
        .map(|mut all| {
            all.sort_unstable_by(f64::total_cmp);
            let at = |k: usize| all.get(k).copied().unwrap_or(f64::NAN);
            DotFeatures {
                count: all.len(),
                nearest: at(0),
                median: at(all.len() / 2),
            }
        })
        .collect()
}
