//! Numbers on the command line.

use std::ops::RangeInclusive;

/// Parses a number from 1 to 4096; a larger one would be a mistake.
pub fn count(text: &str) -> Result<usize, String> {
    whole(text, 1..=4096)
}

/// Parses a number from 1 to 256, of what takes memory or cores.
pub fn few(text: &str) -> Result<usize, String> {
    whole(text, 1..=256)
}

fn whole(text: &str, range: RangeInclusive<usize>) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("expected a whole number from {} to {}", range.start(), range.end()))
}
