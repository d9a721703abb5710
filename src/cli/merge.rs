//! `spindoe merge`: one design of the shards that several machines searched.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;

use super::design::print_words;
use super::interrupt::{keeps, stop_on_interrupt};
use super::output::{Progress, command_line};
use super::print_json;
use crate::design::{DesignConfig, DesignObserver, SearchState, Stage};
use crate::error::Result;
use crate::report::{CHECKPOINT, DesignJob, JobObserver, JobStart, ShardedJob};

#[derive(Debug, Args)]
#[command(after_help = "\
The shards must be all of one search, and finished. Their finalists meet in the last trial, on trials that no
shard has drawn; the winner is evaluated and written as by `spindoe design`. `spindoe design --config shards=N` gives
the same files.

Example, on eight machines and then on one:
  spindoe design --seed 7 --shard 3/8 -o shard-3
  spindoe merge shard-* -o my-ball")]
pub struct Arguments {
    /// The shards: their folders, or the `search.json` in them.
    #[arg(value_name = "SHARD", required = true)]
    shards: Vec<PathBuf>,
    /// The folder to write to.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Continue a merge of these shards that was interrupted; begin one where none has begun.
    #[arg(long)]
    resume: bool,
    /// Print the report as one JSON object on standard output.
    #[arg(long)]
    json: bool,
}

/// Minimum time between plain lines.
const SILENCE: Duration = Duration::from_secs(2);

/// Says what is done.
struct MergeProgress {
    command: Option<String>,
    line: Progress,
}

impl DesignObserver for MergeProgress {
    fn progress(&mut self, state: &SearchState, _: Stage) -> Result<()> {
        let what = format!("last trial of {} finalists", state.pool.len());
        self.line.show(0, &what, String::new);
        Ok(())
    }
}

impl JobObserver for MergeProgress {
    fn step(&mut self, what: &str) -> Result<()> {
        self.line.say(0, what);
        Ok(())
    }

    fn command(&self, _: &DesignConfig) -> Option<String> {
        self.command.clone()
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let ShardedJob { job, command } = DesignJob::of_shards(&arguments.shards, &arguments.output)?;
    let stop = stop_on_interrupt(super::design::STOPPING)?;
    let resume = if arguments.resume { "" } else { " --resume" };
    keeps(
        job.dir.join(CHECKPOINT),
        format!(
            "the merge is kept; this continues it: {}{resume}",
            command_line()
        ),
    );
    let clock = Instant::now();
    let mut progress = MergeProgress {
        command,
        line: Progress::new(1, "{gone}  {wide_msg}", SILENCE),
    };
    let start = match arguments.resume {
        true => JobStart::Resume,
        false => JobStart::Fresh,
    };
    let found = job.merge(&arguments.shards, start, &stop, &mut progress)?;
    progress.line.finish();
    if arguments.json {
        return print_json(&found.report);
    }
    print_words(&found, clock.elapsed().as_secs_f64());
    outln!("{}", job.dir.display());
    Ok(())
}
