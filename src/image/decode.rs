//! Decodes PNG and JPEG to interleaved f32 RGB.
//!
//! Colours are sRGB values in [0, 1] as stored in the file (no linearisation). The alpha channel is
//! dropped. The EXIF orientation is ignored, as in COLMAP and other pose estimators, so poses
//! belong to the pixels as stored. [`read_header`] reports both.

use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use image::metadata::Orientation;
use image::{ImageDecoder, ImageFormat, ImageReader, Limits};

use super::{ImageError, ImageRgb, jpeg};
use crate::fs::{bounded, memory};
use crate::geometry::{MAX_SIDE, Size};

/// Memory that a decoder may use in addition to the pixels, in bytes: a compressed colour profile
/// of a few bytes can expand to gigabytes.
const MAX_EXTRA_BYTES: u64 = 64 << 20;

/// Peak memory per pixel while a photo is decoded, converted to f32 and then undistorted, resized
/// or copied to a texture: two f32 RGB buffers and 8 bytes for the decoder.
const BYTES_PER_PIXEL: u64 = 32;

/// Properties from the header of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Header {
    /// Size in pixels, as stored.
    pub size: Size,
    /// Whether its EXIF orientation is a rotation or reflection; [`load`] ignores it.
    pub oriented: bool,
    /// Whether it has an alpha channel; [`load`] drops it.
    pub alpha: bool,
}

/// Reads the header of a PNG or JPEG.
///
/// # Errors
///
/// As [`read_size`].
pub fn read_header(path: &Path) -> Result<Header, ImageError> {
    header_of(path, open(path)?)
}

/// Reads the size of a PNG or JPEG in pixels from its header.
///
/// # Errors
///
/// [`ImageError::Read`], [`ImageError::Decode`] or [`ImageError::TooLarge`], naming the file.
pub fn read_size(path: &Path) -> Result<Size, ImageError> {
    Ok(decoder_and_size(path, open(path)?)?.1)
}

fn open(path: &Path) -> Result<BufReader<File>, ImageError> {
    let file = bounded::open(path, bounded::MAX_BYTES);
    Ok(BufReader::new(file.map_err(|source| ImageError::Read { path: path.to_owned(), source })?))
}

/// As [`read_header`], from an open file; `path` is for errors.
pub(crate) fn header_of(path: &Path, input: impl BufRead + Seek) -> Result<Header, ImageError> {
    let (mut decoder, size) = decoder_and_size(path, input)?;
    // Damaged EXIF data counts as none.
    let oriented = decoder.orientation().is_ok_and(|orientation| orientation != Orientation::NoTransforms);
    Ok(Header { size, oriented, alpha: decoder.color_type().has_alpha() })
}

/// A decoder, and the size in its header.
fn decoder_and_size<'a>(
    path: &Path,
    input: impl BufRead + Seek + 'a,
) -> Result<(impl ImageDecoder + 'a, Size), ImageError> {
    let decoder = reader(path, input)?.into_decoder().map_err(|error| decode_error(path, &error))?;
    let (width, height) = decoder.dimensions();
    let size = Size::new(width as usize, height as usize);
    if size.width > MAX_SIDE || size.height > MAX_SIDE {
        return Err(ImageError::TooLarge { path: path.to_owned(), size });
    }
    Ok((decoder, size))
}

/// A decoder chosen by content, not by extension: PNG files named .jpg are common.
fn reader<R: BufRead + Seek>(path: &Path, input: R) -> Result<ImageReader<R>, ImageError> {
    let reader = ImageReader::new(input).with_guessed_format();
    let reader = reader.map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
    let reason = match reader.format() {
        Some(ImageFormat::Png | ImageFormat::Jpeg) => return Ok(reader),
        Some(other) => format!("{other:?} is not supported"),
        None => "unknown file format".to_owned(),
    };
    Err(ImageError::Decode { path: path.to_owned(), reason })
}

/// Decodes a PNG or JPEG.
///
/// # Errors
///
/// [`ImageError::Read`], [`ImageError::TooLarge`], [`ImageError::Memory`], or
/// [`ImageError::Decode`] if the file is damaged or ends early.
pub fn load(path: &Path) -> Result<ImageRgb, ImageError> {
    let read = bounded::read(path, bounded::MAX_BYTES);
    decode(path, &read.map_err(|source| ImageError::Read { path: path.to_owned(), source })?)
}

/// As [`load`], from the bytes of a file; `path` is for errors.
pub(crate) fn decode(path: &Path, bytes: &[u8]) -> Result<ImageRgb, ImageError> {
    let (_, size) = decoder_and_size(path, Cursor::new(bytes))?;
    let needed = BYTES_PER_PIXEL * size.pixels() as u64;
    memory::check(needed).map_err(|source| ImageError::Memory { path: path.to_owned(), size, source })?;
    let mut reader = reader(path, Cursor::new(bytes))?;
    let refused = |reason: &str| ImageError::Decode { path: path.to_owned(), reason: reason.to_owned() };
    if reader.format() == Some(ImageFormat::Jpeg) {
        jpeg::check(bytes).map_err(refused)?;
    }
    let mut limits = Limits::no_limits();
    // A PNG has up to four channels of 16 bits.
    limits.max_alloc = Some(8 * size.pixels() as u64 + MAX_EXTRA_BYTES);
    reader.limits(limits);
    // If the decoder panics, the error names the file; no state of the decoder outlives the call.
    let decoded = catch_unwind(AssertUnwindSafe(|| reader.decode())).map_err(|_| refused("the decoder failed"))?;
    let decoded = decoded.map_err(|error| decode_error(path, &error))?.into_rgb32f();
    ImageRgb::new(size.width, size.height, decoded.into_raw())
}

fn decode_error(path: &Path, error: &image::ImageError) -> ImageError {
    ImageError::Decode { path: path.to_owned(), reason: error.to_string() }
}
