//! Checkpoint of a training: a zip of the net and the optimizer's moments (burn's burnpack), the
//! best weights (`.npz`) and the rest as JSON.

use std::io::{Cursor, Read, Write};
use std::path::Path;

use burn::module::Module;
use burn::optim::{AdamWConfig, ModuleOptimizer, OptimizerRecord};
use burn::store::ModuleRecord;
use burn::tensor::{Bytes, Device};
use serde::{Deserialize, Serialize};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

use spindoe::vision::net::weights::{Layer, Weights};
use spindoe::{Error, Result, files};

use crate::TrainConfig;
use crate::model::Net;

/// Maximum size of an entry.
const MAX_BYTES: u64 = 64 << 20;

/// Progress of a training.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct State {
    /// Steps done.
    pub step: u64,
    /// The best net's [`Score::quality`](crate::Score::quality).
    pub best_quality: f64,
    /// Evaluations since.
    pub since_best: usize,
}

/// All that is needed to continue a training.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// The progress.
    pub state: State,
    /// The best weights so far.
    pub best: Option<Weights>,
    config: TrainConfig,
    net: Vec<u8>,
    optimizer: Vec<u8>,
}

/// A restored net and its optimizer.
pub(crate) struct Restored {
    pub net: Net,
    pub optimizer: ModuleOptimizer,
}

#[derive(Serialize, Deserialize)]
struct StateFile {
    config: TrainConfig,
    state: State,
}

impl Checkpoint {
    pub(crate) fn of(
        config: &TrainConfig,
        net: &Net,
        optimizer: &ModuleOptimizer,
        state: State,
        best: Option<Weights>,
    ) -> Result<Self> {
        let packed = |e: &dyn std::fmt::Display| {
            Error::Internal(format!("the checkpoint cannot be packed: {e}"))
        };
        let record = net.clone().into_record().into_bytes();
        // The optimizer hands its moments out in any order; a record that was read has them by name, so
        // that the same training gives the same file.
        let moments = optimizer
            .into_bytes()
            .and_then(OptimizerRecord::from_bytes)
            .and_then(OptimizerRecord::into_bytes);
        Ok(Self {
            state,
            best,
            config: config.clone(),
            net: record.map_err(|e| packed(&e))?.to_vec(),
            optimizer: moments.map_err(|e| packed(&e))?.to_vec(),
        })
    }

    pub(crate) fn restore(&self, net: Net, optimizer: ModuleOptimizer) -> Result<Restored> {
        let reject = |e: &dyn std::fmt::Display| {
            Error::argument("checkpoint", format!("not that of this net: {e}"))
        };
        let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(self.net.clone()))
            .map_err(|e| reject(&e))?;
        let optimizer = optimizer
            .from_bytes(Bytes::from_bytes_vec(self.optimizer.clone()))
            .map_err(|e| reject(&e))?;
        Ok(Restored {
            net: net.try_load_record(record).map_err(|e| reject(&e))?,
            optimizer,
        })
    }

    /// The current parameters of the net.
    ///
    /// # Errors
    /// [`Error::Argument`] where the checkpoint is not that of this net.
    pub fn layers(&self) -> Result<Vec<Layer>> {
        let head = self.config.head;
        let blank: Vec<Layer> = head
            .convolutions()
            .iter()
            .map(|c| Layer {
                weight: vec![0.0; c.weights()],
                bias: vec![0.0; c.outputs],
            })
            .collect();
        let net = Net::new(head, &blank, &Device::flex())?;
        self.restore(net, AdamWConfig::new().init())?.net.layers()
    }

    /// Writes the checkpoint atomically.
    ///
    /// # Errors
    /// [`Error::Write`] on an I/O failure.
    pub fn write(&self, path: &Path) -> Result<()> {
        let packed = |e: &dyn std::fmt::Display| {
            Error::Internal(format!("the checkpoint cannot be packed: {e}"))
        };
        let head = StateFile {
            config: self.config.clone(),
            state: self.state,
        };
        let mut entries = vec![
            (
                "state.json",
                serde_json::to_vec(&head).map_err(|e| packed(&e))?,
            ),
            ("net.bpk", self.net.clone()),
            ("optimizer.bpk", self.optimizer.clone()),
        ];
        if let Some(best) = &self.best {
            entries.push(("best.npz", best.to_npz()?));
        }
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .last_modified_time(DateTime::default());
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in entries {
            zip.start_file(name, options).map_err(|e| packed(&e))?;
            zip.write_all(&bytes).map_err(|e| packed(&e))?;
        }
        let bytes = zip.finish().map_err(|e| packed(&e))?.into_inner();
        files::write_bytes(path, &bytes)
    }

    /// Reads a checkpoint of a training with this configuration; the number of steps may differ.
    ///
    /// # Errors
    /// [`Error::Read`] on an I/O failure; [`Error::Input`] where it is no checkpoint, or that of
    /// another training.
    pub fn read(path: &Path, config: &TrainConfig) -> Result<Self> {
        let bytes = files::read_bytes(path)?;
        let reject = |place: &str, e: &dyn std::fmt::Display| {
            Error::input(path, place, format!("not a training's checkpoint: {e}"))
        };
        let mut zip =
            ZipArchive::new(Cursor::new(bytes.as_slice())).map_err(|e| reject("archive", &e))?;
        let mut entry = |name: &str| -> Result<Vec<u8>> {
            let file = zip.by_name(name).map_err(|e| reject(name, &e))?;
            let mut bytes = Vec::new();
            file.take(MAX_BYTES)
                .read_to_end(&mut bytes)
                .map_err(|e| reject(name, &e))?;
            Ok(bytes)
        };
        let head: StateFile =
            serde_json::from_slice(&entry("state.json")?).map_err(|e| reject("state.json", &e))?;
        let same = TrainConfig {
            steps: config.steps,
            ..head.config.clone()
        };
        if same != *config {
            let problem = "expected the checkpoint of a training with the same options";
            return Err(Error::input(path, "state.json", problem));
        }
        let best = match entry("best.npz") {
            Ok(bytes) => Some(Weights::from_npz(path, &bytes)?),
            Err(_) => None,
        };
        Ok(Self {
            state: head.state,
            best,
            config: config.clone(),
            net: entry("net.bpk")?,
            optimizer: entry("optimizer.bpk")?,
        })
    }
}
