//! Training the nets of `spindoe`, for dots and for outlines, on synthetic frames.
//!
//! AdamW (I. Loshchilov, F. Hutter, ICLR 2019) with a linear warm-up and a cosine decay of the
//! learning rate, on frames that are drawn during the training and never seen twice. The net is
//! evaluated at fixed intervals. The best weights are kept, and training ends early after several
//! evaluations without a better net.
//!
//! Four sets of frames, drawn with four seeds ([`FrameSet`]), are disjoint: one trains, one selects
//! the best weights, one calibrates them ([`score`]), and one gives the reported score.
//!
//! A run is a function of its configuration on processors with the same instructions; other
//! processors may round differently. Its checkpoint holds the net, the optimizer's moments and the
//! position in the sequence of frames, so a resumed run continues as if it had not stopped.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};

use burn::module::Module;
use burn::optim::{AdamWConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor, TensorData};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use spindoe::synth::dataset::frame_rng;
use spindoe::synth::{Rendering, SynthConfig};
use spindoe::vision::net::graph::{CELLS, Head};
use spindoe::vision::net::network::{Activations, Network};
use spindoe::vision::net::weights::{Calibration, FORMAT_VERSION, Layer, Weights, WeightsMeta};
use spindoe::vision::patch::{RADIUS, SIZE};
use spindoe::{Error, Result};

pub mod checkpoint;
pub mod loss;
pub mod model;
pub mod outline;
pub mod sample;
pub mod score;

pub use checkpoint::Checkpoint;
pub use outline::OutlineScore;
pub use score::DotScore;

use loss::{Loss, Targets};
use model::{Net, floats};
use outline::{OutlineBatch, OutlineSample};
use sample::{Batch, DISTRACTORS, Sample, Symmetry, random_frame};
use score::MatchedPeak;

/// Batches drawn ahead of the net.
const AHEAD: usize = 4;

/// The purpose of a set of frames. Each purpose has a seed, so no set shares a frame with another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameSet {
    /// The net trains on them.
    Train,
    /// They select the best weights.
    Validation,
    /// Probabilities and covariances are calibrated on them.
    Calibration,
    /// The reported score comes from them, and nothing else uses them.
    Test,
}

impl FrameSet {
    /// The seed of the set's frames in a training with this seed.
    pub fn seed(self, training: u64) -> u64 {
        training
            ^ match self {
                Self::Train => 0,
                Self::Validation => 0x7661_6c69_6461_7465,
                Self::Calibration => 0x6361_6c69_6272_6174,
                Self::Test => 0x7265_706f_7274_6564,
            }
    }
}

/// Configuration of a training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainConfig {
    /// What the net is for.
    pub head: Head,
    /// Seed of the initial weights and of all frames.
    pub seed: u64,
    /// Steps of the optimizer.
    pub steps: u64,
    /// Samples per step.
    pub batch: usize,
    /// Samples from one frame.
    pub samples_per_frame: usize,
    /// Highest learning rate.
    pub learning_rate: f64,
    /// Steps of the linear warm-up from 0.
    pub warmup_steps: u64,
    /// AdamW's weight decay.
    pub weight_decay: f32,
    /// Steps between evaluations.
    pub eval_every: u64,
    /// Frames of each of the three sets that the net is evaluated on.
    pub eval_frames: usize,
    /// Evaluations without a better net after which training ends.
    pub patience: usize,
    /// Share of the frames that show something else than a dotted ball
    /// ([`sample::DISTRACTORS`]): where there is no dot the net must find none.
    pub distractor_share: f64,
    /// Distribution of the frames.
    pub synth: SynthConfig,
}

impl Default for TrainConfig {
    /// 12 000 steps of 32 samples, two from a frame; evaluated on 500 frames every 500 steps.
    fn default() -> Self {
        Self {
            head: Head::Dots,
            seed: 0,
            steps: 12_000,
            batch: 32,
            samples_per_frame: 2,
            learning_rate: 2e-3,
            warmup_steps: 300,
            weight_decay: 1e-4,
            eval_every: 500,
            eval_frames: 500,
            patience: 12,
            distractor_share: 0.12,
            synth: SynthConfig {
                // Larger balls are downscaled to the patch anyway.
                size_px: [40, 120],
                ..SynthConfig::default()
            },
        }
    }
}

