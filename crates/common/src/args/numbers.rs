//! Numbers on the command line.

use std::ops::RangeInclusive;

/// Parses a whole number from 1 to 4096.
pub fn count(text: &str) -> Result<usize, String> {
    in_range(text, 1..=4096)
}

/// Parses a whole number from 1 to 256, for numbers of threads and batch sizes.
pub fn up_to_256(text: &str) -> Result<usize, String> {
    in_range(text, 1..=256)
}

fn in_range(text: &str, range: RangeInclusive<usize>) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("expected a whole number from {} to {}", range.start(), range.end()))
}
