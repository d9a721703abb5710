//! Training the dot detector on synthetic frames.
//!
//! AdamW (I. Loshchilov, F. Hutter, ICLR 2019) with a rise and a cosine fall of the learning rate, on frames that are drawn while
//! the net learns and never seen twice. Every so often the net is judged on frames of another seed; the best
//! weights are kept, and training ends early when they have not been bettered for long. At the end the weights are
//! calibrated on those frames ([`score`]).
//!
//! A run is a function of its configuration. Its checkpoint holds the net, the optimizer's moments and the position in the
//! sequence of frames, so that a resumed run goes on as if it had not been ended.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};

use burn::module::Module;
use burn::optim::{AdamWConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor, TensorData};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::synth::SynthConfig;
use crate::synth::dataset::frame_rng;
use crate::vision::net::graph::CELLS;
use crate::vision::net::model::{Net, floats};
use crate::vision::net::weights::{Calibration, FORMAT_VERSION, Weights, WeightsMeta};
use crate::vision::patch::SIZE;

pub mod checkpoint;
pub mod loss;
pub mod sample;
pub mod score;

pub use checkpoint::Checkpoint;
pub use score::Score;

use loss::{Loss, Targets};
use sample::{Batch, Sample, Symmetry, random_frame};

/// Batches drawn ahead of the net.
const AHEAD: usize = 4;
/// Samples judged at once.
const JUDGED_AT_ONCE: usize = 50;
/// Mixed into the seed for the frames that the net is judged on.
const JUDGE_SEED: u64 = 0x6a75_6467_6500;

/// How the net is trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainConfig {
    /// Seed of the first weights and of all frames.
    pub seed: u64,
    /// Steps of the optimizer.
    pub steps: u64,
    /// Samples a step.
    pub batch: usize,
    /// Samples that one frame gives.
    pub samples_a_frame: usize,
    /// Highest learning rate.
    pub learning_rate: f64,
    /// Steps over which the rate rises from 0.
    pub rise: u64,
    /// AdamW's weight decay.
    pub weight_decay: f32,
    /// Steps between judgements.
    pub judge_every: u64,
    /// Frames that the net is judged on.
    pub judge_frames: usize,
    /// Judgements without a better net after which training ends.
    pub patience: usize,
    /// What frames are like.
    pub synth: SynthConfig,
}

impl Default for TrainConfig {
    /// 12 000 steps of 32 samples, two from a frame; judged on 500 frames every 500 steps.
    fn default() -> Self {
        Self {
            seed: 0,
            steps: 12_000,
            batch: 32,
            samples_a_frame: 2,
            learning_rate: 2e-3,
            rise: 300,
            weight_decay: 1e-4,
            judge_every: 500,
            judge_frames: 500,
            patience: 12,
            synth: SynthConfig {
                // Larger balls are shrunk to the patch anyway.
                size_px: [40, 120],
                ..SynthConfig::default()
            },
        }
    }
}

impl TrainConfig {
    /// Checks the domains of all parameters.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the parameter.
    pub fn check(&self) -> Result<()> {
        for (name, value) in [
            ("steps", self.steps),
            ("batch", self.batch as u64),
            ("samples_a_frame", self.samples_a_frame as u64),
            ("judge_every", self.judge_every),
            ("judge_frames", self.judge_frames as u64),
            ("patience", self.patience as u64),
        ] {
            if value == 0 {
                return Err(Error::argument(name, "expected at least 1, found 0"));
            }
        }
        if !(self.learning_rate > 0.0 && self.learning_rate.is_finite()) {
            let problem = format!("expected a positive number, found {}", self.learning_rate);
            return Err(Error::argument("learning rate", problem));
        }
        Ok(())
    }

    /// The learning rate of a step.
    pub fn rate_at(&self, step: u64) -> f64 {
        let rise = ((step + 1) as f64 / self.rise.max(1) as f64).min(1.0);
        let done = (step as f64 / self.steps as f64).min(1.0);
        self.learning_rate * rise * 0.5 * (1.0 + (std::f64::consts::PI * done).cos())
    }

    /// The samples of a step.
    fn batch_at(&self, step: u64) -> Result<Batch> {
        let frames = self.batch.div_ceil(self.samples_a_frame) as u64;
        let made: Result<Vec<Vec<(Sample, Symmetry)>>> = (step * frames..(step + 1) * frames)
            .map(|frame| {
                let mut rng = frame_rng(self.seed, frame);
                let rendering = random_frame(&self.synth, &mut rng)?;
                Ok((0..self.samples_a_frame)
                    .map(|_| {
                        let sample = sample::sample(&rendering, &mut rng);
                        (sample, Symmetry::random(&mut rng))
                    })
                    .collect())
            })
            .collect();
        let mut batch = Batch::default();
        for (sample, symmetry) in made?.iter().flatten().take(self.batch) {
            batch.push(sample, *symmetry);
        }
        Ok(batch)
    }

    /// The frames that the net is judged on.
    fn judge_set(&self) -> Result<Vec<Sample>> {
        (0..self.judge_frames as u64)
            .into_par_iter()
            .map(|frame| {
                let mut rng = frame_rng(self.seed ^ JUDGE_SEED, frame);
                let rendering = random_frame(&self.synth, &mut rng)?;
                Ok(sample::sample(&rendering, &mut rng))
            })
            .collect()
    }
}

/// Where a training stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainProgress {
    /// Steps done.
    pub step: u64,
    /// Mean of the heat map's loss since the last report.
    pub heat_loss: f64,
    /// Mean of the positions' loss since the last report.
    pub position_loss: f64,
    /// The last judgement.
    pub score: Option<Score>,
}

