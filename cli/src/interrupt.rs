//! Ctrl-C: the first one lets what is being written be ended, a second one ends the program.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Result;

/// The work was ended before it was done: exit code [`EXIT_CODE`].
#[derive(Debug, thiserror::Error)]
#[error("interrupted")]
pub(crate) struct Interrupted;

/// As a shell tells of a Ctrl-C.
pub(crate) const EXIT_CODE: u8 = 130;

/// Becomes true at the first Ctrl-C. Once per program.
pub(crate) fn watch() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let told = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if told.swap(true, Ordering::Relaxed) {
            std::process::exit(EXIT_CODE.into());
        }
    })?;
    Ok(stop)
}
