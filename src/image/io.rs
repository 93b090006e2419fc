//! Pictures in and out: PNG and JPEG to interleaved f32 RGB, and back to PNG.
//!
//! Colours are sRGB values in [0, 1] as stored in the file (no linearisation). Alpha is dropped; the EXIF orientation is
//! ignored, as COLMAP and the other pose tools ignore it, so poses belong to the pixels as stored.

use std::io::{self, BufRead, BufReader, Cursor, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use image::codecs::png::PngEncoder;
use image::imageops::{self, FilterType};
use image::{ExtendedColorType, ImageEncoder, ImageFormat, ImageReader, Limits, Rgb32FImage};

use super::jpeg;
use crate::fs::{atomic, bounded};
use crate::geometry::MAX_SIDE;

/// What a decoder may take beside the pixels, in bytes: a colour profile of a few bytes can unfold to gigabytes.
const MAX_ASIDE: u64 = 64 << 20;

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
        /// What the decoder said.
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
    /// The pixel buffer handed in does not hold width × height pixels.
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
        /// What the encoder said.
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

/// An sRGB picture: interleaved RGB, f32 in [0, 1], row-major, `data.len() == 3 * width * height`.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageRgb {
    data: Vec<f32>,
    width: usize,
    height: usize,
}

impl ImageRgb {
    /// Wraps interleaved RGB values.
    ///
    /// # Errors
    ///
    /// [`ImageError::Buffer`] unless `data` holds 3 · width · height values.
    pub fn new(width: usize, height: usize, data: Vec<f32>) -> Result<Self, ImageError> {
        check_buffer(data.len(), width, height, 3)?;
        Ok(Self { data, width, height })
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All values, interleaved RGB, row by row.
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// Takes the values out.
    pub fn into_data(self) -> Vec<f32> {
        self.data
    }

    /// The pixel in column `x`, row `y`.
    ///
    /// # Panics
    ///
    /// If the pixel is outside the image.
    pub fn pixel(&self, x: usize, y: usize) -> [f32; 3] {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) of a {}x{} image", self.width, self.height);
        let at = 3 * (y * self.width + x);
        [self.data[at], self.data[at + 1], self.data[at + 2]]
    }

    /// The picture scaled to another size. The triangle filter widens when scaling down, so nothing aliases.
    ///
    /// # Errors
    ///
    /// [`ImageError::Buffer`] if either size is beyond what a picture file holds.
    pub fn resized(self, width: usize, height: usize) -> Result<Self, ImageError> {
        let refused = ImageError::Buffer { len: self.data.len(), width, height, channels: 3 };
        let sides = [self.width, self.height, width, height].map(u32::try_from);
        let [Ok(across), Ok(down), Ok(new_across), Ok(new_down)] = sides else { return Err(refused) };
        let Some(buffer) = Rgb32FImage::from_raw(across, down, self.data) else { return Err(refused) };
        let scaled = imageops::resize(&buffer, new_across, new_down, FilterType::Triangle);
        Self::new(width, height, scaled.into_raw())
    }
}

/// Width and height of a PNG or JPEG in pixels, from its header alone.
///
/// # Errors
///
/// [`ImageError::Read`], [`ImageError::Decode`] or [`ImageError::TooLarge`], naming the file.
pub fn read_size(path: &Path) -> Result<(usize, usize), ImageError> {
    let file =
        bounded::open(path, bounded::MAX_BYTES).map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
    size_of(path, BufReader::new(file))
}

