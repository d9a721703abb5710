//! Batches from synthetic frames.
//!
//! Every frame is drawn from its own generator, seeded by the training's seed and the frame's
//! number, with its own random pattern: the net must detect dots, not learn a pattern. A frame
//! gives several patches. Each patch has its circle displaced by the error of a fit, and is rotated
//! or mirrored at random (a mirrored pattern is a pattern too).

use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use spindoe::Result;
use spindoe::design::random_pattern;
use spindoe::synth::{Rendering, Scene, SynthConfig, SynthKind};
use spindoe::vision::camera::{BallCircle, Pixel};
use spindoe::vision::net::detector::cell_center;
use spindoe::vision::net::graph::CELLS;
use spindoe::vision::patch::{MIDDLE, Patch, SIZE};

/// Deviation of a dot's Gaussian in the heat map, in the patch's pixels (paper, Sec. III-A: 1.5 px
/// at 60 x 60).
const HEAT_SIGMA: f64 = 1.5;
/// Cells farther from a dot than this, in the patch's pixels, do not learn its position.
const NEAR: f64 = 2.4;
/// Radius about an undecidable dot, in the patch's pixels, within which the heat has no weight.
const BLIND: f64 = 4.0;
/// Relative deviations of a fitted circle's center and radius.
const CIRCLE_SIGMA: f64 = 0.012;
/// Share of the circles with three times that deviation.
const BAD_CIRCLES: f64 = 0.1;

/// What is shown where there is nothing to find.
pub const DISTRACTORS: [SynthKind; 8] = [
    SynthKind::Dotless,
    SynthKind::LogoOnly,
    SynthKind::SeamsOnly,
    SynthKind::Fruit,
    SynthKind::Lamp,
    SynthKind::Wheel,
    SynthKind::Speckled,
    SynthKind::Noise,
];

/// A dot in a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchDot {
    /// Its column and row (as u and v).
    pub at: Pixel,
    /// Whether it must be found; otherwise it is undecidable.
    pub certain: bool,
}

/// A patch with its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// The patch.
    pub patch: Patch,
    /// Its dots.
    pub dots: Vec<PatchDot>,
}

/// Draws a frame with its own random pattern.
///
/// # Errors
/// [`spindoe::Error::Argument`] where the configuration is out of its domain.
pub fn random_frame(config: &SynthConfig, rng: &mut ChaCha8Rng) -> Result<Rendering> {
    let dots = rng.random_range(12..=30);
    let most = 1.3 / f64::from(dots).sqrt();
    let pattern = random_pattern(dots as usize, rng.random_range(0.5..1.0) * most, rng)?;
    Scene::random(&pattern, config, rng)?.render()
}

/// A patch of a frame, with its circle displaced by the error of a fit.
pub fn sample<R: Rng + ?Sized>(frame: &Rendering, rng: &mut R) -> Sample {
    let gray = frame.image.to_gray();
    let far = if rng.random_bool(BAD_CIRCLES) {
        3.0
    } else {
        1.0
    };
    let mut off = || far * CIRCLE_SIGMA * rng.sample::<f64, _>(StandardNormal);
    let BallCircle { center, radius } = frame.circle;
    let circle = BallCircle {
        center: Pixel {
            u: center.u + radius * off(),
            v: center.v + radius * off(),
        },
        radius: radius * (1.0 + off()),
    };
    let patch = Patch::cut(&gray, &circle);
    let dots = frame
        .dots
        .iter()
        .map(|dot| PatchDot {
            at: patch.from_image(dot.pixel),
            // Neither beyond the image's edge nor behind a hand is there evidence of a dot.
            certain: dot.is_visible(),
        })
        .collect();
    Sample { patch, dots }
}

/// One of the eight symmetries of a square.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Symmetry {
    transpose: bool,
    flip_columns: bool,
    flip_rows: bool,
}

impl Symmetry {
    /// Any of the eight.
    pub fn random<R: Rng + ?Sized>(rng: &mut R) -> Self {
        Self {
            transpose: rng.random(),
            flip_columns: rng.random(),
            flip_rows: rng.random(),
        }
    }

