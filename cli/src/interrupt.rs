//! Ctrl-C: at the first one the program finishes what it is writing and ends, at the second one it ends at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Result;

/// The work was interrupted before it was done: exit code [`EXIT_CODE`].
#[derive(Debug, thiserror::Error)]
#[error("interrupted")]
pub(crate) struct Interrupted;

/// Exit code of a program that Ctrl-C ended, as shells report it.
pub(crate) const EXIT_CODE: u8 = 130;

/// A flag that becomes true at the first Ctrl-C. To be called once per process.
pub(crate) fn watch() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let pressed = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if pressed.swap(true, Ordering::Relaxed) {
            std::process::exit(EXIT_CODE.into());
        }
    })?;
    Ok(stop)
}
