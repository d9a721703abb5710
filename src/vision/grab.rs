//! Frames of a camera that does not wait: a thread takes them as they arrive, stamps them, and keeps the newest.
//!
//! A frame's time is that of its last byte, whenever it is looked at. Where all frames are to be kept, the camera waits while the
//! queue is full; else the oldest one in it is dropped, and counted.
//!
//! Guarantees: frames come in their order, each at most once; memory is that of [`QUEUE`] frames and two. Not guaranteed: that
//! times are the exposure's. What lies between is the camera's and the pipe's.

use std::collections::VecDeque;
use std::io::BufRead;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::estimator::FrameImage;
use super::pipe::{FrameBuffer, PipeReader};
use crate::error::{Error, Result};

/// Frames that wait at most: a slow one among fast ones loses none.
pub const QUEUE: usize = 8;

/// What becomes of frames that arrive while the queue is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WhenFull {
    /// The camera waits: its frames have times of their own.
    Wait,
    /// The oldest in the queue is dropped.
    DropOldest,
}

/// Takes frames from a pipe in a thread of its own, which ends with the pipe.
#[derive(Debug)]
pub struct Grabber {
    shared: Arc<Shared>,
    current: Taken,
}

/// A frame and its number, the dropped ones counted.
#[derive(Debug, Default)]
struct Taken {
    number: u64,
    buffer: FrameBuffer,
}

/// A frame that was taken.
#[derive(Debug, Clone, Copy)]
pub struct Grabbed<'a> {
    /// Its number among all that arrived, from 0.
    pub number: u64,
    /// When its last byte had arrived.
    pub arrived: Instant,
    /// The frame.
    pub image: FrameImage<'a>,
}

#[derive(Debug, Default)]
struct Shared {
    queue: Mutex<Queue>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Queue {
    waiting: VecDeque<Taken>,
    /// Buffers that are free.
    free: Vec<FrameBuffer>,
    dropped: u64,
    /// Why the pipe ended, if it did.
    end: Option<Result<()>>,
    /// Whether nobody listens any more.
    is_closed: bool,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Queue> {
        // Nothing is left half done under the lock.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(&self, queue: MutexGuard<'a, Queue>) -> MutexGuard<'a, Queue> {
        self.changed
            .wait(queue)
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a frame; false where nobody listens.
    fn push(&self, frame: Taken, when_full: WhenFull) -> bool {
        let mut queue = self.lock();
        while queue.waiting.len() >= QUEUE && !queue.is_closed {
            match when_full {
                WhenFull::Wait => queue = self.wait(queue),
                WhenFull::DropOldest => {
                    let oldest = queue.waiting.pop_front();
                    queue.free.extend(oldest.map(|frame| frame.buffer));
                    queue.dropped += 1;
                }
            }
        }
        queue.waiting.push_back(frame);
        self.changed.notify_all();
        !queue.is_closed
    }

    fn end(&self, why: Result<()>) {
        self.lock().end = Some(why);
        self.changed.notify_all();
    }
}

impl Grabber {
    /// Begins to take frames.
    ///
    /// # Errors
    /// [`Error::Internal`] where no thread can be started.
    pub fn start<R>(mut reader: PipeReader<R>, when_full: WhenFull) -> Result<Self>
    where
        R: BufRead + Send + 'static,
    {
        let shared = Arc::new(Shared::default());
        let theirs = Arc::clone(&shared);
        let grab = move || {
            for number in 0.. {
                let mut buffer = theirs.lock().free.pop().unwrap_or_default();
                match reader.next_into(&mut buffer) {
                    Ok(true) => {
                        if !theirs.push(Taken { number, buffer }, when_full) {
                            return;
                        }
                    }
                    Ok(false) => return theirs.end(Ok(())),
                    Err(error) => return theirs.end(Err(error)),
                }
            }
        };
        std::thread::Builder::new()
            .name("grabber".to_owned())
            .spawn(grab)
            .map_err(|error| Error::Internal(format!("no thread for frames: {error}")))?;
        Ok(Self {
            shared,
            current: Taken::default(),
        })
    }

    /// The next frame, once it is there; `None` at the end of the pipe.
    ///
    /// # Errors
    /// As [`PipeReader::next_frame`], after the frames that came before.
    pub fn next_frame(&mut self) -> Result<Option<Grabbed<'_>>> {
        let mut queue = self.shared.lock();
        let frame = loop {
            if let Some(frame) = queue.waiting.pop_front() {
                break frame;
            }
            if let Some(end) = queue.end.take() {
                queue.end = Some(Ok(()));
                return end.map(|()| None);
            }
            queue = self.shared.wait(queue);
        };
        let before = std::mem::replace(&mut self.current, frame);
        queue.free.push(before.buffer);
        drop(queue);
        self.shared.changed.notify_all();
        let Taken { number, buffer } = &self.current;
        Ok(Some(Grabbed {
            number: *number,
            arrived: buffer.arrived(),
            image: buffer.image()?,
        }))
    }

    /// Number of frames that were dropped so far.
    pub fn dropped(&self) -> u64 {
        self.shared.lock().dropped
    }
}

impl Drop for Grabber {
    fn drop(&mut self) {
        self.shared.lock().is_closed = true;
        self.shared.changed.notify_all();
    }
}
