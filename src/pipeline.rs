//! Work on a stream of items, on several threads, in order and in bounded memory.
//!
//! [`map_ordered`] reads items on one thread, works on them on others, and passes the results on in
//! the items' order. No thread waits for a batch to fill. A worker takes a share of the items that
//! are ready, so that the others have work too. A result leaves as soon as it and all results
//! before it are done. A slow input thus gets each answer at once, and a fast one keeps all threads
//! busy.
//!
//! Guarantees: the results and their order do not depend on the number of threads, as long as the
//! work on an item depends on the item alone; at most [`MAX_IN_FLIGHT`] items are held at any time;
//! an error of the input comes after the results of all items before it.
//!
//! Not guaranteed: an immediate end after an error of the sink. The call ends when the input's next
//! item arrives.
//!
//! ```
//! use spindoe::pipeline::{Sink, map_ordered};
//!
//! struct Collect(Vec<u64>);
//! impl Sink<u64> for Collect {
//!     type Error = std::convert::Infallible;
//!     fn take(&mut self, item: u64) -> Result<(), Self::Error> {
//!         self.0.push(item);
//!         Ok(())
//!     }
//! }
//!
//! let mut squares = Collect(Vec::new());
//! let threads = std::num::NonZero::<usize>::MIN;
//! map_ordered((1..=3).map(Ok), threads, || (), |(), n: u64| n * n, &mut squares).unwrap();
//! assert_eq!(squares.0, [1, 4, 9]);
//! ```

use std::collections::VecDeque;
use std::num::NonZero;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Maximum number of items that are read and whose results are not passed on yet.
pub const MAX_IN_FLIGHT: usize = 1024;
/// Maximum number of items that a worker takes at once.
const MAX_SHARE: usize = 32;

/// Where results go.
pub trait Sink<T> {
    /// The sink's error.
    type Error;

    /// Takes the next result.
    ///
    /// # Errors
    /// Those of the sink; then it gets no more.
    fn take(&mut self, item: T) -> Result<(), Self::Error>;