impl TrainConfig {
    /// The defaults for a net. For outlines, four patches of a frame and more of the ball's
    /// surroundings.
    pub fn of(head: Head) -> Self {
        let dots = Self::default();
        match head {
            Head::Dots => dots,
            Head::DotsLarge => Self { head, ..dots },
            Head::Outline => Self {
                head,
                samples_per_frame: 4,
                synth: SynthConfig {
                    ball_px: Some([32.0, 110.0]),
                    fill: [0.35, 1.0],
                    off_center: 0.4,
                    ..dots.synth
                },
                ..dots
            },
        }
    }

    /// Checks the domains of all parameters.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the parameter.
    pub fn check(&self) -> Result<()> {
        for (name, value) in [
            ("steps", self.steps),
            ("batch", self.batch as u64),
            ("samples_per_frame", self.samples_per_frame as u64),
            ("eval_every", self.eval_every),
            ("eval_frames", self.eval_frames as u64),
            ("patience", self.patience as u64),
        ] {
            if value == 0 {
                return Err(Error::argument(name, "expected at least 1, found 0"));
            }
        }
        if !(self.learning_rate > 0.0 && self.learning_rate.is_finite()) {
            let problem = format!("expected a positive number, found {}", self.learning_rate);
            return Err(Error::argument("learning_rate", problem));
        }
        if !(0.0..=0.9).contains(&self.distractor_share) {
            let problem = format!("expected 0 to 0.9, found {}", self.distractor_share);
            return Err(Error::argument("distractor_share", problem));
        }
        Ok(())
    }

    /// The learning rate of a step.
    pub fn rate_at(&self, step: u64) -> f64 {
        let warmup = ((step + 1) as f64 / self.warmup_steps.max(1) as f64).min(1.0);
        let done = (step as f64 / self.steps as f64).min(1.0);
        self.learning_rate * warmup * 0.5 * (1.0 + (std::f64::consts::PI * done).cos())
    }

    /// A frame of the training's distribution.
    fn random_frame(&self, rng: &mut ChaCha8Rng) -> Result<Rendering> {
        if !rng.random_bool(self.distractor_share) {
            return random_frame(&self.synth, rng);
        }
        let kind = DISTRACTORS[rng.random_range(0..DISTRACTORS.len())];
        // Where there is no ball, the net for outlines learns that nothing can be known.
        random_frame(
            &SynthConfig {
                kind,
                ..self.synth.clone()
            },
            rng,
        )
    }

    /// The samples of a step.
    fn batch_at(&self, step: u64) -> Result<HeadBatch> {
        Ok(match self.head {
            Head::Dots | Head::DotsLarge => {
                let mut batch = Batch::default();
                self.draw(step, sample::sample, |s, symmetry| batch.push(s, symmetry))?;
                HeadBatch::Dots(batch)
            }
            Head::Outline => {
                let mut batch = OutlineBatch::default();
                self.draw(step, outline::sample, |s, symmetry| {
                    batch.push(s, symmetry);
                })?;
                HeadBatch::Outline(batch)
            }
        })
    }

    /// Draws the samples of a step, in order.
    fn draw<S>(
        &self,
        step: u64,
        sample: impl Fn(&Rendering, &mut ChaCha8Rng) -> S,
        mut push: impl FnMut(&S, Symmetry),
    ) -> Result<()> {
        let frames = self.batch.div_ceil(self.samples_per_frame) as u64;
        let mut left = self.batch;
        for frame in step * frames..(step + 1) * frames {
            let mut rng = frame_rng(FrameSet::Train.seed(self.seed), frame);
            let rendering = self.random_frame(&mut rng)?;
            for _ in 0..self.samples_per_frame.min(left) {
                let sample = sample(&rendering, &mut rng);
                push(&sample, Symmetry::random(&mut rng));
                left -= 1;
            }
        }
        Ok(())
    }

    /// A set of samples that the net does not train on.
    fn samples(&self, set: FrameSet) -> Result<Samples> {
        Ok(match self.head {
            Head::Dots | Head::DotsLarge => Samples::Dots(self.sample_set(set, sample::sample)?),
            Head::Outline => Samples::Outline(self.sample_set(set, outline::sample)?),
        })
    }

    fn sample_set<S: Send>(
        &self,
        set: FrameSet,
        sample: impl Fn(&Rendering, &mut ChaCha8Rng) -> S + Sync,
    ) -> Result<Vec<S>> {
        (0..self.eval_frames as u64)
            .into_par_iter()
            .map(|frame| {
                let mut rng = frame_rng(set.seed(self.seed), frame);
                let rendering = self.random_frame(&mut rng)?;
                Ok(sample(&rendering, &mut rng))
            })
            .collect()
    }
}

