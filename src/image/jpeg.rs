//! Checks of JPEG data that the decoder does not make, or fails without.

/// Whether any channel of a JPEG has more samples across or down than the first. `frame` is the frame header from the number of
/// channels on.
fn is_finer_than_first(frame: &[u8]) -> bool {
    let Some((&channels, frame)) = frame.split_first() else { return false };
    let mut factors = frame.chunks_exact(3).take(channels.into()).map(|channel| (channel[1] >> 4, channel[1] & 15));
    let Some((across, down)) = factors.next() else { return false };
    factors.any(|(x, y)| x > across || y > down)
}

/// Refuses data without an end-of-image marker, where the decoder would fill what is missing with grey, and data with a channel
/// that is sampled more finely than the first, on which the decoder panics.
pub(crate) fn check(bytes: &[u8]) -> Result<(), &'static str> {
    let mut at = 2; // past the start-of-image marker
    while let Some(&[prefix, marker]) = bytes.get(at..at + 2) {
        match (prefix, marker) {
            (0xFF, 0xD9) => return Ok(()),
            // Bytes of a scan, stuffed zeros, restart markers and fill bytes.
            (0xFF, 0x00 | 0x01 | 0xD0..=0xD7) => at += 2,
            (0xFF, 0xFF) | (0..=0xFE, _) => at += 1,
            (0xFF, 0xC0..=0xC2) if is_finer_than_first(bytes.get(at + 9..).unwrap_or_default()) => {
                return Err("a JPEG with a channel sampled more finely than the first");
            }
            // Any other marker carries a length, which skips embedded thumbnails.
            _ => match bytes.get(at + 2..at + 4) {
                Some(&[high, low]) => at += 2 + usize::from(u16::from_be_bytes([high, low])),
                _ => break,
            },
        }
    }
    Err("the JPEG data ends early")
}
