//! Frames of a camera that does not wait: they are taken as they arrive, stamped, and the newest are kept.
//!
//! A [`Grabber`] reads them from any source in a thread of its own; a camera that calls back pushes them itself
//! ([`queue`]). A frame's time is that of its arrival, whenever it is looked at. Where all frames are to be kept, the
//! camera waits while the queue is full; else the oldest one in it is dropped, and counted.
//!
//! Guarantees: frames come in their order, each at most once; memory is that of [`QUEUE`] frames and two, and it is
//! reused. Not guaranteed: that times are the exposure's. What lies between is the camera's and the pipe's.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::{Frame, FrameSource};
use crate::error::{Error, Result};
use crate::image::Picture;

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

/// Takes frames in a thread of its own, which ends with their source.
#[derive(Debug)]
pub struct Grabber {
    shared: Arc<SharedPictures>,
}

/// Where a camera's frames go in.
#[derive(Debug)]
pub struct FramePusher {
    shared: Arc<SharedPictures>,
    when_full: WhenFull,
    /// The number of the next frame.
    next: u64,
    /// When the first one was there.
    begun: Option<Instant>,
}

#[derive(Debug, Default)]
struct SharedPictures {
    queue: Mutex<Queue>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Queue {
    waiting: VecDeque<Frame>,
    /// Memory that is free.
    free: Vec<Frame>,
    dropped: u64,
    /// Why the source ended, if it did.
    end: Option<Result<()>>,
    /// Whether nobody listens any more.
    is_closed: bool,
}

impl SharedPictures {
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
    fn push(&self, frame: Frame, when_full: WhenFull) -> bool {
        let mut queue = self.lock();
        while queue.waiting.len() >= QUEUE && !queue.is_closed {
            match when_full {
                WhenFull::Wait => queue = self.wait(queue),
                WhenFull::DropOldest => {
                    let oldest = queue.waiting.pop_front();
                    queue.free.extend(oldest);
                    queue.dropped += 1;
                }
            }
        }
        queue.waiting.push_back(frame);
        self.changed.notify_all();
        !queue.is_closed
    }

    fn end(&self, why: Result<()>) {
        self.lock().end.get_or_insert(why);
        self.changed.notify_all();
    }
}

/// A queue between a camera that calls back and who looks at its frames, which end when the pusher is dropped.
pub fn queue(when_full: WhenFull) -> (FramePusher, Grabber) {
    let shared = Arc::new(SharedPictures::default());
    let pusher = FramePusher {
        shared: Arc::clone(&shared),
        when_full,
        next: 0,
        begun: None,
    };
    (pusher, Grabber { shared })
}

impl FramePusher {
    /// Adds a frame that arrives now; `fill` writes its pixels over those of an earlier one. False where nobody
    /// listens any more.
    pub fn push(&mut self, fill: impl FnOnce(&mut Picture)) -> bool {
        let mut frame = self.shared.lock().free.pop().unwrap_or_default();
        frame.arrived = Instant::now();
        frame.number = self.next;
        self.next += 1;
        let begun = *self.begun.get_or_insert(frame.arrived);
        frame.time_s = Some(frame.arrived.duration_since(begun).as_secs_f64());
        let mut picture = frame.picture.unwrap_or_default();
        fill(&mut picture);
        frame.picture = Ok(picture);
        self.shared.push(frame, self.when_full)
    }
}

impl Drop for FramePusher {
    fn drop(&mut self) {
        self.shared.end(Ok(()));
    }
}

impl Grabber {
    /// Begins to take frames.
    ///
    /// # Errors
    /// [`Error::Internal`] where no thread can be started.
    pub fn start<S>(mut source: S, when_full: WhenFull) -> Result<Self>
    where
        S: FrameSource + Send + 'static,
    {
        let (pusher, grabber) = queue(when_full);
        let grab = move || {
            let shared = &pusher.shared;
            loop {
                let mut frame = shared.lock().free.pop().unwrap_or_default();
                match source.next_frame(&mut frame) {
                    Ok(true) => {
                        if !shared.push(frame, when_full) {
                            return;
                        }
                    }
                    Ok(false) => return,
                    Err(error) => return shared.end(Err(error)),
                }
            }
        };
        std::thread::Builder::new()
            .name("grabber".to_owned())
            .spawn(grab)
            .map_err(|error| Error::Internal(format!("no thread for frames: {error}")))?;
        Ok(grabber)
    }

    /// Number of frames that were dropped so far.
    pub fn dropped(&self) -> u64 {
        self.shared.lock().dropped
    }
}

impl FrameSource for Grabber {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<bool> {
        let mut queue = self.shared.lock();
        let next = loop {
            if let Some(next) = queue.waiting.pop_front() {
                break next;
            }
            if let Some(end) = queue.end.take() {
                queue.end = Some(Ok(()));
                return end.map(|()| false);
            }
            queue = self.shared.wait(queue);
        };
        let before = std::mem::replace(frame, next);
        queue.free.push(before);
        drop(queue);
        self.shared.changed.notify_all();
        Ok(true)
    }
}

impl Drop for Grabber {
    fn drop(&mut self) {
        self.shared.lock().is_closed = true;
        self.shared.changed.notify_all();
    }
}
