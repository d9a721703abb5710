//! A surface as a flat chart, and the borders of its marks.
//!
//! Rows of the chart are of equal latitude about the surface's z axis, columns of equal longitude (equirectangular); a value is the mean of the
//! places next to it, weighed by `exp(-d^2 / (2 s^2))` with their distances `d` and `s` = [`WIDTH`]. The borders between dark and light lie where the
//! chart crosses the value that separates both best: that of the largest variance between the two classes (N. Otsu, "A threshold selection
//! method from gray-level histograms", IEEE Trans. SMC 9, 1979). They are found by marching squares.
//!
//! Guaranteed: no value and no border where less than half of what lies next to it is known. Not guaranteed: marks of less than 3
//! degrees, and borders of marks as faint as the noise.

use std::f64::consts::{PI, TAU};

use super::surface_map::{PLACES, SurfaceMap};
use crate::concurrency;
use crate::geometry::{Vec3, spiral_directions};

/// Columns and rows.
const SIZE: [usize; 2] = [240, 120];
/// Standard deviation of a place's weight, radians: half of what lies between two places.
const WIDTH: f64 = 0.018;
/// Places farther away do not count, radians.
const REACH: f64 = 3.0 * WIDTH;
/// A value is of so much weight of known places, over that of all.
const KNOWN: f64 = 0.5;

/// A surface by latitude and longitude. The first row is nearest to +z, the first column begins at -x, and columns go about +z by the
/// right-hand rule.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceChart {
    values: Vec<Option<f32>>,
}

impl SurfaceChart {
    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        SIZE
    }

    /// Row by row: the logarithm of the brightness less its mean about the place; `None` where that is not known.
    pub fn values(&self) -> &[Option<f32>] {
        &self.values
    }

    fn of(map: &SurfaceMap) -> Self {
        let places: Vec<Vec3> = spiral_directions(PLACES).collect();
        let rows: Vec<usize> = (0..SIZE[1]).collect();
        let rows = concurrency::map(&rows, |&row| {
            let value =
                |column: usize| value(map, &places, &direction([column as f64, row as f64]));
            (0..SIZE[0]).map(value).collect::<Vec<_>>()
        });
        Self {
            values: rows.into_iter().flatten().collect(),
        }
    }

    /// The pieces of the line on which the chart has this value, each between two directions.
    fn line_at(&self, value: f32) -> Vec<[Vec3; 2]> {
        let mut pieces = Vec::new();
        for row in 0..SIZE[1] - 1 {
            for column in 0..SIZE[0] {
                let corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[x, y]| [column + x, row + y]);
                let above = corners.map(|[x, y]| {
                    let known = self.values[y * SIZE[0] + x % SIZE[0]];
                    known.map(|known| f64::from(known - value))
                });
                if let [Some(a), Some(b), Some(c), Some(d)] = above {
                    cut(corners, [a, b, c, d], &mut pieces);
                }
            }
        }
        pieces
    }
}

/// The pieces of the line of value 0 within a square of the chart, by the values at its corners.
fn cut(corners: [[usize; 2]; 4], values: [f64; 4], pieces: &mut Vec<[Vec3; 2]>) {
    let side = |k: usize| {
        let (next, from) = ((k + 1) % 4, values[k]);
        let to = values[next];
        ((from < 0.0) != (to < 0.0)).then(|| {
            let part = from / (from - to);
            let at = |axis: usize| {
                let [from, to] = [k, next].map(|corner| corners[corner][axis] as f64);
                from + part * (to - from)
            };
            direction([at(0), at(1)])
        })
    };
    match [side(0), side(1), side(2), side(3)] {
        [Some(a), Some(b), Some(c), Some(d)] => {
            // What the middle belongs to is one piece.
            let is_middle_below = values.iter().sum::<f64>() < 0.0;
            match is_middle_below == (values[0] < 0.0) {
                true => pieces.extend([[a, b], [c, d]]),
                false => pieces.extend([[d, a], [b, c]]),
            }
        }
        sides => {
            let mut ends = sides.into_iter().flatten();
            if let (Some(from), Some(to)) = (ends.next(), ends.next()) {
                pieces.push([from, to]);
            }
        }
    }
}

/// The direction at a column and row of the chart, and at parts of them.
fn direction([column, row]: [f64; 2]) -> Vec3 {
    let longitude = TAU * (column + 0.5) / SIZE[0] as f64 - PI;
    let (sin, cos) = (PI * (row + 0.5) / SIZE[1] as f64).sin_cos();
    Vec3::new(sin * longitude.cos(), sin * longitude.sin(), cos)
}