/// Follows a training.
pub trait TrainObserver {
    /// Called every few steps.
    ///
    /// # Errors
    /// Whatever the observer meets; it ends the training.
    fn progress(&mut self, _progress: &TrainProgress) -> Result<()> {
        Ok(())
    }

    /// Called after each judgement with all that is needed to continue.
    ///
    /// # Errors
    /// Whatever the observer meets; it ends the training.
    fn checkpoint(&mut self, _checkpoint: &Checkpoint) -> Result<()> {
        Ok(())
    }
}

impl TrainObserver for () {}

/// What a training came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Trained {
    /// The best weights, calibrated.
    pub weights: Weights,
    /// Their score, at a probability of one half.
    pub score: Score,
    /// Steps done.
    pub steps: u64,
}

/// Trains a net, from the beginning or from a checkpoint. Setting `stop` ends the training at the next step; what was best
/// so far is calibrated and given back.
///
/// # Errors
/// [`Error::Argument`] where the configuration is out of its domain; the observer's errors; [`Error::Internal`] where
/// burn fails.
pub fn train(
    config: &TrainConfig,
    from: Option<Checkpoint>,
    stop: &AtomicBool,
    observer: &mut dyn TrainObserver,
) -> Result<Trained> {
    config.check()?;
    let judge_set = config.judge_set()?;
    let mut trainer = Trainer::new(config, from)?;
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
        trainer.run(batches, &judge_set, stop, observer)
    })?;
    trainer.finish(&judge_set)
}

/// What a run needs besides its configuration.
struct Trainer<'a> {
    config: &'a TrainConfig,
    device: Device,
    net: Net,
    optimizer: ModuleOptimizer,
    state: checkpoint::State,
    /// The best net's numbers.
    best: Option<Weights>,
}

/// Steps between reports.
const REPORT_EVERY: u64 = 20;

impl<'a> Trainer<'a> {
    fn new(config: &'a TrainConfig, from: Option<Checkpoint>) -> Result<Self> {
        let device = Device::flex().autodiff();
        let optimizer = AdamWConfig::new()
            .with_weight_decay(config.weight_decay)
            .init();
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        let net = Net::new(&Net::random_layers(&mut rng)?, &device)?;
        let mut trainer = Self {
            config,
            device,
            net,
            optimizer,
            state: checkpoint::State::default(),
            best: None,
        };
        if let Some(from) = from {
            let restored = from.restore(trainer.net.clone(), trainer.optimizer.clone())?;
            (trainer.net, trainer.optimizer) = (restored.net, restored.optimizer);
            (trainer.state, trainer.best) = (from.state, from.best);
        }
        Ok(trainer)
    }

    fn run(
        &mut self,
        batches: Receiver<Result<Batch>>,
        judge_set: &[Sample],
        stop: &AtomicBool,
        observer: &mut dyn TrainObserver,
    ) -> Result<()> {
        let mut sums = [0.0; 2];
        let mut score = None;
        for batch in batches {
            let [heat, position] = self.step(&batch?)?;
            sums = [sums[0] + heat, sums[1] + position];
            let step = self.state.step;
            if step.is_multiple_of(self.config.judge_every) || step == self.config.steps {
                score = Some(self.judge(judge_set)?);
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

    /// One step of the optimizer; gives the parts of the loss.
    fn step(&mut self, batch: &Batch) -> Result<[f64; 2]> {
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
        let gradients = GradientsParams::from_grads(total.backward(), &self.net);
        let rate = self.config.rate_at(self.state.step);
        self.net = self.optimizer.step(rate, self.net.clone(), gradients);
        self.state.step += 1;
        let number = |t: Tensor<1>| Ok::<_, Error>(f64::from(floats(t)?[0]));
        Ok([number(heat)?, number(position)?])
    }

    /// Judges the net, and keeps its numbers where they are the best so far.
    fn judge(&mut self, judge_set: &[Sample]) -> Result<Score> {
        let net = self.net.valid();
        let judged = judge(&net, judge_set, &Calibration::default())?;
        let calibration = score::calibrate(&judged);
        let judged = judge(&net, judge_set, &calibration)?;
        let score = score::score(&judged, judge_set, 0.5);
        if self.best.is_none() || score.f1() > self.state.best_f1 {
            self.state.best_f1 = score.f1();
            self.state.since_best = 0;
            self.best = Some(Weights {
                layers: net.layers()?,
                meta: WeightsMeta {
                    format_version: FORMAT_VERSION,
                    calibration,
                    command: String::new(),
                    frames: self.state.step * self.config.batch as u64
                        / self.config.samples_a_frame as u64,
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

    fn finish(mut self, judge_set: &[Sample]) -> Result<Trained> {
        if self.best.is_none() {
            self.judge(judge_set)?;
        }
        let Some(weights) = self.best else {
            let problem = "stopped before the net had learned anything";
            return Err(Error::argument("train", problem));
        };
        let net = Net::new(&weights.layers, &Device::flex())?;
        let judged = judge(&net, judge_set, &weights.meta.calibration)?;
        Ok(Trained {
            score: score::score(&judged, judge_set, 0.5),
            weights,
            steps: self.state.step,
        })
    }
}

/// Runs a net on samples and judges its peaks.
fn judge(net: &Net, samples: &[Sample], calibration: &Calibration) -> Result<Vec<score::Judged>> {
    let device = Device::flex();
    let mut judged = Vec::new();
    for some in samples.chunks(JUDGED_AT_ONCE) {
        let values: Vec<f32> = some
            .iter()
            .flat_map(|s| s.patch.values())
            .copied()
            .collect();
        let patches = TensorData::new(values, [some.len(), 1, SIZE, SIZE]);
        let cells = floats(net.forward(Tensor::from_data(patches, &device)))?;
        judged.extend(score::judge(&cells, some, calibration));
    }
    Ok(judged)
}
