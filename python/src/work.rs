//! Long work: without the interpreter's lock, on all cores, and with an ear for Ctrl-C.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::errors::value_error;

/// How often a long call listens for Ctrl-C.
const LISTEN: Duration = Duration::from_millis(50);

/// The threads of this process. A process that `fork` made has the memory of its parent's pool, but
/// none of its threads: it gets a pool of its own.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// The pool of this process' threads, one a core unless `RAYON_NUM_THREADS` says otherwise.
pub fn pool() -> PyResult<Arc<ThreadPool>> {
    let process = std::process::id();
    let mut slot = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((owner, pool)) = &*slot
        && *owner == process
    {
        return Ok(Arc::clone(pool));
    }
    let made = ThreadPoolBuilder::new()
        .build()
        .map_err(|e| value_error("threads", e))?;
    let pool = Arc::new(made);
    if let Some((_, of_parent)) = slot.replace((process, Arc::clone(&pool))) {
        // Its threads are not in this process: waiting for their end would never end.
        std::mem::forget(of_parent);
    }
    Ok(pool)
}

/// Runs `work` on the pool, without the lock.
pub fn on_all_cores<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let pool = pool()?;
    Ok(py.detach(|| pool.install(work)))
}

/// Runs `work` on a thread of the pool while this one listens for Ctrl-C. That sets the flag, and the
/// call raises once the work has ended.
pub fn interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> T + Send,
) -> PyResult<T> {
    let pool = pool()?;
    let stop = AtomicBool::new(false);
    let (done, result, raised) = py.detach(|| {
        let (sender, receiver) = std::sync::mpsc::channel();
        let mut raised = None;
        let result = std::thread::scope(|scope| {
            let (pool, stop) = (&pool, &stop);
            let worker = scope.spawn(move || {
                let result = pool.install(|| work(stop));
                // The listener may have gone only with this scope.
                let _ = sender.send(());
                result
            });
            while receiver.recv_timeout(LISTEN) == Err(std::sync::mpsc::RecvTimeoutError::Timeout) {
                if raised.is_none()
                    && let Err(error) = Python::attach(|py| py.check_signals())
                {
                    stop.store(true, Ordering::Relaxed);
                    raised = Some(error);
                }
            }
            worker.join()
        });
        ((), result, raised)
    });
    let () = done;
    match (raised, result) {
        (Some(error), _) => Err(error),
        (None, Ok(value)) => Ok(value),
        (None, Err(panic)) => std::panic::resume_unwind(panic),
    }
}