/// The samples of a step, for either net.
enum HeadBatch {
    Dots(Batch),
    Outline(OutlineBatch),
}

/// Samples that a net does not train on.
enum Samples {
    Dots(Vec<Sample>),
    Outline(Vec<OutlineSample>),
}

/// How good a net is, on frames that it was not trained on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Score {
    /// A net for dots, at a probability of one half.
    Dots(DotScore),
    /// A net for outlines.
    Outline(OutlineScore),
}

impl Score {
    /// What selects the best weights: larger is better.
    pub fn quality(&self) -> f64 {
        match self {
            Self::Dots(score) => score.f1(),
            Self::Outline(score) => -score.mean_error,
        }
    }
}

impl std::fmt::Display for Score {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Dots(s) => write!(
                f,
                "of {} dots on {} frames {:.2} % found, {:.3} false per frame, median error {:.2} % of the radius",
                s.dots,
                s.frames,
                100.0 * s.recall(),
                s.false_peaks as f64 / s.frames as f64,
                100.0 * s.median_error / RADIUS,
            ),
            Self::Outline(s) => write!(
                f,
                "of {} outlines {} within 1 %, {} within 2 % and {} within 5 % of the radius, median error {:.2} %, mean {:.2} %",
                s.frames,
                s.within[0],
                s.within[1],
                s.within[2],
                100.0 * s.median_error,
                100.0 * s.mean_error,
            ),
        }
    }
}

/// Progress of a training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainProgress {
    /// Steps done.
    pub step: u64,
    /// Mean of the heat map's loss since the last report.
    pub heat_loss: f64,
    /// Mean of the positions' loss since the last report.
    pub position_loss: f64,
    /// The last evaluation, on the validation set.
    pub score: Option<Score>,
}

/// Observes a training.
pub trait TrainObserver {
    /// Called every few steps.
    ///
    /// # Errors
    /// Any error of the observer; it ends the training.
    fn progress(&mut self, _progress: &TrainProgress) -> Result<()> {
        Ok(())
    }

    /// Called after each evaluation with all that is needed to continue.
    ///
    /// # Errors
    /// Any error of the observer; it ends the training.
    fn checkpoint(&mut self, _checkpoint: &Checkpoint) -> Result<()> {
        Ok(())
    }
}

impl TrainObserver for () {}

/// Result of a training.
#[derive(Debug, Clone, PartialEq)]
pub struct Trained {
    /// The best weights, calibrated.
    pub weights: Weights,
    /// Their score on the test set, at a probability of one half.
    pub score: Score,
    /// Steps done.
    pub steps: u64,
}

/// Where a training begins.
#[derive(Debug, Clone)]
pub enum TrainStart {
    /// With random parameters.
    Random,
    /// With the parameters of another training.
    Weights(Box<Weights>),
    /// Where a run of the same configuration stopped.
    Checkpoint(Box<Checkpoint>),
}

/// Trains a net. Setting `stop` ends the training at the
/// next step; the best weights so far are calibrated and returned.
///
/// # Errors
/// [`Error::Argument`] where the configuration is out of its domain; the observer's errors;
/// [`Error::Internal`] where burn fails.
pub fn train(
    config: &TrainConfig,
    start: TrainStart,
    stop: &AtomicBool,
    observer: &mut dyn TrainObserver,
) -> Result<Trained> {
    config.check()?;
    let mut trainer = Trainer::new(config, start)?;
    let first = trainer.state.step;
    let (send, batches) = sync_channel(AHEAD);
    std::thread::scope(|scope| {
        scope.spawn(move || {
            for step in first..config.steps {
                // The receiver is gone when the training has ended.
                if send.send(config.batch_at(step)).is_err() {
                    break;
                }
            }
        });
        trainer.run(batches, stop, observer)
    })?;
    trainer.finish()
}

/// The state of a run besides its configuration.
struct Trainer<'a> {
    config: &'a TrainConfig,
    device: Device,
    net: Net,
    optimizer: ModuleOptimizer,
    state: checkpoint::State,
    validation: Samples,
    calibration: Samples,
    /// The best net's parameters.
    best: Option<Weights>,
}

/// Steps between reports.
const REPORT_EVERY: u64 = 20;

