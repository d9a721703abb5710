//! `spindoe export`: the dot detector for other programs.

use std::path::PathBuf;

use clap::Args;

use crate::error::Result;
use crate::files;
use crate::vision::net::graph::Head;
use crate::vision::net::{Weights, onnx};

#[derive(Debug, Args)]
pub struct Arguments {
    /// Where to write the net, ONNX.
    #[arg(short, long, value_name = "FILE.onnx")]
    out: PathBuf,
    /// The large net that looks again at frames in doubt.
    #[arg(long, conflicts_with = "weights")]
    large: bool,
    /// Weights made by `python -m train` (.npz); by default those built in.
    #[arg(long, value_name = "WEIGHTS.npz")]
    weights: Option<PathBuf>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let weights = match &arguments.weights {
        Some(path) => Weights::read(path)?,
        None if arguments.large => Weights::built_in(Head::DotsLarge)?,
        None => Weights::built_in(Head::Dots)?,
    };
    files::write_bytes(&arguments.out, &onnx::to_onnx(&weights))?;
    outln!("{}", arguments.out.display());
    Ok(())
}
