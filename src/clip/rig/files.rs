//! The clips of a rig's cameras, in files or in memory.

use std::path::PathBuf;

use super::{CameraClip, RigConfig, RigOutcome, combine};
use crate::clip::balls::BallEstimate;
use crate::clip::batch::{Batch, BatchFrame, BatchObserver, SequenceOutcome};
use crate::clip::config::BatchConfig;
use crate::clip::run::{Pass, Watch, Watching, run_watched};
use crate::clip::sequence::{ImageWork, SequenceSummary};
use crate::clip::times::TimeSource;
use crate::clip::work::{Work, Worker};
use crate::error::{Error, Result};
use crate::image::ImageView;
use crate::source::files::{SourceList, list_sources};
use crate::vision::estimator::Estimator;
use crate::vision::frame::estimate::FrameEstimate;
use crate::vision::optics::rig::Rig;

/// What came of the clips of a rig's cameras.
#[derive(Debug, Clone)]
pub struct RigClip<K = ()> {
    /// Each camera's clip by itself, as far as the others have helped it.
    pub cameras: Vec<Batch<K>>,
    /// All together: in order of time, in the rig's frame. Nothing is kept of its pictures.
    pub together: Batch<K>,
    /// How that came about.
    pub outcome: RigOutcome,
}

/// Estimates the clips of a rig's cameras, one list of files, folders and videos for each in their order, and fuses them. `tables` has
/// for each camera one estimator a table, with that camera's intrinsics.
///
/// # Errors
/// Those of [`run`](crate::clip::run()) and [`combine`]; [`Error::Argument`] where inputs or estimators are not one list for each camera.
pub fn run_rig<O: BatchObserver>(
    rig: &Rig,
    tables: &[Vec<Estimator>],
    inputs: &[Vec<PathBuf>],
    config: &BatchConfig,
    observer: &O,
) -> Result<RigClip<O::Kept>> {
    let listed = inputs.iter().map(|inputs| list_sources(inputs));
    let listed: Vec<SourceList> = listed.collect::<Result<_>>()?;
    run_rig_sources(rig, tables, &listed, config, observer)
}

/// The same of sources, as [`run_sources`](crate::clip::run_sources) takes them: one list for each camera.
///
/// # Errors
/// Those of [`run_rig`].
pub fn run_rig_sources<O: BatchObserver>(
    rig: &Rig,
    tables: &[Vec<Estimator>],
    inputs: &[SourceList],
    config: &BatchConfig,
    observer: &O,
) -> Result<RigClip<O::Kept>> {
    let watching: Vec<Watching<'_, O>> = inputs.iter().map(|_| Watching::new(observer)).collect();
    let watchers: Vec<&dyn Watch> = watching.iter().map(|one| one as &dyn Watch).collect();
    let clip = run_watched_rig(rig, tables, inputs, config, &watchers)?;
    let cameras = clip.cameras.into_iter().zip(watching);
    let nothing = clip.together.frames.iter();
    let nothing = nothing.map(|_| O::Kept::default()).collect();
    Ok(RigClip {
        cameras: cameras
            .map(|(batch, watching)| {
                let kept = watching.kept(batch.frames.len());
                batch.keeping(kept)
            })
            .collect(),
        together: clip.together.keeping(nothing),
        outcome: clip.outcome,
    })
}

