//! Whether the program has been asked to stop: it sets a flag, which the library looks at wherever it works or waits for long.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// The work was interrupted before it was complete.
#[derive(Debug, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

/// The flag to set, from now on: an interrupt no longer ends the program at once.
pub fn watch() -> &'static Arc<AtomicBool> {
    STOP.get_or_init(Arc::default)
}

/// The flag, if [`watch`] was called.
pub fn flag() -> Option<&'static Arc<AtomicBool>> {
    STOP.get()
}

/// Whether the program has been asked to stop since [`watch`].
pub fn requested() -> bool {
    flag().is_some_and(|stop| stop.load(Ordering::Relaxed))
}
