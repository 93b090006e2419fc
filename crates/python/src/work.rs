//! Work of the library beside the interpreter: other Python threads run on, Ctrl-C is seen, and a
//! panic becomes an exception.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread;
use std::time::Duration;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// Time between two looks for a signal.
const SIGNALS: Duration = Duration::from_millis(50);
/// The stack of a program's main thread.
const STACK: usize = 8 << 20;

/// Runs `work` in a thread of its own, without the interpreter. At a signal `interrupt` is called,
/// which is to end the work early; the signal's exception then comes in place of its result.
///
/// # Errors
///
/// That exception, and `RuntimeError` for a panic.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    interrupt: impl Fn() + Send + Sync,
    work: impl FnOnce() -> PyResult<T> + Send,
) -> PyResult<T> {
    py.detach(|| {
        thread::scope(|scope| {
            let (done, waiting) = sync_channel(1);
            let work = move || {
                let result = catch_unwind(AssertUnwindSafe(work));
                let _ = done.send(());
                result
            };
            let worker = thread::Builder::new().name("liveview".to_owned()).stack_size(STACK);
            let worker = worker.spawn_scoped(scope, work)?;
            let mut signal = None;
            while let Err(RecvTimeoutError::Timeout) = waiting.recv_timeout(SIGNALS) {
                if let Err(raised) = Python::attach(|py| py.check_signals()) {
                    signal.get_or_insert(raised);
                    interrupt();
                }
            }
            let result = worker.join().and_then(|result| result);
            match (signal, result) {
                (Some(raised), _) => Err(raised),
                (None, Ok(result)) => result,
                (None, Err(panic)) => Err(PyRuntimeError::new_err(format!("internal error: {}", text(&*panic)))),
            }
        })
    })
}

/// As [`run`], for work that no signal ends early.
pub(crate) fn compute<T: Send>(py: Python<'_>, work: impl FnOnce() -> PyResult<T> + Send) -> PyResult<T> {
    run(py, || (), work)
}

/// The message of a panic.
fn text(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic without a message".to_owned())
}
