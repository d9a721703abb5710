//! Wrong poses under which dots of a pattern look like others of it.
//!
//! A pair of dots laid on another pair, midpoint on midpoint, gives a rotation `G`. Under it further
//! dots come to lie near others. The distance of a pair from the other is known from their angles
//! alone, so similar pairs are neighbors in a list that is sorted by angle; the dots near a direction
//! come from an index ([`DotIndex`]). The others are the pattern's own dots, or those of its mirror
//! image.
//!
//! Where there are more pairs of pairs than wanted, each is taken with the same probability. Whether
//! it is taken depends on the dots' numbers alone, so a sum over the sample, divided by that
//! probability, is smooth in the dots, and its mean over seeds is the sum over all.

use nalgebra::Matrix3;

use super::cube_map::DotIndex;
use crate::geometry::Vec3;

/// Nearer or more opposite pairs give no rotation.
const MIN_SINE: f64 = 1e-6;

/// How alike two dots are, by their distance: `exp(-r^2 / (8 sigma^2))`, faded out before the reach.
///
/// This is the Bhattacharyya coefficient of two Gaussians of sigma per axis at a distance `r`.
#[derive(Debug, Clone, Copy)]
pub(in crate::design) struct Kernel {
    sigma: f64,
    begin_squared: f64,
    reach_squared: f64,
}

/// A value with its derivative with respect to the squared distance.
#[derive(Debug, Clone, Copy)]
pub(in crate::design) struct Likeness {
    pub value: f64,
    pub slope: f64,
}

impl Kernel {
    /// Fades from `begin` to `reach`, both in units of sigma.
    pub fn new(sigma: f64, begin: f64, reach: f64) -> Self {
        Self {
            sigma,
            begin_squared: (begin * sigma).powi(2),
            reach_squared: (reach * sigma).powi(2),
        }
    }

    pub fn at(&self, squared: f64) -> Likeness {
        let scale = 1.0 / (8.0 * self.sigma * self.sigma);
        let plain = (-scale * squared).exp();
        let span = self.reach_squared - self.begin_squared;
        let t = ((squared - self.begin_squared) / span).clamp(0.0, 1.0);
        let fade = 1.0 - t * t * (3.0 - 2.0 * t);
        let fade_slope = -6.0 * t * (1.0 - t) / span;
        Likeness {
            value: plain * fade,
            slope: plain * (fade_slope - scale * fade),
        }
    }
}

/// A dot that lies near another once it is rotated.
#[derive(Debug, Clone, Copy)]
pub(in crate::design) struct Match {
    /// The dot that is seen.
    pub seen: usize,
    /// The dot that it is taken for.
    pub other: usize,
    /// How alike they are.
    pub likeness: Likeness,
}

/// A pair of dots laid on another, and what else matches then.
#[derive(Debug, Clone)]
pub(in crate::design) struct WrongPose {
    /// The pair that is seen, and the pair it is taken for, in this order.
    pub seen: [usize; 2],
    pub other: [usize; 2],
    /// Maps the first pair onto the second.
    pub rotation: Matrix3<f64>,
    /// How alike the pairs are; its slope is taken with respect to the sum of both squared distances.
    pub likeness: Likeness,
    /// The inverse pose is not listed: it counts as much.
    pub multiplicity: f64,
    /// A number that depends on the dots' numbers only.
    pub hash: u64,
    /// Further matches, ordered by the dot that is seen.
    pub matches: std::ops::Range<usize>,
}

/// All poses with at least so many further matches, and these matches.
pub(in crate::design) struct WrongPoses {
    pub poses: Vec<WrongPose>,
    pub matches: Vec<Match>,
    /// The part of all pairs of pairs that was looked at.
    pub fraction: f64,
}

/// The dots that others are taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::design) enum Image {
    /// The pattern's own.
    Own,
    /// Those of its mirror image, each opposite to the pattern's.
    Mirrored,
}

impl Image {
    /// The factor of each dot's position.
    pub fn sign(self) -> f64 {
        match self {
            Self::Own => 1.0,
            Self::Mirrored => -1.0,
        }
    }

    /// The dots' positions in the image.
    pub fn of(self, dots: &[Vec3]) -> Vec<Vec3> {
        dots.iter().map(|d| self.sign() * d).collect()
    }
}

/// What is looked for.
#[derive(Debug, Clone, Copy)]
pub(in crate::design) struct PoseSearch {
    /// The dots that others are taken for.
    pub image: Image,
    /// Of two dots.
    pub kernel: Kernel,
    /// Of two pairs.
    pub pair_kernel: Kernel,
    /// Further matches that a pose must have.
    pub min_matches: usize,
    /// Pairs of pairs to look at, about.
    pub max_poses: f64,
    /// Seed of the sample.
    pub seed: u64,
}

/// Two different dots, the smaller number first.
struct Pair {
    dots: [usize; 2],
    half_angle: f64,
}