impl<'a> Trainer<'a> {
    fn new(config: &'a TrainConfig, start: TrainStart) -> Result<Self> {
        let device = Device::flex().autodiff();
        let optimizer = AdamWConfig::new()
            .with_weight_decay(config.weight_decay)
            .init();
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        let layers = match &start {
            TrainStart::Weights(weights) => weights.layers.clone(),
            _ => Net::random_layers(config.head, &mut rng)?,
        };
        let net = Net::new(config.head, &layers, &device)?;
        let mut trainer = Self {
            config,
            device,
            net,
            optimizer,
            state: checkpoint::State::default(),
            validation: config.samples(FrameSet::Validation)?,
            calibration: config.samples(FrameSet::Calibration)?,
            best: None,
        };
        if let TrainStart::Checkpoint(from) = start {
            let restored = from.restore(trainer.net.clone(), trainer.optimizer.clone())?;
            (trainer.net, trainer.optimizer) = (restored.net, restored.optimizer);
            (trainer.state, trainer.best) = (from.state, from.best);
        }
        Ok(trainer)
    }

    fn run(
        &mut self,
        batches: Receiver<Result<HeadBatch>>,
        stop: &AtomicBool,
        observer: &mut dyn TrainObserver,
    ) -> Result<()> {
        let mut sums = [0.0; 2];
        let mut score = None;
        for batch in batches {
            let [heat, position] = self.step(&batch?)?;
            sums = [sums[0] + heat, sums[1] + position];
            let step = self.state.step;
            if step.is_multiple_of(self.config.eval_every) || step == self.config.steps {
                score = Some(self.evaluate()?);
                observer.checkpoint(&self.checkpoint()?)?;
            }
            if step.is_multiple_of(REPORT_EVERY) {
                observer.progress(&TrainProgress {
                    step,
                    heat_loss: sums[0] / REPORT_EVERY as f64,
                    position_loss: sums[1] / REPORT_EVERY as f64,
                    score,
                })?;
                sums = [0.0; 2];
            }
            if self.state.since_best >= self.config.patience || stop.load(Ordering::Relaxed) {
                break;
            }
        }
        Ok(())
    }

    /// One step of the optimizer; returns the parts of the loss.
    fn step(&mut self, batch: &HeadBatch) -> Result<[f64; 2]> {
        let (total, parts) = match batch {
            HeadBatch::Dots(batch) => self.dot_loss(batch)?,
            HeadBatch::Outline(batch) => self.outline_loss(batch)?,
        };
        let gradients = GradientsParams::from_grads(total.backward(), &self.net);
        let rate = self.config.rate_at(self.state.step);
        self.net = self.optimizer.step(rate, self.net.clone(), gradients);
        self.state.step += 1;
        Ok(parts)
    }

    fn outline_loss(&self, batch: &OutlineBatch) -> Result<(Tensor<1>, [f64; 2])> {
        let tensor = |values: &[f32], side: usize| {
            let data = TensorData::new(values.to_vec(), [batch.len, 1, side, side]);
            Tensor::<4>::from_data(data, &self.device)
        };
        let cells = self.net.forward(tensor(&batch.patches, SIZE));
        let distance = tensor(&batch.distance, CELLS);
        let total = outline::loss(cells, distance, tensor(&batch.weight, CELLS));
        let loss = f64::from(floats(total.clone())?[0]);
        Ok((total, [0.0, loss]))
    }

    fn dot_loss(&self, batch: &Batch) -> Result<(Tensor<1>, [f64; 2])> {
        let n = batch.len;
        let tensor = |values: &[f32], channels: usize, side: usize| {
            let data = TensorData::new(values.to_vec(), [n, channels, side, side]);
            Tensor::<4>::from_data(data, &self.device)
        };
        let targets = Targets {
            own: tensor(&batch.own, 1, CELLS),
            elsewhere: tensor(&batch.elsewhere, 1, CELLS),
            position: tensor(&batch.position, 2, CELLS),
            near: tensor(&batch.near, 1, CELLS),
        };
        let cells = self.net.forward(tensor(&batch.patches, 1, SIZE));
        let Loss {
            total,
            heat,
            position,
        } = loss::loss(cells, &targets);
        let number = |t: Tensor<1>| Ok::<_, Error>(f64::from(floats(t)?[0]));
        Ok((total, [number(heat)?, number(position)?]))
    }

