//! The results of a video.

use std::time::Duration;

use serde_json::{Value, json};

use super::gather::Faults;
use super::tally::Tally;
use super::writer::Written;
use crate::governor::Level;

/// The results of a video.
pub(super) struct VideoResults {
    pub(super) tally: Tally,
    pub(super) written: Written,
    pub(super) faults: Faults,
    /// Each step from which on another level was used, with the level.
    pub(super) changes: Vec<(usize, Level)>,
    pub(super) wall: Duration,
    pub(super) stopped: bool,
    /// Whether an interrupt ended it before the last frame.
    pub(super) interrupted: bool,
}

/// The level changes as JSON.
pub(super) fn changes_json(changes: &[(usize, Level)]) -> Value {
    let change = |(step, level): &(usize, Level)| {
        let mut json = level.json();
        json["from_frame"] = json!(step);
        json
    };
    changes.iter().map(change).collect()
}
