//! Numbers on the command line.

use std::fmt::Display;
use std::ops::{Range, RangeInclusive};
use std::str::FromStr;

use liveview_live::FrameRate;

/// Parses a whole number from 1 to 4096.
pub(crate) fn count(text: &str) -> Result<usize, String> {
    in_range(text, 1..=4096)
}

/// Parses a whole number from 1 to 256, for numbers of threads and batch sizes.
pub(crate) fn up_to_256(text: &str) -> Result<usize, String> {
    in_range(text, 1..=256)
}

/// Parses a field of view in degrees, from 1 to 170.
pub(crate) fn field_of_view(text: &str) -> Result<f64, String> {
    let degrees = text.parse().ok().filter(|degrees| (1.0..=170.0).contains(degrees));
    degrees.ok_or_else(|| "expected degrees from 1 to 170".to_owned())
}

/// Parses a depth, in scene units.
pub(super) fn depth(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_| "expected a number of scene units, such as 1.5".to_owned())
}

/// Parses `A:B`, `A:` or `:B`: a range, without B, that is not empty.
pub(crate) fn frame_range(text: &str) -> Result<Range<usize>, String> {
    let side = |text: &str, open| if text.is_empty() { Some(open) } else { text.parse().ok() };
    let ends = text.split_once(':').and_then(|(start, end)| Some(side(start, 0)?..side(end, usize::MAX)?));
    let range = ends.filter(|range: &Range<usize>| !range.is_empty());
    range.ok_or_else(|| "expected A:B, A: or :B with whole numbers, A below B, such as 100:200".to_owned())
}

/// Parses a colour RRGGBB, a `#` before it or not.
pub(crate) fn colour(text: &str) -> Result<[f32; 3], String> {
    let digits = text.strip_prefix('#').unwrap_or(text);
    let value = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6);
    let value = value.ok_or_else(|| "expected six hexadecimal digits, such as ffffff or 00ff00".to_owned())?;
    Ok([value >> 16, value >> 8, value].map(|channel| (channel & 0xFF) as f32 / 255.0))
}

/// Parses a rate from 1 to 1000 frames per second.
pub(crate) fn frame_rate(text: &str) -> Result<FrameRate, String> {
    let rate = text.parse().ok().filter(|rate: &FrameRate| (1.0..=1000.0).contains(&rate.per_second()));
    rate.ok_or_else(|| "expected frames per second from 1 to 1000, such as 30, 29.97 or 30000/1001".to_owned())
}

/// Parses a whole number of a range.
pub(crate) fn in_range<T: FromStr + PartialOrd + Display>(text: &str, range: RangeInclusive<T>) -> Result<T, String> {
    let number = text.parse().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("expected a whole number from {} to {}", range.start(), range.end()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_range_parses_open_ends() {
        assert_eq!(frame_range("3:9"), Ok(3..9));
        assert_eq!(frame_range(":9"), Ok(0..9));
        assert_eq!(frame_range("3:"), Ok(3..usize::MAX));
        assert!(["9:3", "7", "-1:2", "", "3..9"].iter().all(|text| frame_range(text).is_err()));
    }

    #[test]
    fn frame_rate_parses_integers_decimals_and_fractions() {
        let text = |text: &str| frame_rate(text).map(|rate| rate.to_string());
        for (given, expected) in [
            ("30", "30"),
            ("29.97", "2997/100"),
            ("30000/1001", "30000/1001"),
            ("60/2", "30"),
            ("25.0", "25"),
            ("1", "1"),
            ("1000", "1000"),
        ] {
            assert_eq!(text(given).as_deref(), Ok(expected));
        }
        for wrong in [
            "0", "", "-30", "+30", "1/2", "1001", "30/0", "/", "3e1", "nan", "inf", ".", "30.", "1.2.3", "1/2/3",
            "29,97",
        ] {
            assert!(frame_rate(wrong).is_err(), "{wrong}");
        }
        assert!(frame_rate("30000/1001").unwrap().per_second() < 30.0);
    }
}
