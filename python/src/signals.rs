//! Ctrl-C while Rust works: signals are handled between pieces of the work.
//!
//! In: work that goes on without the interpreter. Out: the exception of a signal's handler, as a
//! rule `KeyboardInterrupt`, a tenth of a second after the signal at most where pieces are short.
//! Python handles signals on its main thread alone; others work on to their end.

use std::panic;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use pyo3::prelude::*;

use crate::error::said;

/// Time between two looks for a signal.
const EVERY: Duration = Duration::from_millis(100);

/// Looks for signals now and then.
pub struct Watch {
    looked: Instant,
}

impl Watch {
    /// The first look is due in a tenth of a second.
    pub fn new() -> Self {
        Self {
            looked: Instant::now(),
        }
    }

    /// Handles signals where a look is due; for a thread without the interpreter.
    ///
    /// Errors: the exception of a handler.
    pub fn look(&mut self) -> PyResult<()> {
        if self.looked.elapsed() < EVERY {
            return Ok(());
        }
        self.looked = Instant::now();
        Python::attach(|py| py.check_signals())
    }
}

/// What `work` comes to, which has no pieces and runs on a thread of its own.
///
/// Errors: the exception of a signal's handler. The work goes on to its end then, unless the
/// process ends before.
pub fn wait_for<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    let (answer, answered) = mpsc::channel();
    let run = move || drop(answer.send(work()));
    let thread = thread::Builder::new().name("plumb".to_owned()).spawn(run);
    let thread = thread.map_err(|why| said(format!("cannot start a thread: {why}")))?;
    py.detach(move || {
        loop {
            match answered.recv_timeout(EVERY) {
                Ok(done) => return Ok(done),
                Err(RecvTimeoutError::Timeout) => Python::attach(|py| py.check_signals())?,
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        // It has panicked, which is passed on as on this thread.
        match thread.join() {
            Ok(()) => Err(said(
                "the work has ended without a result: please report it",
            )),
            Err(why) => panic::resume_unwind(why),
        }
    })
}
