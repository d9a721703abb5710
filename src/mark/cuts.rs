//! Cuts between lobes: meridians that go around dots.
//!
//! Cut `k` of `n` lies at the longitude `2 pi k / n`, and lobe `k` between the cuts `k` and `k + 1`. Where
//! a cut would meet the disc of a dot (its radius `r` and a margin) it runs along the disc's edge, on the
//! side of the dot's center that it lies on: at the latitude `phi` the disc about `(lambda0, phi0)`
//! reaches to `lambda0 ± acos((cos r - sin phi sin phi0) / (cos phi cos phi0))`. Discs do not meet, so
//! that a cut pushed off one dot does not run into another, and cuts keep their order.
//!
//! Between a dot and the next cut a lobe may become so narrow that it would tear. There it ends, and its
//! neighbor takes what lies beyond, as far as the pole.
//!
//! Guaranteed: every dot lies whole in one lobe, and the lobes cover the ball once. Not guaranteed: that
//! a lobe reaches both poles.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::geometry::{Vec3, angle_between};

use super::longitude_latitude;

/// Distance of cuts from dots as a part of the ball's radius, and as a part of the gap between the
/// nearest two dots, or a dot and a pole: the smaller counts.
const MARGIN: (f64, f64) = (0.025, 0.45);
/// Latitudes of a cut apart from dots, and those added for each dot.
const FACETS: usize = 180;
const DOT_FACETS: usize = 24;
/// A lobe squeezed by a dot to less than this part of its width, and of the ball's radius, ends there.
const NARROW: (f64, f64) = (0.35, 0.05);

/// The cuts of a ball.
pub(super) struct Cuts {
    /// From pole to pole, radians.
    latitudes: Vec<f64>,
    /// Of each cut at each latitude, radians, near the cut's meridian.
    longitudes: Vec<Vec<f64>>,
}

/// A dot with its margin.
struct CutDisc {
    longitude: f64,
    latitude: f64,
    radius: f64,
}

impl CutDisc {
    /// Half its extent in longitude at a latitude, radians; `None` where it does not reach.
    fn half(&self, latitude: f64) -> Option<f64> {
        if (latitude - self.latitude).abs() >= self.radius {
            return None;
        }
        let (sin, cos) = latitude.sin_cos();
        let (sin0, cos0) = self.latitude.sin_cos();
        let cosine = (self.radius.cos() - sin * sin0) / (cos * cos0);
        (cosine < 1.0).then(|| cosine.max(-1.0).acos())
    }
}

/// What a disc takes of one latitude: the longitude of its middle, and half its extent.
struct TakenDisc {
    longitude: f64,
    half: f64,
}

impl TakenDisc {
    /// A longitude pushed to the end where it lies within, and the side.
    fn push(&self, longitude: f64) -> Option<(f64, CutSide)> {
        let off = (longitude - self.longitude + PI).rem_euclid(TAU) - PI;
        let (edge, side) = match off < 0.0 {
            true => (-self.half, CutSide::West),
            false => (self.half, CutSide::East),
        };
        (off.abs() < self.half).then_some((longitude + edge - off, side))
    }
}

#[derive(Clone, Copy, PartialEq)]
enum CutSide {
    West,
    East,
}

