//! How dark the marks of a ball are in its frames, one by one.
//!
//! The surface is the middle of all views: where fingers cover a place in many of them it shows the fingers, and a faint dot is dark in hardly more
//! than half of them, by noise. In a single frame a dot is darker than the ball about it whatever else is in view, while a finger covers both.

use super::map::DotMap;
use super::marks::DarkMark;
use crate::concurrency;
use crate::stats::quantile;
use crate::surface::Darkness;
use crate::surface::{ExpectedDot, PaintedFrame, contrasts};

/// Depth from which a view faces a mark well enough.
const LOOKED_AT: f64 = 0.35;

/// The darkness of a mark over that of what is around it, view by view.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Contrast {
    /// The median.
    pub middle: f64,
    /// Number of views.
    pub views: usize,
}

impl Contrast {
    fn of(mut values: Vec<f64>) -> Self {
        if values.is_empty() {
            return Self::default();
        }
        values.sort_unstable_by(f64::total_cmp);
        Self {
            middle: quantile(&values, 0.5),
            views: values.len(),
        }
    }
}

impl DotMap<'_> {
    /// The contrast of each of these marks.
    pub fn contrasts(
        &self,
        shown: &[PaintedFrame],
        surface: &Darkness,
        marks: &[DarkMark],
    ) -> Vec<Contrast> {
        let frames: Vec<usize> = (0..self.frames.len()).collect();
        let seen = concurrency::map(&frames, |&k| {
            let seen = &self.frames[k];
            let rotation = self.placed[k].as_ref()?.rotation;
            let facing = marks.iter().enumerate();
            let facing = facing.map(|(j, mark)| (j, mark.radius, rotation * mark.direction));
            let facing: Vec<_> = facing
                .filter(|(_, _, at)| seen.depth(at) >= LOOKED_AT)
                .filter(|(_, _, at)| !surface.is_covered(k, &(seen.to_view() * at)))
                .collect();
            let dots: Vec<ExpectedDot> = facing
                .iter()
                .map(|(_, radius, at)| ExpectedDot {
                    direction: seen.to_view() * at,
                    radius: *radius,
                    is_sized: false,
                })
                .collect();
            let values = contrasts(&shown[seen.index], &seen.view(), &dots)?;
            Some(
                facing
                    .into_iter()
                    .map(|f| f.0)
                    .zip(values)
                    .collect::<Vec<_>>(),
            )
        });
        let mut of_marks = vec![Vec::new(); marks.len()];
        for (j, value) in seen.into_iter().flatten().flatten() {
            of_marks[j].push(value);
        }
        of_marks.into_iter().map(Contrast::of).collect()
    }
}
