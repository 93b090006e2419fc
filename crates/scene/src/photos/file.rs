//! Photo files from an untrusted source: their memory is checked before it is allocated, and damaged JPEG
//! data is refused.
//!
//! JPEG data has no checksum, and decoders make a picture of any data. A strict decoder refuses what it
//! can see: undefined codes, too few or too many coefficients, data that ends early.

use std::panic::catch_unwind;
use std::path::Path;

use liveview::ImageRgb;
use liveview::geometry::Size;
use liveview::image::{ImageError, decode, read_size};
use liveview_files::{bounded, memory};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

use crate::SceneError;

/// Peak memory per pixel while a photo is decoded, converted to f32 and then undistorted, resized
/// or copied to a texture: two f32 RGB buffers and 8 bytes for the decoder.
const BYTES_PER_PIXEL: u64 = 32;

/// Decodes a PNG or JPEG file.
///
/// # Errors
///
/// [`SceneError::PhotoMemory`]; [`SceneError::Image`] for a file that cannot be read, is too large, damaged, or
/// ends early.
pub fn load_photo(path: &Path) -> Result<ImageRgb, SceneError> {
    let size = read_size(path)?;
    let check = memory::check(BYTES_PER_PIXEL * size.pixels() as u64);
    check.map_err(|source| SceneError::PhotoMemory { path: path.to_owned(), size, source })?;
    let bytes = bounded::read(path, bounded::MAX_BYTES);
    let bytes = bytes.map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
    if !bytes.starts_with(&[0xFF, 0xD8]) {
        return Ok(decode(path, &bytes)?);
    }
    // The decoder panics on some damage; none of its state outlives the call.
    let decoded = catch_unwind(|| decode_jpeg(&bytes, size)).unwrap_or_else(|_| Err("the decoder failed".to_owned()));
    Ok(decoded.map_err(|reason| ImageError::Decode { path: path.to_owned(), reason })?)
}

fn decode_jpeg(bytes: &[u8], size: Size) -> Result<ImageRgb, String> {
    let options = DecoderOptions::default().set_strict_mode(true).set_max_width(size.width);
    let options = options.set_max_height(size.height).jpeg_set_out_colorspace(ColorSpace::RGB);
    let rgb = JpegDecoder::new_with_options(ZCursor::new(bytes), options).decode();
    let rgb = rgb.map_err(|error| format!("damaged JPEG data: {error:?}"))?;
    let values = rgb.into_iter().map(|value| f32::from(value) / 255.0).collect();
    ImageRgb::new(size.width, size.height, values).map_err(|error| error.to_string())
}
