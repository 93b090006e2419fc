//! Why a picture could not be read or written.

use std::io;
use std::path::PathBuf;

use crate::fs::memory::MemoryError;
use crate::geometry::{MAX_SIDE, Size};

/// Why a picture could not be read or written. Every message about a file names it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is damaged, cut short, or neither PNG nor JPEG.
    #[error("{}: not a complete PNG or JPEG image: {reason}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// The decoder's message.
        reason: String,
    },
    /// The header declares more than [`MAX_SIDE`] pixels in a side. Nothing was decoded.
    #[error("{}: the image is {width}x{height}; at most {MAX_SIDE} pixels per side are read", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Declared width in pixels.
        width: usize,
        /// Declared height in pixels.
        height: usize,
    },
    /// The picture takes more memory than can be had. Nothing was decoded.
    #[error("{}: the image is {size}, which {source}; expected a smaller image", path.display())]
    Memory {
        /// The file.
        path: PathBuf,
        /// Declared size, pixels.
        size: Size,
        /// How much.
        source: MemoryError,
    },
    /// The pixel buffer given does not hold width × height pixels.
    #[error("{len} values given for a {width}x{height} image with {channels} channels")]
    Buffer {
        /// Values given.
        len: usize,
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Values per pixel.
        channels: usize,
    },
    /// No PNG can hold the picture.
    #[error("a picture of {width}x{height} cannot be a PNG: {reason}")]
    Encode {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// The encoder's message.
        reason: String,
    },
    /// The file cannot be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}
