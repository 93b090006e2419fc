//! Arrays in numpy's `.npy` format, from untrusted files.

use ndarray::{ArrayView, Dimension};
use ndarray_npy::{ViewElement, ViewNpyError, ViewNpyExt};

/// Longest header that is parsed, bytes; numpy writes 128 for such arrays.
const MAX_HEADER: usize = 512;

/// Brackets in the header: of its dictionary and of the shape. The parser's time doubles with each.
const MAX_BRACKETS: usize = 2;

/// The array in the bytes of a file. It is a view, so that a shape beyond the file's length is
/// refused before memory is allocated for it.
///
/// # Errors
///
/// What is wrong with the header or the length, in one line.
pub fn view<T: ViewElement, D: Dimension>(bytes: &[u8]) -> Result<ArrayView<'_, T, D>, String> {
    let (start, header) = match *bytes {
        [_, _, _, _, _, _, 1, _, a, b, ..] => (10, usize::from(u16::from_le_bytes([a, b]))),
        [_, _, _, _, _, _, _, _, a, b, c, d, ..] => (12, u32::from_le_bytes([a, b, c, d]) as usize),
        _ => (0, 0),
    };
    let brackets = bytes.iter().skip(start).take(header).filter(|byte| b"([{".contains(byte)).count();
    if header > MAX_HEADER || brackets > MAX_BRACKETS {
        return Err(format!("a header of {header} bytes with {brackets} brackets open"));
    }
    let first_line = |error: ViewNpyError| error.to_string().lines().next().unwrap_or_default().to_owned();
    ArrayView::view_npy(bytes).map_err(first_line)
}
