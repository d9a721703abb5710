//! The sets of dots that views show.

use crate::geometry::Vec3;

/// A dot this little below the limit counts as visible: sets are never too small.
const ROUNDING: f64 = 1e-9;

/// The largest sets of dots that are visible together, dot `i` as bit `i`.
///
/// The circles on which a dot is at the visibility limit cut the sphere of viewing directions into
/// regions. In one region the same dots are visible. Its corners, where two circles meet, show all of
/// them; so does a point of each circle where there is no corner.
#[derive(Debug, Clone)]
pub(super) struct VisibleSets {
    sets: Vec<u64>,
}

impl VisibleSets {
    pub fn new(dots: &[Vec3], limit: f64) -> Self {
        let mut views = Vec::new();
        for (i, a) in dots.iter().enumerate() {
            // Straight above a dot, and one point of its circle.
            let helper = if a.x.abs() < 0.6 {
                Vec3::x()
            } else {
                Vec3::y()
            };
            let side = a.cross(&helper).normalize();
            views.push(*a);
            views.push(a * limit + side * (1.0 - limit * limit).max(0.0).sqrt());
            for b in &dots[..i] {
                // v = s (a + b) +- t a x b with a.v = b.v = limit.
                let s = limit / (1.0 + a.dot(b)).max(1e-12);
                let normal = a.cross(b);
                let rest = 1.0 - s * s * (a + b).norm_squared();
                if rest >= 0.0 && normal.norm_squared() > 1e-18 {
                    let t = (rest / normal.norm_squared()).sqrt();
                    views.push(s * (a + b) + t * normal);
                    views.push(s * (a + b) - t * normal);
                }
            }
        }
        let mut sets: Vec<u64> = views
            .iter()
            .map(|v| {
                dots.iter().enumerate().fold(0, |bits, (i, d)| {
                    bits | u64::from(d.dot(v) >= limit - ROUNDING) << i
                })
            })
            .collect();
        // The largest first, so that each is compared with those that may hold it.
        sets.sort_unstable_by_key(|s| (std::cmp::Reverse(s.count_ones()), *s));
        sets.dedup();
        let mut largest: Vec<u64> = Vec::new();
        for set in sets {
            if !largest.iter().any(|l| l & set == set) {
                largest.push(set);
            }
        }
        Self { sets: largest }
    }

    /// The sets, none part of another.
    pub fn sets(&self) -> &[u64] {
        &self.sets
    }

    /// Dots that a view shows at most.
    pub fn max_count(&self) -> usize {
        self.sets
            .iter()
            .map(|s| s.count_ones() as usize)
            .max()
            .unwrap_or(0)
    }
}
