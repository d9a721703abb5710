//! Hash features with a search tree over them (SpinDOE, Alg. 1).

use std::num::NonZeroUsize;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use crate::ball::{Ball, Feature};
use crate::error::{Error, Result};

/// A feature found near a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Position in [`FeatureTree::features`].
    pub index: usize,
    /// Squared Euclidean distance in hash space.
    pub distance_squared: f64,
}

/// The features of a ball, and the nearest of them to any point of hash space.
#[derive(Debug)]
pub struct FeatureTree {
    features: Vec<Feature>,
    tree: ImmutableKdTree<f64, 3>,
}

impl FeatureTree {
    /// The features of the ball's dots under its pair rule.
    ///
    /// # Errors
    /// [`Error::Argument`] where the rule leaves out every pair of the dots.
    pub fn new(ball: &Ball) -> Result<Self> {
        let (rule, dots) = (ball.pair_rule(), ball.pattern().dots());
        let mut features = Vec::with_capacity(rule.count(dots)?);
        features.extend(rule.features(dots));
        let values: Vec<[f64; 3]> = features.iter().map(|f| f.value).collect();
        let tree = ImmutableKdTree::new_from_slice(&values)
            .map_err(|e| Error::Internal(format!("the search tree cannot be built: {e:?}")))?;
        Ok(Self { features, tree })
    }

    /// All features, in the order of [`PairRule::features`](crate::ball::PairRule::features).
    pub fn features(&self) -> &[Feature] {
        &self.features
    }

    /// The `k` features nearest to `value` (all, where there are fewer), nearest first.
    ///
    /// A `value` that is not finite has no neighbors.
    pub fn nearest(&self, value: &[f64; 3], k: NonZeroUsize) -> impl Iterator<Item = Neighbor> {
        let finite = value.iter().all(|x| x.is_finite());
        let found = finite.then(|| {
            self.tree
                .query(value)
                .nearest_n::<SquaredEuclidean<f64>>(k)
                .execute()
        });
        found.into_iter().flatten().map(|item| Neighbor {
            index: item.item as usize,
            distance_squared: item.distance,
        })
    }

    /// Distance from each feature to the nearest other one in hash space, in the features' order.
    pub fn nearest_distances(&self) -> Vec<f64> {
        const TWO: NonZeroUsize = NonZeroUsize::new(2).unwrap();
        self.features
            .iter()
            .map(|f| {
                // The nearest is the feature itself, or one at the same place.
                self.nearest(&f.value, TWO)
                    .map(|n| n.distance_squared.sqrt())
                    .fold(0.0, f64::max)
            })
            .collect()
    }

    /// Mean distance from a feature to the nearest other one in hash space.
    pub fn mean_nearest_distance(&self) -> f64 {
        self.nearest_distances().iter().sum::<f64>() / self.features.len() as f64
    }
}