fn value(map: &SurfaceMap, places: &[Vec3], at: &Vec3) -> Option<f32> {
    let (mut sum, mut known, mut all) = (0.0, 0.0, 0.0);
    // The spiral falls evenly in z, and directions differ by no more in z than by their angle.
    let from = places.partition_point(|p| p.z > at.z + REACH);
    let near = places.iter().enumerate().skip(from);
    for (k, place) in near.take_while(|(_, p)| p.z >= at.z - REACH) {
        let squared = (place - at).norm_squared();
        if squared < REACH * REACH {
            let weight = (-0.5 * squared / (WIDTH * WIDTH)).exp();
            all += weight;
            if map.weights[k] > 0.0 {
                known += weight;
                sum += weight * f64::from(map.values[k]);
            }
        }
    }
    (known > 0.0 && known >= KNOWN * all).then(|| (sum / known) as f32)
}

impl SurfaceMap {
    /// The surface by latitude and longitude.
    pub fn chart(&self) -> SurfaceChart {
        SurfaceChart::of(self)
    }

    /// The borders between dark and light, in pieces between two directions; none where nothing is known.
    pub fn borders(&self) -> Vec<[Vec3; 2]> {
        let threshold = self.threshold();
        threshold.map_or_else(Vec::new, |value| self.chart().line_at(value))
    }

    /// The value that separates dark and light best; `None` where all that is known is alike.
    fn threshold(&self) -> Option<f32> {
        let known = self.values.iter().zip(&self.weights);
        let mut values: Vec<f32> = known.filter(|(_, w)| **w > 0.0).map(|(v, _)| *v).collect();
        values.sort_unstable_by(f32::total_cmp);
        let total: f64 = values.iter().map(|v| f64::from(*v)).sum();
        let (mut below, mut best) = (0.0, None);
        let mut most = 0.0;
        for (k, pair) in values.windows(2).enumerate() {
            below += f64::from(pair[0]);
            let (dark, light) = ((k + 1) as f64, (values.len() - k - 1) as f64);
            let variance = dark * light * (below / dark - (total - below) / light).powi(2);
            if pair[0] < pair[1] && variance > most {
                (most, best) = (variance, Some(0.5 * (pair[0] + pair[1])));
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dark within 0.5 of +x and within 0.3 of +z, and unknown below z = -0.5.
    fn two_marks() -> SurfaceMap {
        let mut map = SurfaceMap::unknown();
        for (k, place) in spiral_directions(PLACES).enumerate() {
            let is_dark = place.x > 0.5f64.cos() || place.z > 0.3f64.cos();
            map.values[k] = if is_dark { -0.4 } else { 0.1 };
            map.weights[k] = if place.z > -0.5 { 1.0 } else { 0.0 };
        }
        map
    }

    #[test]
    fn borders_are_the_marks_rims_all_around() {
        let pieces = two_marks().borders();
        let mut lengths = [0.0; 2];
        for piece in &pieces {
            let middle = 0.5 * (piece[0] + piece[1]);
            let off = [middle.x.acos() - 0.5, middle.z.acos() - 0.3];
            let nearest = if off[0].abs() < off[1].abs() { 0 } else { 1 };
            // Places lie 0.035 apart.
            assert!(off[nearest].abs() < 0.035, "{middle:?}");
            lengths[nearest] += (piece[1] - piece[0]).norm();
        }
        for (length, reach) in lengths.iter().zip([0.5f64, 0.3]) {
            let around = TAU * reach.sin();
            assert!((length / around - 1.0).abs() < 0.15, "{length} {around}");
        }
    }

    #[test]
    fn a_chart_has_what_is_known() {
        let chart = two_marks().chart();
        let [width, height] = chart.size();
        assert_eq!(chart.values().len(), width * height);
        for (k, value) in chart.values().iter().enumerate() {
            let at = direction([(k % width) as f64, (k / width) as f64]);
            match value {
                Some(value) if at.x > 0.4f64.cos() => assert!((value + 0.4).abs() < 1e-3),
                // Known as far as half of what lies about a place is.
                Some(_) => assert!(at.z > -0.525, "{at:?}"),
                None => assert!(at.z < -0.475, "{at:?}"),
            }
        }
        assert!(SurfaceMap::unknown().borders().is_empty());
    }
}