    /// Called before each wait for results: the time to flush.
    ///
    /// # Errors
    /// Those of the sink; then it gets no more.
    fn idle(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// Passes `work(item)` for every item of `input` to `sink`, in order, on `threads` threads beside
/// the reading thread and the calling thread, on which `sink` runs. Each worker has a `workspace`
/// of its own.
///
/// # Errors
/// The first error of the input, after the results before it; or that of the sink.
///
/// # Panics
/// Where one of the functions given does.
pub fn map_ordered<T, W, O, E>(
    input: impl Iterator<Item = Result<T, E>> + Send,
    threads: NonZero<usize>,
    workspace: impl Fn() -> W + Sync,
    work: impl Fn(&mut W, T) -> O + Sync,
    sink: &mut impl Sink<O, Error = E>,
) -> Result<(), E>
where
    T: Send,
    O: Send,
    E: Send,
{
    let limit = NonZero::new(MAX_IN_FLIGHT).unwrap_or(NonZero::<usize>::MIN);
    map_ordered_within(limit, input, threads, workspace, work, sink)
}

/// As [`map_ordered`], for large items: at most `limit` of them are read and not yet passed on, and
/// one more waits to be one of them.
///
/// # Errors
/// As [`map_ordered`].
///
/// # Panics
/// As [`map_ordered`].
pub fn map_ordered_within<T, W, O, E>(
    limit: NonZero<usize>,
    input: impl Iterator<Item = Result<T, E>> + Send,
    threads: NonZero<usize>,
    workspace: impl Fn() -> W + Sync,
    work: impl Fn(&mut W, T) -> O + Sync,
    sink: &mut impl Sink<O, Error = E>,
) -> Result<(), E>
where
    T: Send,
    O: Send,
    E: Send,
{
    let line = &OrderedQueue {
        limit: limit.get(),
        state: Mutex::new(QueueState::default()),
        work: Condvar::new(),
        results: Condvar::new(),
        space: Condvar::new(),
    };
    let (workspace, work) = (&workspace, &work);
    std::thread::scope(|scope| {
        let reader = scope.spawn(move || {
            let _guard = StopOnPanic(line);
            line.read(input)
        });
        for _ in 0..threads.get() {
            scope.spawn(move || {
                let _guard = StopOnPanic(line);
                line.work(&mut workspace(), work, threads);
            });
        }
        let _guard = StopOnPanic(line);
        let taken = line.hand_on(sink);
        if taken.is_err() {
            line.stop();
        }
        let read = match reader.join() {
            Ok(read) => read,
            Err(panic) => std::panic::resume_unwind(panic),
        };
        taken.and(read)
    })
}

/// What the threads share.
struct OrderedQueue<T, O> {
    /// Maximum number of items in flight.
    limit: usize,
    state: Mutex<QueueState<T, O>>,
    /// There are items, or there will be no more.
    work: Condvar,
    /// The next result is there, or there will be no more.
    results: Condvar,
    /// There is capacity for another item.
    space: Condvar,
}

struct QueueState<T, O> {
    /// Items not yet taken by a worker; the first of them has number `read - items.len()`.
    items: VecDeque<T>,
    /// Results not passed on yet, from number `handed_on`; `None` where one is in progress.
    results: VecDeque<Option<O>>,
    /// Number of items read.
    read: usize,
    /// Number of results passed on.
    handed_on: usize,
    /// No more items will come.
    ended: bool,
    /// No more results are wanted.
    stopped: bool,
    /// Workers that wait for items.
    waiting: usize,
}

impl<T, O> Default for QueueState<T, O> {
    fn default() -> Self {
        Self {
            items: VecDeque::new(),
            results: VecDeque::new(),
            read: 0,
            handed_on: 0,
            ended: false,
            stopped: false,
            waiting: 0,
        }
    }
}

impl<T, O> OrderedQueue<T, O> {
    fn lock(&self) -> MutexGuard<'_, QueueState<T, O>> {
        // A panicked thread has ended the stream, and the scope propagates its panic.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn stop(&self) {
        self.lock().stopped = true;
        self.work.notify_all();
        self.results.notify_all();
        self.space.notify_all();
    }

    /// Reads items until their end or an error.
    fn read<E>(&self, input: impl Iterator<Item = Result<T, E>>) -> Result<(), E> {
        let mut outcome = Ok(());
        for item in input {
            let item = match item {
                Ok(item) => item,
                Err(error) => {
                    outcome = Err(error);
                    break;
                }
            };
            let mut state = self.lock();
            while state.read - state.handed_on >= self.limit && !state.stopped {
                state = wait(&self.space, state);
            }
            if state.stopped {
                break;
            }
            state.items.push_back(item);
            state.read += 1;
            let is_awaited = state.waiting > 0;
            drop(state);
            if is_awaited {
                self.work.notify_one();
            }
        }
        self.lock().ended = true;
        self.work.notify_all();
        self.results.notify_all();
        outcome
    }

    /// Works on items until there are no more.
    fn work<W>(&self, ws: &mut W, work: &impl Fn(&mut W, T) -> O, threads: NonZero<usize>) {
        let mut share: Vec<T> = Vec::new();
        let mut done: Vec<O> = Vec::new();
        loop {
            let mut state = self.lock();
            while state.items.is_empty() && !state.ended && !state.stopped {
                state.waiting += 1;
                state = wait(&self.work, state);
                state.waiting -= 1;
            }
            if state.stopped || state.items.is_empty() {
                return;
            }
            let first = state.read - state.items.len();
            let count = state.items.len().div_ceil(threads.get()).min(MAX_SHARE);
            share.extend(state.items.drain(..count));
            drop(state);

            done.extend(share.drain(..).map(|item| work(ws, item)));

            let mut state = self.lock();
            let place = first - state.handed_on;
            if state.results.len() < place + count {
                state.results.resize_with(place + count, || None);
            }
            for (result, slot) in done.drain(..).zip(state.results.range_mut(place..)) {
                *slot = Some(result);
            }
            drop(state);
            if place == 0 {
                self.results.notify_one();
            }
        }
    }

    /// Passes results on until there are no more.
    fn hand_on<S: Sink<O>>(&self, sink: &mut S) -> Result<(), S::Error> {
        let mut ready: Vec<O> = Vec::new();
        loop {
            let mut state = self.lock();
            let mut is_idle = false;
            loop {
                while let Some(Some(_)) = state.results.front() {
                    ready.extend(state.results.pop_front().flatten());
                    state.handed_on += 1;
                }
                let is_over = state.ended && state.handed_on == state.read;
                if !ready.is_empty() || is_over || state.stopped {
                    break;
                }
                if is_idle {
                    state = wait(&self.results, state);
                } else {
                    // Not while the others wait for the lock.
                    drop(state);
                    sink.idle()?;
                    is_idle = true;
                    state = self.lock();
                }
            }
            drop(state);
            if ready.is_empty() {
                return sink.idle();
            }
            self.space.notify_one();
            for result in ready.drain(..) {
                sink.take(result)?;
            }
        }
    }
}

fn wait<'a, S>(condition: &Condvar, guard: MutexGuard<'a, S>) -> MutexGuard<'a, S> {
    condition
        .wait(guard)
        .unwrap_or_else(PoisonError::into_inner)
}

