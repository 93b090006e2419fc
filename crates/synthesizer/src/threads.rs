//! Whether threads can be started, tried before ONNX Runtime starts its own: if it gets only some
//! of them, it waits for ever.

use std::io;
use std::sync::{Mutex, PoisonError};
use std::thread::{self, Builder};

use liveview_files::memory;

/// Most threads that a network is run on.
pub const MAX_THREADS: usize = 256;

/// Stack of one thread, bytes: the usual default, so that a limit of address space is met here.
const STACK_BYTES: usize = 8 << 20;
/// Address space that stays free: what threads allocate as they start, without which they abort the
/// process (64 KiB each, a signal stack for the most part). More than that, because glibc keeps
/// freed blocks of up to 32 MiB and would reserve the same one for every thread.
const FREE_BYTES: usize = 64 << 20;

/// Why threads cannot be started.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ThreadsError {
    /// More than [`MAX_THREADS`].
    #[error("{0} threads; expected 1 to {MAX_THREADS}")]
    TooMany(usize),
    /// The system refused to start them.
    #[error(
        "of {asked} threads only {started} can be started: {source}; expected fewer threads, or a higher limit of processes \
         (ulimit -u, a container's pids.max) or of address space (ulimit -v)"
    )]
    Refused {
        /// Threads requested.
        asked: usize,
        /// How many of them were started.
        started: usize,
        /// The system's reason.
        source: io::Error,
    },
}

/// Starts `count` threads at the same time, and ends them.
///
/// # Errors
///
/// [`ThreadsError`].
pub fn check_threads(count: usize) -> Result<(), ThreadsError> {
    if !(1..=MAX_THREADS).contains(&count) {
        return Err(ThreadsError::TooMany(count));
    }
    let gate = Mutex::new(());
    thread::scope(|scope| {
        let closed = gate.lock().unwrap_or_else(PoisonError::into_inner);
        let start = |started| {
            let spawn = || Builder::new().stack_size(STACK_BYTES).spawn_scoped(scope, || drop(gate.lock()));
            let thread = check_address_space().and_then(|()| spawn());
            thread.err().map(|source| ThreadsError::Refused { asked: count, started, source })
        };
        let refused = (0..count).find_map(start);
        drop(closed);
        refused.map_or(Ok(()), Err)
    })
}

/// Fails unless there is address space for one more stack and for [`FREE_BYTES`].
fn check_address_space() -> io::Result<()> {
    if memory::can_reserve(STACK_BYTES + FREE_BYTES) { Ok(()) } else { Err(io::ErrorKind::OutOfMemory.into()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_threads_or_too_many_are_refused() {
        assert!(check_threads(2).is_ok());
        for count in [0, MAX_THREADS + 1, usize::MAX] {
            assert_eq!(check_threads(count).unwrap_err().to_string(), format!("{count} threads; expected 1 to 256"));
        }
    }
}
