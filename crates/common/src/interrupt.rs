//! Ctrl-C, SIGTERM and SIGHUP: at the first the program finishes what it is writing and ends, at a Ctrl-C after it at once.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::sleep;
use std::time::Duration;

use anyhow::Result;
use liveview::network::RunEnd;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// The work was interrupted before it was done: exit code [`EXIT_CODE`].
#[derive(Debug, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

/// Exit code of a program that Ctrl-C ended, as shells report it.
pub const EXIT_CODE: u8 = 130;
/// How long a run of the network may go on after an interrupt.
const PATIENCE: Duration = Duration::from_secs(10);

static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// The runs of networks that are ended; `None` before the first [`watch`].
static RUNS: Mutex<Option<Vec<RunEnd>>> = Mutex::new(None);

/// A flag that becomes true at the first signal. Runs of networks that go on for long after it are ended: they may be endless. Called
/// again, it only takes these runs for those before.
pub fn watch(runs: Vec<RunEnd>) -> Result<Arc<AtomicBool>> {
    let stop = STOP.get_or_init(Arc::default);
    if RUNS.lock().unwrap_or_else(PoisonError::into_inner).replace(runs).is_some() {
        return Ok(Arc::clone(stop));
    }
    // Only a person who presses Ctrl-C once more is in a hurry: a terminal that is closed may send SIGHUP twice.
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
        sleep(PATIENCE);
        RUNS.lock().unwrap_or_else(PoisonError::into_inner).iter().flatten().for_each(RunEnd::end);
    });
    Ok(Arc::clone(stop))
}

/// Whether signals are watched for; without, they end the program at once.
#[cfg(unix)]
pub fn is_watched() -> bool {
    STOP.get().is_some()
}

/// Whether a signal has come since [`watch`].
pub fn requested() -> bool {
    STOP.get().is_some_and(|stop| stop.load(Ordering::Relaxed))
}

/// Whether the program was started with a signal ignored, as `nohup` does with SIGHUP; known on Linux.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask >> (signal - 1) & 1 > 0)
}
