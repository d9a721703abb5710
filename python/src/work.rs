//! Long work: without the interpreter's lock, on all cores, and with an ear for Ctrl-C.
//!
//! All of it runs on a pool of this process ([`pool`]): the library's own threads are not in a process that `fork` made. Ctrl-C raises
//! within [`LISTEN`]: work that borrows from Python ([`interruptible`]) is asked to end by a flag that it looks at often, other work
//! ([`abandonable`]) is left to end by itself.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use spindoe::StopFlag;

use crate::errors::value_error;

/// How often a long call listens for Ctrl-C.
const LISTEN: Duration = Duration::from_millis(50);

/// The threads of this process. A process that `fork` made has the memory of its parent's pool, but
/// none of its threads: it gets a pool of its own.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);
/// Flags that no work uses: they outlive it, since what is abandoned still looks at its own.
static FLAGS: Mutex<Vec<&'static AtomicBool>> = Mutex::new(Vec::new());

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
        // Who waits hears of it by the end of the channel.
        .panic_handler(|_| {})
        .build()
        .map_err(|e| value_error("threads", e))?;
    let pool = Arc::new(made);
    if let Some((_, of_parent)) = slot.replace((process, Arc::clone(&pool))) {
        // Its threads are not in this process: waiting for their end would never end.
        std::mem::forget(of_parent);
    }
    Ok(pool)
}

/// A flag of its own for some work, which goes back when the work has ended.
struct Flag(&'static AtomicBool);

impl Flag {
    fn take() -> Self {
        let mut free = FLAGS.lock().unwrap_or_else(PoisonError::into_inner);
        let flag = free.pop();
        Self(flag.unwrap_or_else(|| Box::leak(Box::new(AtomicBool::new(false)))))
    }
}

impl Drop for Flag {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
        FLAGS
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(self.0);
    }
}

/// Waits until the sender is gone; Ctrl-C sets the flag, and ends the wait where that is to be `at_once`.
fn listen(ended: &Receiver<()>, flag: &AtomicBool, at_once: bool) -> PyResult<()> {
    let mut raised = Ok(());
    while ended.recv_timeout(LISTEN) == Err(RecvTimeoutError::Timeout) {
        if raised.is_ok()
            && let Err(error) = Python::attach(|py| py.check_signals())
        {
            flag.store(true, Ordering::Relaxed);
            raised = Err(error);
            if at_once {
                break;
            }
        }
    }
    raised
}

/// Takes what work has found.
fn taken<T>(found: &Mutex<Option<T>>) -> T {
    let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
    found.take().expect("the work has panicked")
}

/// Does work, and lays down what it finds; that the `sender` goes says that it has ended.
fn done<T>(work: impl FnOnce() -> T, found: &Mutex<Option<T>>, sender: Sender<()>) {
    let value = work();
    *found.lock().unwrap_or_else(PoisonError::into_inner) = Some(value);
    drop(sender);
}

/// Runs `work` on the pool while this thread listens for Ctrl-C. That sets the flag, and the call raises once the work has ended: it looks
/// at the flag at least a few times a second.
pub fn interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(StopFlag) -> T + Send,
) -> PyResult<T> {
    let pool = pool()?;
    let flag = Flag::take();
    let stop = StopFlag::new(flag.0);
    let found = Mutex::new(None);
    py.detach(|| {
        pool.in_place_scope(|scope| {
            let (sender, ended) = channel();
            scope.spawn(|_| done(|| work(stop), &found, sender));
            listen(&ended, flag.0, false)
        })
    })?;
    Ok(taken(&found))
}

/// Runs `work`, which owns all that it needs, on the pool while this thread listens for Ctrl-C. That raises at once; the flag is set, and
/// what the work still finds is lost.
pub fn abandonable<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(StopFlag) -> T + Send + 'static,
) -> PyResult<T> {
    let pool = pool()?;
    let flag = Flag::take();
    let shown = flag.0;
    let found = Arc::new(Mutex::new(None));
    let to = Arc::clone(&found);
    py.detach(|| {
        let (sender, ended) = channel();
        pool.spawn(move || {
            // It is another's again when this work has ended.
            let own = flag;
            done(|| work(StopFlag::new(own.0)), &to, sender);
        });
        listen(&ended, shown, true)
    })?;
    Ok(taken(&found))
}
