//! Pictures: RGB in memory, files, and inpainting of uncovered pixels.

mod codec;
mod inpaint;
mod rgb;

use std::io;
use std::path::PathBuf;

pub use codec::{
    Header, JPEG_QUALITY, WHITE, decode, encode, encode_gray16_png, encode_with_quality, is_tagged, load, read_header,
    read_size,
};
pub use inpaint::inpaint_uncovered;
pub use rgb::ImageRgb;

use crate::geometry::{MAX_SIDE, Size};

/// Why a picture could not be read or written. A message about a file names it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The file is damaged, truncated, or of no format that is read.
    #[error("{}: not a complete picture (PNG, JPEG, WebP, TIFF, BMP): {reason}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// The decoder's message.
        reason: String,
    },
    /// The header declares more than [`MAX_SIDE`] pixels per side. Nothing was decoded.
    #[error("{}: the image is {size}; expected at most {MAX_SIDE} pixels per side", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Declared size in pixels.
        size: Size,
    },
    /// A pixel buffer's length is not width · height · channels.
    #[error("{len} values given for a {width}x{height} image with {channels} channels")]
    Buffer {
        /// Number of values in the buffer.
        len: usize,
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Values per pixel.
        channels: usize,
    },
    /// An array is not `[h, w, 3]`.
    #[error("the array has shape {shape:?}; expected [height, width, 3]")]
    Shape {
        /// Its shape.
        shape: [usize; 3],
    },
    /// The picture is too large for the file format.
    #[error("a picture of {size} cannot be encoded: {reason}")]
    Encode {
        /// Size in pixels.
        size: Size,
        /// The encoder's message.
        reason: String,
    },
    /// The file cannot be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
}
