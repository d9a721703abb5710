//! Places for labels beside marks, so that no label covers a mark or another label.

use std::f64::consts::TAU;

use super::canvas::px;

/// Directions that are tried around a mark.
const DIRECTIONS: usize = 16;
/// Distances from a mark that are tried, and the space between a label and anything else, file pixels.
const DISTANCES: [f64; 3] = [2.0, 7.0, 13.0];
const GAP: f64 = 1.0;

/// What labels keep clear of, and those that are set; drawn pixels.
#[derive(Default)]
pub(super) struct LabelPlaces {
    discs: Vec<((i32, i32), i32)>,
    /// Middles and half sizes.
    labels: Vec<((i32, i32), (i32, i32))>,
}

impl LabelPlaces {
    /// Keeps a mark free.
    pub fn keep(&mut self, center: (i32, i32), radius: i32) {
        self.discs.push((center, radius));
    }

    /// The middle of a free place for a label of this size beside a mark, the nearest to the direction
    /// `preferred` (radians, from the right to the bottom) that is free; none where all are taken.
    pub fn beside(
        &mut self,
        (x, y): (i32, i32),
        radius: i32,
        (width, height): (i32, i32),
        preferred: f64,
    ) -> Option<(i32, i32)> {
        let half = (width / 2, height / 2);
        let turns = (0..DIRECTIONS as i32).map(|k| if k % 2 == 0 { k / 2 } else { -(k + 1) / 2 });
        let tried = DISTANCES.into_iter().flat_map(|distance| {
            turns.clone().map(move |turn| {
                let (sin, cos) = (preferred + TAU * f64::from(turn) / DIRECTIONS as f64).sin_cos();
                let reach = f64::from(half.0) * cos.abs() + f64::from(half.1) * sin.abs();
                let away = f64::from(radius + px(distance)) + reach;
                let at = |from: i32, share: f64| from + (away * share).round() as i32;
                (at(x, cos), at(y, sin))
            })
        });
        let place = tried.into_iter().find(|at| self.is_free(*at, half))?;
        self.labels.push((place, half));
        Some(place)
    }

    fn is_free(&self, at: (i32, i32), half: (i32, i32)) -> bool {
        let gap = px(GAP);
        let off = |((x, y), radius): &((i32, i32), i32)| {
            let dx = f64::from(((x - at.0).abs() - half.0).max(0));
            let dy = f64::from(((y - at.1).abs() - half.1).max(0));
            dx.hypot(dy) >= f64::from(*radius)
        };
        let apart = |((x, y), (w, h)): &((i32, i32), (i32, i32))| {
            (x - at.0).abs() >= w + half.0 + gap || (y - at.1).abs() >= h + half.1 + gap
        };
        self.discs.iter().all(off) && self.labels.iter().all(apart)
    }
}

#[cfg(test)]
mod tests {
    use super::LabelPlaces;

    #[test]
    fn labels_keep_off_marks_and_one_another() {
        let mut places = LabelPlaces::default();
        for k in 0..3 {
            places.keep((30 * k, 0), 10);
        }
        let set: Vec<_> = (0..3)
            .filter_map(|k| places.beside((30 * k, 0), 10, (24, 14), 0.0))
            .collect();
        assert_eq!(set.len(), 3);
        for (i, a) in set.iter().enumerate() {
            assert!((0..3).all(|k| (30 * k - a.0).abs() >= 12 || a.1.abs() >= 7));
            assert!(
                set[..i]
                    .iter()
                    .all(|b| (a.0 - b.0).abs() >= 24 || (a.1 - b.1).abs() >= 14)
            );
        }
        // A mark that is wholly covered gets none.
        places.keep((0, 0), 400);
        assert_eq!(places.beside((0, 0), 10, (24, 14), 0.0), None);
    }
}