impl PoseSearch {
    /// Finds the poses of a pattern.
    pub fn run(&self, dots: &[Vec3]) -> WrongPoses {
        let n = dots.len();
        let mut pairs = Vec::with_capacity(n * (n - 1) / 2);
        for b in 0..n {
            for a in 0..b {
                let (sine, cosine) = (dots[a].cross(&dots[b]).norm(), dots[a].dot(&dots[b]));
                if sine > MIN_SINE {
                    pairs.push(Pair {
                        dots: [a, b],
                        half_angle: 0.5 * sine.atan2(cosine),
                    });
                }
            }
        }
        pairs.sort_unstable_by(|x, y| {
            x.half_angle
                .total_cmp(&y.half_angle)
                .then(x.dots.cmp(&y.dots))
        });
        // A number of dots has one fraction, whatever their places: the sample must not change with
        // them. The sine's distribution puts about this part of all pairs within the reach.
        let reach = self.pair_reach();
        let all = (n * (n - 1)) as f64;
        let alike = 0.2 * all * all * (2.0 * reach).min(1.0);
        let fraction = (self.max_poses / alike).min(1.0);
        let mut found = WrongPoses {
            poses: Vec::new(),
            matches: Vec::new(),
            fraction,
        };
        let others = self.image.of(dots);
        let index = DotIndex::new(&others, self.kernel.reach_squared.sqrt());
        let both = [dots, &others];
        for (x, first) in pairs.iter().enumerate() {
            for second in &pairs[..=x] {
                // The half angles differ by what each dot is off.
                if first.half_angle - second.half_angle > reach {
                    continue;
                }
                self.lay(both, first, second, &index, &mut found);
            }
        }
        found
    }

    /// The largest difference of half angles: each dot is off by it.
    fn pair_reach(&self) -> f64 {
        let each = (0.5 * self.pair_kernel.reach_squared).sqrt();
        2.0 * (0.5 * each).min(1.0).asin()
    }

    fn lay(
        &self,
        [dots, others]: [&[Vec3]; 2],
        first: &Pair,
        second: &Pair,
        index: &DotIndex,
        found: &mut WrongPoses,
    ) {
        let [a, b] = first.dots;
        let [c, d] = second.dots;
        let same = (a, b) == (c, d);
        for other in [[c, d], [d, c]] {
            if self.image == Image::Own && other == [a, b] {
                continue;
            }
            let hash = mix(self.seed, first.dots, other);
            // The upper bits decide, the lower ones stay for other uses.
            if (hash >> 11) as f64 / (1u64 << 53) as f64 >= found.fraction {
                continue;
            }
            let off = 4.0 * (0.5 * (first.half_angle - second.half_angle)).sin().powi(2);
            let likeness = self.pair_kernel.at(2.0 * off);
            if likeness.value == 0.0 {
                continue;
            }
            let rotation = frame(others, other) * frame(dots, first.dots).transpose();
            let from = found.matches.len();
            self.add_matches(
                [dots, others],
                [first.dots, other],
                &rotation,
                index,
                &mut found.matches,
            );
            if found.matches.len() < from + self.min_matches {
                found.matches.truncate(from);
                continue;
            }
            found.poses.push(WrongPose {
                seen: first.dots,
                other,
                rotation,
                likeness,
                multiplicity: if same { 1.0 } else { 2.0 },
                hash,
                matches: from..found.matches.len(),
            });
        }
    }

    fn add_matches(
        &self,
        [dots, others]: [&[Vec3]; 2],
        [seen, other]: [[usize; 2]; 2],
        rotation: &Matrix3<f64>,
        index: &DotIndex,
        matches: &mut Vec<Match>,
    ) {
        let taken = other.iter().fold(0u64, |bits, &j| bits | 1 << j);
        for (i, dot) in dots.iter().enumerate() {
            if seen.contains(&i) {
                continue;
            }
            let at = rotation * dot;
            let mut near = index.near(&at) & !taken;
            while near != 0 {
                let j = near.trailing_zeros() as usize;
                near &= near - 1;
                let squared = 2.0 - 2.0 * at.dot(&others[j]);
                if squared < self.kernel.reach_squared {
                    let likeness = self.kernel.at(squared);
                    matches.push(Match {
                        seen: i,
                        other: j,
                        likeness,
                    });
                }
            }
        }
    }
}

/// The frame of a pair: its midpoint, the direction from the second to the first, and their normal.
pub(super) fn frame(dots: &[Vec3], [a, b]: [usize; 2]) -> Matrix3<f64> {
    let middle = (dots[a] + dots[b]).normalize();
    let along = (dots[a] - dots[b]).normalize();
    Matrix3::from_columns(&[middle, along, middle.cross(&along)])
}

/// Adds the derivative of a value that changes by `torque . w` where the pair's frame turns by a
/// small `w`.
pub(super) fn add_frame_gradient(
    dots: &[Vec3],
    [a, b]: [usize; 2],
    torque: &Vec3,
    gradient: &mut [Vec3],
) {
    let (sum, difference) = (dots[a] + dots[b], dots[a] - dots[b]);
    let (middle, along) = (sum.normalize(), difference.normalize());
    let normal = middle.cross(&along);
    let shared = torque.cross(&middle) / sum.norm();
    let opposed = normal * (torque.dot(&middle) / difference.norm());
    gradient[a] += shared + opposed;
    gradient[b] += shared - opposed;
}

/// A hash of two pairs (the finalizer of SplitMix64: S. Vigna, public domain).
fn mix(seed: u64, [a, b]: [usize; 2], [c, d]: [usize; 2]) -> u64 {
    let packed = [a, b, c, d]
        .iter()
        .fold(0u64, |all, &x| all << 8 | x as u64);
    let mut z = seed.wrapping_add(packed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}