/// Wakes all waiting threads if this thread panics.
struct StopOnPanic<'a, T, O>(&'a OrderedQueue<T, O>);

impl<T, O> Drop for StopOnPanic<'_, T, O> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop();
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::mpsc;

    /// Keeps what it gets; fails at the result number `fails_at`.
    #[derive(Default)]
    struct FailingSink {
        items: Vec<usize>,
        idle: usize,
        fails_at: Option<usize>,
    }

    impl Sink<usize> for FailingSink {
        type Error = String;

        fn take(&mut self, item: usize) -> Result<(), String> {
            if self.fails_at == Some(self.items.len()) {
                return Err("full".into());
            }
            self.items.push(item);
            Ok(())
        }

        fn idle(&mut self) -> Result<(), String> {
            self.idle += 1;
            Ok(())
        }
    }

    fn threads(n: usize) -> NonZero<usize> {
        NonZero::new(n).unwrap()
    }

    /// Takes longer for some items than for others.
    fn uneven(n: usize) -> usize {
        (0..(n * 7919) % 1000).fold(n, |a, b| std::hint::black_box(a ^ b ^ b))
    }

    #[test]
    fn results_come_in_order_on_any_number_of_threads() {
        for n in [1, 2, 3, 8] {
            for count in [0, 1, 31, 5000] {
                let mut kept = FailingSink::default();
                let input = (0..count).map(Ok);
                map_ordered(input, threads(n), || (), |(), i| uneven(i), &mut kept).unwrap();
                assert!(kept.items.iter().copied().eq(0..count), "{n} threads");
            }
        }
    }

    #[test]
    fn no_more_than_the_limit_is_held() {
        let (read, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
        struct Slow<'a>(&'a AtomicUsize, &'a AtomicUsize, usize);
        impl Sink<usize> for Slow<'_> {
            type Error = String;
            fn take(&mut self, _: usize) -> Result<(), String> {
                let held = self.0.load(Ordering::SeqCst) - self.1.fetch_add(1, Ordering::SeqCst);
                self.2 = self.2.max(held);
                std::thread::yield_now();
                Ok(())
            }
        }
        let mut slow = Slow(&read, &done, 0);
        let input = (0..20_000).map(|i| {
            read.fetch_add(1, Ordering::SeqCst);
            Ok(i)
        });
        map_ordered(input, threads(4), || (), |(), i| i, &mut slow).unwrap();
        // Those in flight, the one that waits for capacity, and those in the sink.
        assert!(slow.2 <= 2 * MAX_IN_FLIGHT + 1, "{}", slow.2);
        assert!(slow.2 > 0);
    }

    #[test]
    fn a_result_comes_before_the_next_item() {
        struct Ask(mpsc::Sender<usize>);
        impl Sink<usize> for Ask {
            type Error = String;
            fn take(&mut self, item: usize) -> Result<(), String> {
                // The last one is never requested.
                let _ = self.0.send(item);
                Ok(())
            }
        }
        let (answer, answers) = mpsc::channel();
        // Every item but the first waits for the result of the one before it.
        let input = (0..100).map(move |i| match i {
            0 => Ok(0),
            _ => {
                let before = answers.recv().map_err(|e| e.to_string())?;
                assert_eq!(before, i - 1);
                Ok(i)
            }
        });
        map_ordered(input, threads(3), || (), |(), i| i, &mut Ask(answer)).unwrap();
    }

    #[test]
    fn errors_come_after_the_results_before_them() {
        for n in [1, 4] {
            let mut kept = FailingSink::default();
            let input = (0..100).map(|i| {
                if i == 60 {
                    Err("bad".to_owned())
                } else {
                    Ok(i)
                }
            });
            let outcome = map_ordered(input, threads(n), || (), |(), i| i, &mut kept);
            assert_eq!(outcome, Err("bad".into()));
            assert!(kept.items.into_iter().eq(0..60));
        }
    }

    #[test]
    fn a_sink_that_fails_ends_it() {
        let mut kept = FailingSink {
            fails_at: Some(10),
            ..FailingSink::default()
        };
        let outcome = map_ordered((0..).map(Ok), threads(2), || (), |(), i| i, &mut kept);
        assert_eq!(outcome, Err("full".into()));
        assert_eq!(kept.items.len(), 10);
    }

    #[test]
    #[should_panic(expected = "panicked")]
    fn a_worker_that_panics_leaves_nobody_waiting() {
        let work = |(): &mut (), i: usize| if i == 500 { panic!("at 500") } else { i };
        let mut kept = FailingSink::default();
        let _ = map_ordered((0..).map(Ok), threads(3), || (), work, &mut kept);
    }
}
