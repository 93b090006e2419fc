//! Numbers on the command line.

use std::ops::{Range, RangeInclusive};

/// Parses a whole number from 1 to 4096.
pub fn count(text: &str) -> Result<usize, String> {
    in_range(text, 1..=4096)
}

/// Parses a whole number from 1 to 256, for numbers of threads and batch sizes.
pub fn up_to_256(text: &str) -> Result<usize, String> {
    in_range(text, 1..=256)
}

/// Parses the quality of a JPEG, from 1 to 100.
pub fn quality(text: &str) -> Result<u8, String> {
    in_range(text, 1..=100).map(|quality| quality as u8)
}

/// Parses a field of view in degrees, from 1 to 170.
pub fn field_of_view(text: &str) -> Result<f64, String> {
    let degrees = text.parse().ok().filter(|degrees| (1.0..=170.0).contains(degrees));
    degrees.ok_or_else(|| "expected degrees from 1 to 170".to_owned())
}

/// Parses a depth, in scene units.
pub(super) fn depth(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_| "expected a number of scene units, such as 1.5".to_owned())
}

/// Parses the number of a port.
pub fn port(text: &str) -> Result<u16, String> {
    in_range(text, 0..=65535).map(|port| port as u16)
}

/// Frames A up to but without B of a path.
pub type FrameRange = Range<usize>;

/// Parses `A:B`, a range of frames that is not empty.
pub fn frame_range(text: &str) -> Result<FrameRange, String> {
    let ends = text.split_once(':').and_then(|(start, end)| Some(start.parse().ok()?..end.parse().ok()?));
    let range = ends.filter(|range: &FrameRange| !range.is_empty());
    range.ok_or_else(|| "expected A:B with whole numbers, A below B, such as 100:200".to_owned())
}

fn in_range(text: &str, range: RangeInclusive<usize>) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("expected a whole number from {} to {}", range.start(), range.end()))
}
