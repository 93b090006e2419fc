//! What there is to tell about a video.

use std::time::Duration;

use serde_json::{Value, json};

use super::gather::Faults;
use super::governor::Rung;
use super::tally::Tally;
use super::writer::Written;

/// What there is to tell about a video.
pub(super) struct Played {
    pub(super) tally: Tally,
    pub(super) written: Written,
    pub(super) faults: Faults,
    /// Steps at which less, or more, was done, and how much from then on.
    pub(super) changes: Vec<(usize, Rung)>,
    pub(super) wall: Duration,
    pub(super) stopped: bool,
}

/// Where the work changed, for machines.
pub(super) fn changes_json(changes: &[(usize, Rung)]) -> Value {
    let told = |(step, rung): &(usize, Rung)| {
        let mut told = rung.json();
        told["from_frame"] = json!(step);
        told
    };
    changes.iter().map(told).collect()
}