    /// Calibrates the net and evaluates it, and keeps its parameters where they are the best so
    /// far.
    fn evaluate(&mut self) -> Result<Score> {
        let layers = self.net.valid().layers()?;
        let calibration = calibrate(self.config.head, &layers, &self.calibration)?;
        let score = evaluate(self.config.head, &layers, &self.validation, &calibration)?;
        if self.best.is_none() || score.quality() > self.state.best_quality {
            self.state.best_quality = score.quality();
            self.state.since_best = 0;
            self.best = Some(Weights {
                layers,
                meta: WeightsMeta {
                    format_version: FORMAT_VERSION,
                    head: self.config.head,
                    calibration,
                    command: String::new(),
                    frames: self.state.step * self.config.batch as u64
                        / self.config.samples_per_frame as u64,
                    is_rounded: false,
                },
            });
        } else {
            self.state.since_best += 1;
        }
        Ok(score)
    }

    fn checkpoint(&self) -> Result<Checkpoint> {
        Checkpoint::of(
            self.config,
            &self.net,
            &self.optimizer,
            self.state,
            self.best.clone(),
        )
    }

    fn finish(mut self) -> Result<Trained> {
        if self.best.is_none() {
            self.evaluate()?;
        }
        let Some(weights) = self.best else {
            let problem = "stopped before the net had learned anything";
            return Err(Error::argument("train", problem));
        };
        // The large net would be the greater part of what ships the crate.
        let weights = match self.config.head {
            Head::DotsLarge => weights.rounded(),
            Head::Dots | Head::Outline => weights,
        };
        Ok(Trained {
            score: test(self.config, &weights)?,
            weights,
            steps: self.state.step,
        })
    }
}

/// The score of weights on the test set of a training with this configuration.
///
/// # Errors
/// [`Error::Argument`] where the configuration is out of its domain or the weights do not fit the
/// net.
pub fn test(config: &TrainConfig, weights: &Weights) -> Result<Score> {
    config.check()?;
    if weights.meta.head != config.head {
        let problem = format!("expected those of a net for {}", config.head.as_str());
        return Err(Error::argument("weights", problem));
    }
    let samples = config.samples(FrameSet::Test)?;
    evaluate(
        config.head,
        &weights.layers,
        &samples,
        &weights.meta.calibration,
    )
}

/// Fits the calibration of a net on samples.
fn calibrate(head: Head, layers: &[Layer], samples: &Samples) -> Result<Calibration> {
    Ok(match samples {
        Samples::Dots(samples) => {
            score::calibrate(&match_all(head, layers, samples, &Calibration::default())?)
        }
        Samples::Outline(samples) => Calibration {
            covariance_factor: outline::covariance_factor(&outline_errors(layers, samples)?),
            ..Calibration::default()
        },
    })
}

/// The score of a net on samples.
fn evaluate(
    head: Head,
    layers: &[Layer],
    samples: &Samples,
    calibration: &Calibration,
) -> Result<Score> {
    Ok(match samples {
        Samples::Dots(samples) => {
            let matched = match_all(head, layers, samples, calibration)?;
            Score::Dots(score::score(&matched, samples, 0.5))
        }
        Samples::Outline(samples) => {
            Score::Outline(outline::score(&outline_errors(layers, samples)?))
        }
    })
}

/// The errors of the circles that a net gives on samples.
fn outline_errors(
    layers: &[Layer],
    samples: &[OutlineSample],
) -> Result<Vec<outline::OutlineError>> {
    let network = Network::new(Head::Outline, layers)?;
    let mut activations = Activations::new(Head::Outline);
    Ok(samples
        .iter()
        .map(|s| outline::error(network.forward(&s.patch, &mut activations), s))
        .collect())
}

/// Runs a net on samples, as `spindoe` runs it, and matches its peaks with their dots.
fn match_all(
    head: Head,
    layers: &[Layer],
    samples: &[Sample],
    calibration: &Calibration,
) -> Result<Vec<MatchedPeak>> {
    let network = Network::new(head, layers)?;
    let mut activations = Activations::new(head);
    let mut matched = Vec::new();
    for sample in samples {
        let cells = network.forward(&sample.patch, &mut activations);
        score::match_peaks(cells, sample, calibration, &mut matched);
    }
    Ok(matched)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sets_share_no_frame() {
        let config = TrainConfig {
            eval_frames: 3,
            ..TrainConfig::default()
        };
        let sets = [
            FrameSet::Train,
            FrameSet::Validation,
            FrameSet::Calibration,
            FrameSet::Test,
        ];
        let samples: Vec<Sample> = sets
            .iter()
            .flat_map(|&set| config.sample_set(set, sample::sample).expect("frames"))
            .collect();
        for (i, a) in samples.iter().enumerate() {
            assert!(samples[..i].iter().all(|b| a.patch != b.patch), "{i}");
        }
    }
}