impl Cuts {
    /// The cuts between `lobes` lobes for dots (poles at +z and -z) of the angular radius `edge_rad`,
    /// `None` where a dot lies at a pole.
    pub fn new(dots: &[Vec3], edge_rad: f64, lobes: usize) -> Option<Self> {
        let pairs = (0..dots.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        let gaps = pairs.map(|(i, j)| angle_between(&dots[i], &dots[j]) - 2.0 * edge_rad);
        let poles = dots
            .iter()
            .map(|d| FRAC_PI_2 - longitude_latitude(d).1.abs() - edge_rad);
        let gap = gaps.chain(poles).fold(f64::INFINITY, f64::min);
        if gap <= 0.0 {
            return None;
        }
        let radius = edge_rad + MARGIN.0.min(MARGIN.1 * gap);
        let discs: Vec<CutDisc> = dots
            .iter()
            .map(|d| {
                let (longitude, latitude) = longitude_latitude(d);
                CutDisc {
                    longitude,
                    latitude,
                    radius,
                }
            })
            .collect();
        let latitudes = latitudes(&discs);
        let equator = latitudes.partition_point(|&l| l < 0.0);
        let mut longitudes = vec![vec![0.0; latitudes.len()]; lobes];
        let (south, north) = (0..equator, equator..latitudes.len());
        let mut walk = |order: &mut dyn Iterator<Item = usize>| {
            let mut row = CutRow::new(lobes);
            for j in order {
                let places = row.next(latitudes[j], &discs);
                for (cut, place) in longitudes.iter_mut().zip(places) {
                    cut[j] = place;
                }
            }
        };
        walk(&mut north.into_iter());
        walk(&mut south.rev());
        Some(Self {
            latitudes,
            longitudes,
        })
    }

    /// Longitudes of a lobe's western and eastern cut at the latitude `j`, radians.
    fn sides(&self, lobe: usize, j: usize) -> [f64; 2] {
        let lobes = self.longitudes.len();
        let turn = if lobe + 1 == lobes { TAU } else { 0.0 };
        let east = self.longitudes[(lobe + 1) % lobes][j] + turn;
        [self.longitudes[lobe][j], east]
    }

    /// A lobe's outline as longitude and latitude, counter-clockwise from its lower end.
    pub fn outline(&self, lobe: usize) -> Vec<(f64, f64)> {
        let wide = |j: &usize| {
            let [west, east] = self.sides(lobe, *j);
            east - west > 1e-9
        };
        let last = self.latitudes.len() - 1;
        // The ends, where both cuts meet, are no part of what is wide.
        let from = (1..last).find(wide).unwrap_or(1) - 1;
        let to = (1..last).rev().find(wide).unwrap_or(last - 1) + 1;
        let at = |side: usize| move |j: usize| (self.sides(lobe, j)[side], self.latitudes[j]);
        let up = (from..to).map(at(1));
        let down = (from + 1..=to).rev().map(at(0));
        up.chain(down).collect()
    }

    /// The greatest angle between a lobe's middle meridian and its edge, radians: the lobes are too long
    /// there by one over its cosine.
    pub fn widest_rad(&self) -> f64 {
        let n = self.longitudes.len();
        let step = TAU / n as f64;
        let off = |lobe: usize, j: usize| {
            let middle = step * (lobe as f64 + 0.5);
            let sines = self
                .sides(lobe, j)
                .map(|l| (l - middle).abs().min(FRAC_PI_2).sin());
            (self.latitudes[j].cos() * sines[0].max(sines[1])).asin()
        };
        let all = (0..n).flat_map(|lobe| (0..self.latitudes.len()).map(move |j| (lobe, j)));
        all.map(|(lobe, j)| off(lobe, j)).fold(0.0, f64::max)
    }

    /// The lobe that holds a direction.
    pub fn lobe_of(&self, v: &Vec3) -> usize {
        let (longitude, latitude) = longitude_latitude(v);
        let nearest = |j: &usize| (self.latitudes[*j] - latitude).abs();
        let j = (0..self.latitudes.len())
            .min_by(|a, b| nearest(a).total_cmp(&nearest(b)))
            .unwrap_or(0);
        let holds = |lobe: &usize| {
            let [west, east] = self.sides(*lobe, j);
            (longitude - west).rem_euclid(TAU) < east - west
        };
        (0..self.longitudes.len()).find(holds).unwrap_or(0)
    }
}

/// The latitudes of all cuts: even ones, and more where a dot is round.
fn latitudes(discs: &[CutDisc]) -> Vec<f64> {
    let even = (0..=FACETS).map(|i| PI * (i as f64 / FACETS as f64 - 0.5));
    let rounds = discs.iter().flat_map(|disc| {
        (0..=DOT_FACETS).map(|i| {
            let along = (PI * (i as f64 / DOT_FACETS as f64 - 0.5)).sin();
            disc.latitude + disc.radius * along
        })
    });
    let mut all: Vec<f64> = even.chain(rounds).collect();
    all.sort_unstable_by(f64::total_cmp);
    all.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    all
}

/// The cuts at one latitude, on the way from the equator to a pole.
struct CutRow {
    /// Which meridian each cut follows, counted on beyond a full turn.
    follows: Vec<i64>,
}

impl CutRow {
    fn new(lobes: usize) -> Self {
        Self {
            follows: (0..lobes as i64).collect(),
        }
    }

    /// The cuts' longitudes at the next latitude.
    fn next(&mut self, latitude: f64, discs: &[CutDisc]) -> Vec<f64> {
        let n = self.follows.len();
        let step = TAU / n as f64;
        let reaching = discs.iter().filter_map(|disc| {
            let (longitude, half) = (disc.longitude, disc.half(latitude)?);
            Some(TakenDisc { longitude, half })
        });
        let taken: Vec<TakenDisc> = reaching.collect();
        let place = |meridian: i64| {
            let nominal = step * meridian as f64;
            let pushed = taken.iter().find_map(|taken| taken.push(nominal));
            pushed.map_or((nominal, None), |(longitude, side)| (longitude, Some(side)))
        };
        let narrow = (NARROW.0 * step).min(NARROW.1 / latitude.cos().max(1e-9));
        for lobe in 0..n {
            let turn = if lobe + 1 == n { n as i64 } else { 0 };
            let (west, east) = (self.follows[lobe], self.follows[(lobe + 1) % n] + turn);
            let ((w, w_side), (e, e_side)) = (place(west), place(east));
            // It tapers to the poles as it should, or has ended already.
            let squeezed = w_side == Some(CutSide::East) || e_side == Some(CutSide::West);
            if west == east || !squeezed || e - w >= narrow {
                continue;
            }
            match e_side {
                Some(CutSide::West) => self.join(east, west),
                _ => self.join(west, east),
            }
        }
        self.follows.iter().map(|&m| place(m).0).collect()
    }

    /// All cuts on the meridian `from` follow `to`, whatever turn they are counted in.
    fn join(&mut self, from: i64, to: i64) {
        let n = self.follows.len() as i64;
        for cut in &mut self.follows {
            if (*cut - from).rem_euclid(n) == 0 {
                *cut += to - from;
            }
        }
    }
}