    /// A patch's values in their new places.
    pub fn apply(self, values: &[f32]) -> Vec<f32> {
        let mut placed = vec![0.0; SIZE * SIZE];
        for row in 0..SIZE {
            for column in 0..SIZE {
                let to = self.place(Pixel {
                    u: column as f64,
                    v: row as f64,
                });
                placed[to.v as usize * SIZE + to.u as usize] = values[row * SIZE + column];
            }
        }
        placed
    }

    /// The new position of the value at (column, row).
    pub fn place(self, at: Pixel) -> Pixel {
        let flip = |x: f64, yes: bool| if yes { 2.0 * MIDDLE - x } else { x };
        let (u, v) = if self.transpose {
            (at.v, at.u)
        } else {
            (at.u, at.v)
        };
        Pixel {
            u: flip(u, self.flip_columns),
            v: flip(v, self.flip_rows),
        }
    }
}

/// The arrays of a batch, sample after sample.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Batch {
    /// Samples.
    pub len: usize,
    /// (n, 1, side, side)
    pub patches: Vec<f32>,
    /// (n, 1, cells, cells), see [`super::loss::Targets`].
    pub own: Vec<f32>,
    /// (n, 1, cells, cells)
    pub elsewhere: Vec<f32>,
    /// (n, 2, cells, cells)
    pub position: Vec<f32>,
    /// (n, 1, cells, cells)
    pub near: Vec<f32>,
}

impl Batch {
    /// Appends a sample, rotated and mirrored.
    pub fn push(&mut self, sample: &Sample, symmetry: Symmetry) {
        self.patches.extend(symmetry.apply(sample.patch.values()));
        let dots: Vec<PatchDot> = sample
            .dots
            .iter()
            .map(|dot| PatchDot {
                at: symmetry.place(dot.at),
                ..*dot
            })
            .collect();
        self.push_targets(&dots);
        self.len += 1;
    }

    fn push_targets(&mut self, dots: &[PatchDot]) {
        let area = CELLS * CELLS;
        let start = self.own.len();
        self.own.resize(start + area, 0.0);
        self.elsewhere.resize(start + area, 0.0);
        self.near.resize(start + area, 0.0);
        self.position.resize(2 * (start + area), 0.0);
        for row in 0..CELLS {
            for column in 0..CELLS {
                let cell = row * CELLS + column;
                self.elsewhere[start + cell] = self.target(2 * start, row, column, dots);
            }
        }
        for dot in dots.iter().filter(|d| d.certain) {
            let index = |x: f64| ((x - 0.5) / 2.0).round().clamp(0.0, (CELLS - 1) as f64) as usize;
            let own = start + index(dot.at.v) * CELLS + index(dot.at.u);
            self.own[own] = 1.0;
            self.elsewhere[own] = 0.0;
        }
    }

    /// Fills a cell's position; returns its weight as a cell without its own dot.
    fn target(&mut self, start: usize, row: usize, column: usize, dots: &[PatchDot]) -> f32 {
        let (u, v) = (cell_center(column), cell_center(row));
        let distance = |dot: &PatchDot| (dot.at.u - u).hypot(dot.at.v - v);
        let nearest = dots
            .iter()
            .filter(|d| d.certain)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let blind = dots.iter().any(|d| !d.certain && distance(d) < BLIND);
        let Some(dot) = nearest else {
            return if blind { 0.0 } else { 1.0 };
        };
        let away = distance(dot);
        let heat = (-0.5 * (away / HEAT_SIGMA).powi(2)).exp();
        if away < NEAR {
            let cell = row * CELLS + column;
            self.near[start / 2 + cell] = heat as f32;
            self.position[start + cell] = (dot.at.u - u) as f32;
            self.position[start + CELLS * CELLS + cell] = (dot.at.v - v) as f32;
        }
        if blind {
            0.0
        } else {
            (1.0 - heat).powi(4) as f32
        }
    }
}
