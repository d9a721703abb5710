//! The frames of a clip's files, one after another, read ahead or again, and worked on by all cores.

use std::collections::VecDeque;
use std::num::NonZero;

use super::config::BatchConfig;
use crate::concurrency::StopFlag;
use crate::error::{Error, Result};
use crate::pipeline::{Sink, map_ordered_within};
use crate::source::files::{self, Source};
use crate::source::{Frame, FrameSource, SourceEnd};

/// Pictures that wait, beyond one a thread.
const WAITING: usize = 2;
/// Frames that were read ahead are held up to so many bytes, or as many as wait anyway; beyond, they are read once more.
const MAX_HELD: usize = 64 << 20;

/// Pictures that are in memory at most.
fn in_flight() -> NonZero<usize> {
    let threads = rayon::current_num_threads().max(1);
    NonZero::new(threads + WAITING).unwrap_or(NonZero::<usize>::MIN)
}

/// The frames of all sources, one after another.
pub(super) struct SourceReading<'a> {
    left: std::slice::Iter<'a, &'a Source>,
    /// Frames that were read ahead.
    held: VecDeque<Frame>,
    bytes: usize,
    /// Whether these are too large to be held.
    is_too_much: bool,
    /// The source that is read, and how many frames it has handed out.
    open: Option<(Box<dyn FrameSource + Send>, usize)>,
    max_pixels: u64,
    /// What ends the reading.
    stop: Option<StopFlag>,
    /// How many frames each source had, and what it knew at its end.
    ends: Vec<(usize, SourceEnd)>,
}

impl<'a> SourceReading<'a> {
    pub fn new(sources: &'a [&'a Source], config: &BatchConfig) -> Self {
        Self {
            left: sources.iter(),
            held: VecDeque::new(),
            bytes: 0,
            is_too_much: false,
            open: None,
            max_pixels: config.max_pixels,
            stop: config.budget.stop,
            ends: Vec::new(),
        }
    }

    /// Every `step`-th of the next frames, so many of them, read ahead of those that use them: [`SourceReading::held`] has them under these numbers.
    pub fn ahead(&mut self, count: usize, step: usize) -> Result<Vec<usize>> {
        if self.is_too_much {
            self.held.clear();
        }
        let mut wanted = Vec::with_capacity(count);
        for k in 0..count * step {
            let mut frame = Frame::default();
            if !self.read(&mut frame)? {
                break;
            }
            let is_wanted = k % step == 0;
            if is_wanted {
                wanted.push(self.held.len());
            }
            if is_wanted || !self.is_too_much {
                self.bytes += frame.picture.as_ref().map_or(0, |p| p.bytes());
                self.held.push_back(frame);
            }
            self.is_too_much |= self.bytes > MAX_HELD && self.held.len() > in_flight().get();
        }
        Ok(wanted)
    }

    /// A frame that was read ahead.
    pub fn held(&self, number: usize) -> Option<&Frame> {
        self.held.get(number)
    }

    /// Whether frames that were read ahead are lost, so that the sources are to be read anew.
    pub fn is_too_much(&self) -> bool {
        self.is_too_much
    }

    fn read(&mut self, frame: &mut Frame) -> Result<bool> {
        loop {
            if self.stop.is_some_and(StopFlag::is_set) {
                return Err(Error::Stopped);
            }
            if let Some((source, count)) = &mut self.open {
                if source.next_frame(frame)? {
                    *count += 1;
                    return Ok(true);
                }
                self.ends.push((*count, source.end()));
            }
            let next = self.left.next();
            let opened = next.map(|source| files::open(source, self.max_pixels));
            self.open = opened.transpose()?.map(|source| (source, 0));
            if self.open.is_none() {
                return Ok(false);
            }
        }
    }

    /// Hands the frames, by their number over all sources, to `work` on all cores, while others are read; for
    /// each source, how many frames it has and what it knows at its end.
    pub fn each<W, T: Send>(
        mut self,
        new_workspace: impl Fn() -> W + Sync,
        work: impl Fn(usize, Frame, &mut W) -> Result<T> + Sync,
        take: impl FnMut(T),
    ) -> Result<Vec<(usize, SourceEnd)>> {
        let limit = in_flight();
        let threads = NonZero::new(limit.get().saturating_sub(WAITING)).unwrap_or(limit);
        let frames = self.frames().enumerate();
        map_ordered_within(
            limit,
            frames.map(|(number, frame)| frame.map(|frame| (number, frame))),
            threads,
            new_workspace,
            |workspace, (number, frame)| work(number, frame, workspace),
            &mut TakenFrames(take),
        )?;
        Ok(self.ends)
    }
}

impl FrameSource for SourceReading<'_> {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<bool> {
        match self.held.pop_front() {
            Some(held) => {
                *frame = held;
                Ok(true)
            }
            None => self.read(frame),
        }
    }
}

/// Takes results in their order.
struct TakenFrames<F>(F);

impl<T, F: FnMut(T)> Sink<Result<T>> for TakenFrames<F> {
    type Error = crate::Error;

    fn take(&mut self, done: Result<T>) -> Result<()> {
        (self.0)(done?);
        Ok(())
    }
}

/// The sources with one of these frames, whose numbers ascend, and the numbers of all frames of theirs.
pub(super) fn sources_with<'a>(
    sources: &'a [(Source, usize)],
    wanted: &[usize],
) -> (Vec<&'a Source>, Vec<usize>) {
    let (mut read, mut numbers) = (Vec::new(), Vec::new());
    let mut first = 0;
    for (source, count) in sources {
        let range = first..first + count;
        first = range.end;
        if wanted.iter().any(|k| range.contains(k)) {
            read.push(source);
            numbers.extend(range);
        }
    }
    (read, numbers)
}
