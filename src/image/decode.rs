//! Reading pictures: PNG and JPEG to interleaved f32 RGB.
//!
//! Colours are sRGB values in [0, 1] as stored in the file (no linearisation). Alpha is dropped; the EXIF orientation is
//! ignored, as COLMAP and the other pose tools ignore it, so poses belong to the pixels as stored. [`read_header`] tells of both.

use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use image::metadata::Orientation;
use image::{ImageDecoder, ImageFormat, ImageReader, Limits};

use super::error::ImageError;
use super::jpeg;
use super::rgb::ImageRgb;
use crate::fs::{bounded, memory};
use crate::geometry::{MAX_SIDE, Size};

/// Memory that a decoder may use in addition to the pixels, in bytes: a colour profile of a few bytes can inflate to gigabytes.
const MAX_EXTRA: u64 = 64 << 20;

/// Memory per pixel while a photo is decoded, made f32 and, by whoever loads it, undistorted, resized or made a texture: f32 RGB twice, and
/// 8 bytes of the decoder's own.
const BYTES_PER_PIXEL: u64 = 32;

/// What the header of a picture says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Header {
    /// In pixels, as stored.
    pub size: Size,
    /// Whether EXIF asks that it be shown turned or mirrored; [`load`] does not.
    pub oriented: bool,
    /// Whether it has an alpha channel; [`load`] drops it.
    pub alpha: bool,
}

/// The header of a PNG or JPEG.
///
/// # Errors
///
/// As [`read_size`].
pub fn read_header(path: &Path) -> Result<Header, ImageError> {
    header_of(path, BufReader::new(open(path)?))
}

/// Size of a PNG or JPEG in pixels, from its header alone.
///
/// # Errors
///
/// [`ImageError::Read`], [`ImageError::Decode`] or [`ImageError::TooLarge`], naming the file.
pub fn read_size(path: &Path) -> Result<Size, ImageError> {
    size_of(path, BufReader::new(open(path)?))
}

fn open(path: &Path) -> Result<File, ImageError> {
    bounded::open(path, bounded::MAX_BYTES).map_err(|source| ImageError::Read { path: path.to_owned(), source })
}

/// As [`read_size`], of a file that is open already; `path` is for errors.
pub(crate) fn size_of(path: &Path, input: impl BufRead + Seek) -> Result<Size, ImageError> {
    let size = reader(path, input)?.into_dimensions().map_err(|error| decode_error(path, &error))?;
    check_side(path, size)
}

fn header_of(path: &Path, input: impl BufRead + Seek) -> Result<Header, ImageError> {
    let mut decoder = reader(path, input)?.into_decoder().map_err(|error| decode_error(path, &error))?;
    let size = check_side(path, decoder.dimensions())?;
    // EXIF data that is damaged asks for nothing.
    let oriented = decoder.orientation().is_ok_and(|orientation| orientation != Orientation::NoTransforms);
    Ok(Header { size, oriented, alpha: decoder.color_type().has_alpha() })
}

/// A decoder by content, not by extension: photos called .jpg that are PNG are common.
fn reader<R: BufRead + Seek>(path: &Path, input: R) -> Result<ImageReader<R>, ImageError> {
    let reader = ImageReader::new(input).with_guessed_format();
    let reader = reader.map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
    check_format(path, reader.format())?;
    Ok(reader)
}

/// Decodes a PNG or JPEG.
///
/// # Errors
///
/// [`ImageError::Read`], [`ImageError::TooLarge`], [`ImageError::Memory`], or [`ImageError::Decode`] if the file is damaged or ends early.
pub fn load(path: &Path) -> Result<ImageRgb, ImageError> {
    let read = bounded::read(path, bounded::MAX_BYTES);
    decode(path, &read.map_err(|source| ImageError::Read { path: path.to_owned(), source })?)
}

/// As [`load`], from the bytes of a file; `path` is for errors.
pub(crate) fn decode(path: &Path, bytes: &[u8]) -> Result<ImageRgb, ImageError> {
    let size = size_of(path, Cursor::new(bytes))?;
    let needed = BYTES_PER_PIXEL * size.pixels() as u64;
    memory::check(needed).map_err(|source| ImageError::Memory { path: path.to_owned(), size, source })?;
    let mut reader = reader(path, Cursor::new(bytes))?;
    let refused = |reason: &str| ImageError::Decode { path: path.to_owned(), reason: reason.to_owned() };
    if reader.format() == Some(ImageFormat::Jpeg) {
        jpeg::check(bytes).map_err(refused)?;
    }
    let mut limits = Limits::no_limits();
    // Four channels of 16 bits are the most that a PNG has.
    limits.max_alloc = Some(8 * size.pixels() as u64 + MAX_EXTRA);
    reader.limits(limits);
    // Should the decoder panic, the error still names the file; no state of the decoder outlives the call.
    let decoded = catch_unwind(AssertUnwindSafe(|| reader.decode())).map_err(|_| refused("the decoder failed"))?;
    let decoded = decoded.map_err(|error| decode_error(path, &error))?.into_rgb32f();
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    ImageRgb::new(width, height, decoded.into_raw())
}

fn check_format(path: &Path, format: Option<ImageFormat>) -> Result<(), ImageError> {
    match format {
        Some(ImageFormat::Png | ImageFormat::Jpeg) => Ok(()),
        Some(other) => Err(ImageError::Decode { path: path.to_owned(), reason: format!("{other:?} is not read") }),
        None => Err(ImageError::Decode { path: path.to_owned(), reason: "unknown kind of file".to_owned() }),
    }
}

fn check_side(path: &Path, (width, height): (u32, u32)) -> Result<Size, ImageError> {
    let (width, height) = (width as usize, height as usize);
    if width > MAX_SIDE || height > MAX_SIDE {
        return Err(ImageError::TooLarge { path: path.to_owned(), width, height });
    }
    Ok(Size::new(width, height))
}

fn decode_error(path: &Path, error: &image::ImageError) -> ImageError {
    ImageError::Decode { path: path.to_owned(), reason: error.to_string() }
}
