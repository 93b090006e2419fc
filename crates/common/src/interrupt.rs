//! Ctrl-C, SIGTERM and SIGHUP: at the first, the program finishes the file that it is writing and
//! exits; at a second Ctrl-C it exits at once.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::sleep;
use std::time::Duration;

use anyhow::Result;
use liveview::network::RunEnd;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use crate::console::Output;

/// The work was interrupted before it was complete: exit code [`EXIT_CODE`].
#[derive(Debug, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

/// The work was interrupted, and what was complete is kept: exit code [`EXIT_CODE`].
#[derive(Debug, thiserror::Error)]
#[error("interrupted: {what}")]
pub struct Shortened {
    /// What is shorter than it should be.
    pub what: String,
    /// The report on what is kept.
    pub output: Output,
}

/// Exit code after Ctrl-C, by the convention of shells.
pub const EXIT_CODE: u8 = 130;
/// How long a run of the network may continue after an interrupt.
const MAX_RUN_AFTER_INTERRUPT: Duration = Duration::from_secs(10);

static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// The network runs to end after an interrupt; `None` before the first [`watch`].
static RUNS: Mutex<Option<Vec<RunEnd>>> = Mutex::new(None);

/// Returns a flag that becomes true at the first signal. Network runs that continue for too long
/// after it are ended, since they may be endless. A later call only replaces the runs.
pub fn watch(runs: Vec<RunEnd>) -> Result<Arc<AtomicBool>> {
    let stop = STOP.get_or_init(Arc::default);
    if RUNS.lock().unwrap_or_else(PoisonError::into_inner).replace(runs).is_some() {
        return Ok(Arc::clone(stop));
    }
    // Only SIGINT exits at once: a terminal that is closed may send SIGHUP twice.
    flag::register_conditional_shutdown(SIGINT, EXIT_CODE.into(), Arc::clone(stop))?;
    for signal in [SIGINT, SIGTERM] {
        flag::register(signal, Arc::clone(stop))?;
    }
    #[cfg(unix)]
    if !is_ignored(signal_hook::consts::SIGHUP) {
        flag::register(signal_hook::consts::SIGHUP, Arc::clone(stop))?;
    }
    std::thread::spawn(move || {
        while !stop.load(Ordering::Relaxed) {
            sleep(Duration::from_millis(100));
        }
        sleep(MAX_RUN_AFTER_INTERRUPT);
        RUNS.lock().unwrap_or_else(PoisonError::into_inner).iter().flatten().for_each(RunEnd::end);
    });
    Ok(Arc::clone(stop))
}

/// Whether [`watch`] was called; before that, signals end the program at once.
#[cfg(unix)]
pub fn is_watched() -> bool {
    STOP.get().is_some()
}

/// Whether a signal has arrived since [`watch`].
pub fn requested() -> bool {
    STOP.get().is_some_and(|stop| stop.load(Ordering::Relaxed))
}

/// Whether the program was started with a signal ignored, as `nohup` does with SIGHUP; always false
/// if not on Linux.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask >> (signal - 1) & 1 > 0)
}
