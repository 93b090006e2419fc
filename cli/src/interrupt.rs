//! Ctrl-C, SIGTERM and SIGHUP: at the first, the program finishes the file that it is writing and
//! exits; at a second Ctrl-C it exits at once, and so does a command without an orderly stop at the
//! first. Before that, unfinished files are deleted.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use std::thread::sleep;
use std::time::Duration;

use anyhow::Result;
use liveview::network::RunEnd;
use liveview_files::unfinished;
use liveview_live::ffmpeg::end_reading;
pub(crate) use liveview_live::interrupt::{Interrupted, requested};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::{flag, low_level};

use crate::console::Output;
#[cfg(unix)]
use signal_hook::consts::SIGHUP;

/// The work was interrupted, and what was complete is kept: exit code [`EXIT_CODE`].
#[derive(Debug, thiserror::Error)]
#[error("interrupted: {what}")]
pub(crate) struct Shortened {
    /// What is shorter than it should be.
    pub(crate) what: String,
    /// The report on what is kept.
    pub(crate) output: Output,
}

/// Exit code after Ctrl-C, by the convention of shells.
pub(crate) const EXIT_CODE: u8 = 130;
/// How long a run of the network may continue after an interrupt.
const MAX_RUN_AFTER_INTERRUPT: Duration = Duration::from_secs(10);

/// How often it is checked whether a signal has arrived that ends the program at once.
const CHECK_INTERVAL: Duration = Duration::from_millis(30);

/// The signals that end the program, and whether each has arrived since the last check. SIGHUP stays
/// ignored under `nohup`; SIGINT ends the program even where a shell has started it in the background,
/// with the signal ignored.
static ARRIVED: LazyLock<Vec<(i32, Arc<AtomicBool>)>> = LazyLock::new(|| {
    let signals = [
        SIGINT,
        SIGTERM,
        #[cfg(unix)]
        SIGHUP,
    ];
    let wanted = |signal: &i32| [SIGINT, SIGTERM].contains(signal) || !is_ignored(*signal);
    signals.into_iter().filter(wanted).map(|signal| (signal, Arc::default())).collect()
});

/// The network runs to end after an interrupt.
static RUNS: Mutex<Vec<RunEnd>> = Mutex::new(Vec::new());

/// The runs of this network are ended if they continue for too long after an interrupt ([`watch`]).
pub(crate) fn end_runs(run_end: RunEnd) {
    RUNS.lock().unwrap_or_else(PoisonError::into_inner).push(run_end);
}

/// From now on, unfinished files are deleted before a signal ends the program.
pub(crate) fn start() -> Result<()> {
    for (signal, arrived) in ARRIVED.iter() {
        flag::register(*signal, Arc::clone(arrived))?;
    }
    std::thread::spawn(|| {
        let mut is_stopping = false;
        loop {
            sleep(CHECK_INTERVAL);
            for (signal, _) in ARRIVED.iter().filter(|(_, arrived)| arrived.swap(false, Ordering::Relaxed)) {
                let Some(stop) = liveview_live::interrupt::flag() else {
                    end(|| drop(low_level::emulate_default_handler(*signal)))
                };
                // Only SIGINT exits at once: a terminal that is closed may send SIGHUP twice.
                if is_stopping && *signal == SIGINT {
                    end(|| low_level::exit(EXIT_CODE.into()));
                }
                stop.store(true, Ordering::Relaxed);
                is_stopping = true;
            }
        }
    });
    Ok(())
}

/// Deletes unfinished files and ends the program.
fn end(exit: impl FnOnce()) -> ! {
    unfinished::delete_all();
    end_reading();
    exit();
    low_level::abort()
}

/// Returns a flag that becomes true at the first signal. Network runs that continue for too long
/// after it are ended, since they may be endless.
pub(crate) fn watch() -> Result<Arc<AtomicBool>> {
    let stop = liveview_live::interrupt::watch();
    for (signal, _) in ARRIVED.iter() {
        flag::register(*signal, Arc::clone(stop))?;
    }
    std::thread::spawn(move || {
        while !stop.load(Ordering::Relaxed) {
            sleep(Duration::from_millis(100));
        }
        sleep(MAX_RUN_AFTER_INTERRUPT);
        RUNS.lock().unwrap_or_else(PoisonError::into_inner).iter().for_each(RunEnd::end);
    });
    Ok(Arc::clone(stop))
}

/// Whether the program was started with a signal ignored, as `nohup` does with SIGHUP; always false
/// if not on Linux.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask >> (signal - 1) & 1 > 0)
}