/// As [`read_size`], of the file at `path`, opened already.
pub(crate) fn size_of(path: &Path, input: impl BufRead + Seek) -> Result<(usize, usize), ImageError> {
    let size = reader(path, input)?.into_dimensions().map_err(|error| decode_error(path, &error))?;
    check_side(path, size)
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
/// [`ImageError::Read`], [`ImageError::TooLarge`], or [`ImageError::Decode`] if the file is damaged or ends early.
pub fn load(path: &Path) -> Result<ImageRgb, ImageError> {
    let read = bounded::read(path, bounded::MAX_BYTES);
    decode(path, &read.map_err(|source| ImageError::Read { path: path.to_owned(), source })?)
}

/// As [`load`], of the bytes of the file at `path`.
pub(crate) fn decode(path: &Path, bytes: &[u8]) -> Result<ImageRgb, ImageError> {
    let (width, height) = size_of(path, Cursor::new(bytes))?;
    let mut reader = reader(path, Cursor::new(bytes))?;
    let refused = |reason: &str| ImageError::Decode { path: path.to_owned(), reason: reason.to_owned() };
    if reader.format() == Some(ImageFormat::Jpeg) {
        jpeg::check(bytes).map_err(refused)?;
    }
    let mut limits = Limits::no_limits();
    // Four channels of 16 bits are the most that a PNG has.
    limits.max_alloc = Some(8 * (width * height) as u64 + MAX_ASIDE);
    reader.limits(limits);
    // The decoder is not ours: should it panic, the file is named all the same. It holds no state that outlives the call.
    let decoded = catch_unwind(AssertUnwindSafe(|| reader.decode())).map_err(|_| refused("the decoder failed"))?;
    let decoded = decoded.map_err(|error| decode_error(path, &error))?.into_rgb32f();
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    ImageRgb::new(width, height, decoded.into_raw())
}

/// An 8-bit RGB PNG, values rounded to nearest and clamped to [0, 1].
///
/// # Errors
///
/// [`ImageError::Encode`] if the picture is too large for a PNG.
pub fn encode_png(picture: &ImageRgb) -> Result<Vec<u8>, ImageError> {
    let bytes: Vec<u8> = picture.data.iter().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
    encode(&bytes, picture.width, picture.height, ExtendedColorType::Rgb8)
}

/// A 16-bit grey PNG, row-major.
///
/// # Errors
///
/// [`ImageError::Buffer`] unless `data` holds width · height values; [`ImageError::Encode`] if that is too large for a PNG.
pub fn encode_gray16_png(width: usize, height: usize, data: &[u16]) -> Result<Vec<u8>, ImageError> {
    check_buffer(data.len(), width, height, 1)?;
    // The encoder takes the machine's byte order.
    let bytes: Vec<u8> = data.iter().flat_map(|v| v.to_ne_bytes()).collect();
    encode(&bytes, width, height, ExtendedColorType::L16)
}

/// Writes what [`encode_png`] makes, as a [`whole_file`]: no half-written picture is ever seen.
///
/// # Errors
///
/// Those of [`encode_png`]; [`ImageError::Write`], naming the file.
pub fn save_png(path: &Path, picture: &ImageRgb) -> Result<(), ImageError> {
    let failed = |source| ImageError::Write { path: path.to_owned(), source };
    atomic::write(path, &encode_png(picture)?).map_err(failed)
}

/// In memory: on a file, the encoder would swallow the error of its last write.
fn encode(bytes: &[u8], width: usize, height: usize, color: ExtendedColorType) -> Result<Vec<u8>, ImageError> {
    let failed = |reason: String| ImageError::Encode { width, height, reason };
    let (Ok(across), Ok(down)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(failed("too many pixels in a side".to_owned()));
    };
    let mut png = Vec::new();
    let encoded = PngEncoder::new(&mut png).write_image(bytes, across, down, color);
    encoded.map_err(|error| failed(error.to_string())).map(|()| png)
}

fn check_buffer(len: usize, width: usize, height: usize, channels: usize) -> Result<(), ImageError> {
    let expected = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(channels));
    if expected == Some(len) { Ok(()) } else { Err(ImageError::Buffer { len, width, height, channels }) }
}

fn check_format(path: &Path, format: Option<ImageFormat>) -> Result<(), ImageError> {
    match format {
        Some(ImageFormat::Png | ImageFormat::Jpeg) => Ok(()),
        Some(other) => Err(ImageError::Decode { path: path.to_owned(), reason: format!("{other:?} is not read") }),
        None => Err(ImageError::Decode { path: path.to_owned(), reason: "unknown kind of file".to_owned() }),
    }
}

fn check_side(path: &Path, (width, height): (u32, u32)) -> Result<(usize, usize), ImageError> {
    let (width, height) = (width as usize, height as usize);
    if width > MAX_SIDE || height > MAX_SIDE {
        return Err(ImageError::TooLarge { path: path.to_owned(), width, height });
    }
    Ok((width, height))
}

fn decode_error(path: &Path, error: &image::ImageError) -> ImageError {
    ImageError::Decode { path: path.to_owned(), reason: error.to_string() }
}
