//! Work spread over the processor's threads, and the clock.
//!
//! With the feature `native` items are worked on in parallel by rayon, and times are those of the
//! system's monotonic clock. Without it, as in a browser, items are worked on one after another and
//! every time is zero. Results are in the order of the items either way.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

#[cfg(feature = "native")]
use rayon::prelude::*;

/// A flag that ends long work: who waits for it sets the flag, and the work looks at it now and then.
#[derive(Debug, Clone, Copy)]
pub struct StopFlag(&'static AtomicBool);

impl StopFlag {
    /// That of a flag that outlives the work.
    pub fn new(flag: &'static AtomicBool) -> Self {
        Self(flag)
    }

    /// The flag itself.
    pub fn flag(self) -> &'static AtomicBool {
        self.0
    }

    /// Whether the work is to end.
    pub fn is_set(self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

impl PartialEq for StopFlag {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self.0, other.0)
    }
}

impl Eq for StopFlag {}

/// Items that are worked on at the same time.
pub(crate) fn threads() -> usize {
    #[cfg(feature = "native")]
    return rayon::current_num_threads();
    #[cfg(not(feature = "native"))]
    return 1;
}

/// The results of `work` on every item.
pub(crate) fn map<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync + Send) -> Vec<R> {
    map_range(0..items.len() as u64, |k| work(&items[k as usize]))
}

/// The results of `work` on every number of the range.
pub(crate) fn map_range<R: Send>(
    range: Range<u64>,
    work: impl Fn(u64) -> R + Sync + Send,
) -> Vec<R> {
    let results: Vec<Mutex<Option<R>>> = range.clone().map(|_| Mutex::new(None)).collect();
    spread(results.len(), &|k| {
        let result = work(range.start + k as u64);
        *results[k].lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
    });
    let results = results.into_iter().map(Mutex::into_inner);
    let results = results.flat_map(|r| r.unwrap_or_else(PoisonError::into_inner));
    results.collect()
}

/// Works on all numbers below `count`: the one place from which threads get their share, compiled once for all kinds of work.
fn spread(count: usize, work: &(dyn Fn(usize) + Sync)) {
    #[cfg(feature = "native")]
    (0..count).into_par_iter().for_each(work);
    #[cfg(not(feature = "native"))]
    (0..count).for_each(work);
}

/// The result of `work` on the first number of the range whose result meets the condition.
pub(crate) fn find_first<R: Send>(
    range: Range<u64>,
    work: impl Fn(u64) -> R + Sync + Send,
    condition: impl Fn(&R) -> bool + Sync + Send,
) -> Option<R> {
    #[cfg(feature = "native")]
    return range.into_par_iter().map(work).find_first(condition);
    #[cfg(not(feature = "native"))]
    return range.map(work).find(condition);
}

/// Time since its start.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stopwatch {
    #[cfg(feature = "native")]
    start: std::time::Instant,
}

impl Stopwatch {
    /// Starts now.
    pub fn start() -> Self {
        Self {
            #[cfg(feature = "native")]
            start: std::time::Instant::now(),
        }
    }

    /// Time since the start; zero without a clock.
    pub fn elapsed(&self) -> Duration {
        #[cfg(feature = "native")]
        return self.start.elapsed();
        #[cfg(not(feature = "native"))]
        return Duration::ZERO;
    }
}

#[cfg(all(test, feature = "native"))]
mod tests {
    use super::*;

    #[test]
    fn the_first_that_meets_a_condition_is_the_first_on_any_number_of_threads() {
        for threads in [1, 2, 7] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = pool.build().expect("some threads");
            // The earlier a number, the later its result.
            let slow_at_first = |k: u64| {
                std::thread::sleep(Duration::from_millis(16 - k));
                k
            };
            let first = || find_first(0..16, slow_at_first, |k| k % 4 == 3);
            assert_eq!(pool.install(first), Some(3), "{threads} threads");
        }
    }
}