/// The same; what is kept is with the watchers, one for each list of sources.
fn run_watched_rig(
    rig: &Rig,
    tables: &[Vec<Estimator>],
    inputs: &[SourceList],
    config: &BatchConfig,
    watchers: &[&dyn Watch],
) -> Result<RigClip> {
    let count = rig.cameras().len();
    for (name, found) in [("inputs", inputs.len()), ("tables", tables.len())] {
        if found != count {
            let problem = format!(
                "expected one for each of the rig's {count} cameras ({}), found {found}",
                rig.names().join(", ")
            );
            return Err(Error::argument(name, problem));
        }
    }
    let each = tables.iter().zip(inputs).zip(watchers);
    let batches = each.map(|((tables, inputs), watcher)| {
        run_watched(Work::Poses(tables), inputs, config, *watcher)
    });
    let mut batches: Vec<Batch> = batches.collect::<Result<_>>()?;
    let mut clips: Vec<CameraClip<'_>> = batches
        .iter_mut()
        .zip(tables)
        .map(|(batch, tables)| clip_of(batch, tables))
        .collect();
    let rig_config = RigConfig {
        sequence: config.sequence,
        independent: config.independent,
        min_confidence: clips[0].estimator.config().min_confidence,
    };
    let on_images = |camera: usize, wanted: &[usize], work: &ImageWork<'_>| {
        let batch = &batches[camera];
        let table = batch.judgment.table;
        let mut pass = Pass::new(Work::Poses(&tables[camera]), config, watchers[camera]);
        pass.table = table;
        let again = |k: usize, image: ImageView<'_>, worker: &mut Worker<'_>| match worker {
            Worker::Pose(_, table, ws) => Some(vec![BallEstimate::of(work(k, image, ws)?, *table)]),
            _ => None,
        };
        let found = pass.on_pictures(&batch.sources, wanted, &again)?;
        let one =
            |(k, balls): (usize, Vec<BallEstimate>)| Some((k, balls.into_iter().next()?.frame));
        Ok::<_, Error>(found.into_iter().filter_map(one).collect())
    };
    let outcome = combine(rig, &rig_config, &mut clips, on_images)??;
    let estimates: Vec<Vec<FrameEstimate>> = clips.into_iter().map(|clip| clip.frames).collect();
    for (batch, estimates) in batches.iter_mut().zip(estimates) {
        for (frame, estimate) in batch.frames.iter_mut().zip(estimates) {
            frame.set_estimate(estimate);
        }
    }
    let together = together(&batches, &outcome, config);
    Ok(RigClip {
        cameras: batches,
        together,
        outcome,
    })
}

fn clip_of<'a>(batch: &mut Batch, tables: &'a [Estimator]) -> CameraClip<'a> {
    // Times that do not increase are none.
    let times: Option<Vec<f64>> = batch.frames.iter().map(|f| f.time_s).collect();
    let times_s = times.filter(|t| t.windows(2).all(|w| w[0] < w[1]));
    CameraClip {
        estimator: &tables[batch.judgment.table],
        names: batch.frames.iter().map(|f| f.name.clone()).collect(),
        times_s,
        frames: batch
            .frames
            .iter_mut()
            .map(BatchFrame::take_estimate)
            .collect(),
    }
}

/// The fused frames as a clip.
fn together(batches: &[Batch], outcome: &RigOutcome, config: &BatchConfig) -> Batch {
    let frames = outcome.frames.iter().map(|frame| {
        let member = (0..batches.len()).find_map(|k| batches[k].frames.get(frame.members[k]?));
        BatchFrame {
            name: frame.name.clone(),
            path: member.map(|m| m.path.clone()).unwrap_or_default(),
            time_s: frame.time_s,
            first_row_s: None,
            balls: vec![BallEstimate::of(frame.estimate.clone(), 0)],
            size: member.and_then(|m| m.size),
            // A file that cannot be read is a matter of its camera's clip.
            unreadable: None,
            kept: (),
        }
    });
    let is_timed = outcome.frames.len() > 1 && outcome.frames.iter().all(|f| f.time_s.is_some());
    let sequence = match is_timed {
        false => SequenceOutcome::NoTimes,
        true => SequenceOutcome::Estimated {
            summary: SequenceSummary {
                alone: batches.iter().map(Batch::independent).max().unwrap_or(0),
                together: outcome.answered(),
            },
            spin: outcome.spin(&config.sequence),
        },
    };
    // That of the camera that says most; of the others the doubts say what there is.
    let most = batches.iter().max_by_key(|batch| batch.identified());
    Batch {
        frames: frames.collect(),
        sequence,
        judgment: most.map(|batch| batch.judgment.clone()).unwrap_or_default(),
        focal_doubt: None,
        times: if is_timed {
            batches[0].times
        } else {
            TimeSource::None
        },
        skipped: batches.iter().flat_map(|b| b.skipped.clone()).collect(),
        cut_short: batches.iter().flat_map(|b| b.cut_short.clone()).collect(),
        sources: batches[0].sources.clone(),
    }
}
