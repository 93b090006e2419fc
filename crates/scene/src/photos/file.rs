//! Photo files from an untrusted source: their memory is checked before it is allocated, and damaged JPEG
//! data is refused.
//!
//! JPEG data has no checksum, and decoders make a picture of nearly any data. The strict decoder refuses files that
//! are cut and undefined codes that it meets; it misses most damage within the data (docs/design-log.md).

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
    if is_sampled_finely(&bytes) {
        let reason = "a JPEG component is sampled more finely than the first one".to_owned();
        return Err(ImageError::Decode { path: path.to_owned(), reason }.into());
    }
    // If the decoder panics on other damage, the error names the file; none of its state outlives the call.
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

/// Whether a component is sampled more finely than the first one, on which the decoder panics.
fn is_sampled_finely(bytes: &[u8]) -> bool {
    let mut at = 2; // past the start-of-image marker
    while let Some(&[0xFF, marker, high, low]) = bytes.get(at..at + 4) {
        let segment = at + 4;
        if matches!(marker, 0xC0..=0xC2) {
            let count = bytes.get(segment + 5).copied().unwrap_or(0);
            let components = bytes.get(segment + 6..).unwrap_or_default().chunks_exact(3).take(count.into());
            let factors: Vec<(u8, u8)> = components.map(|component| (component[1] >> 4, component[1] & 15)).collect();
            return factors.iter().any(|&(across, down)| across > factors[0].0 || down > factors[0].1);
        }
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
    }
    false
}
