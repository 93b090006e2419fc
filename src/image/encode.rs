//! Writing pictures: PNG and JPEG. Encoded in memory first: writing to a file, the PNG encoder would lose the error of its last
//! write.

use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::error::ImageError;
use super::rgb::{ImageRgb, check_buffer};
use crate::fs::atomic;

const JPEG_QUALITY: u8 = 95;

impl ImageRgb {
    /// Writes the picture whole or not at all: JPEG where the name ends in .jpg or .jpeg, else PNG.
    ///
    /// # Errors
    ///
    /// [`ImageError::Encode`], or [`ImageError::Write`], naming the file.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), ImageError> {
        let path = path.as_ref();
        let failed = |source| ImageError::Write { path: path.to_owned(), source };
        atomic::write(path, &encode(path, self)?).map_err(failed)
    }
}

/// 8-bit RGB, as JPEG where the name ends in .jpg or .jpeg, else as PNG.
///
/// # Errors
///
/// [`ImageError::Encode`] if the picture is too large for such a file.
pub fn encode(path: &Path, picture: &ImageRgb) -> Result<Vec<u8>, ImageError> {
    let jpeg = path.extension().is_some_and(|found| ["jpg", "jpeg"].iter().any(|e| found.eq_ignore_ascii_case(e)));
    let (mut bytes, rgb8, color) = (Vec::new(), picture.to_rgb8(), ExtendedColorType::Rgb8);
    if jpeg {
        let encoder = JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY);
        write(encoder, &rgb8, picture.width(), picture.height(), color)?;
    } else {
        write(PngEncoder::new(&mut bytes), &rgb8, picture.width(), picture.height(), color)?;
    }
    Ok(bytes)
}

/// A 16-bit grey PNG, row-major.
///
/// # Errors
///
/// [`ImageError::Buffer`] unless `data` holds width · height values; [`ImageError::Encode`] if that is too large for a PNG.
pub fn encode_gray16_png(width: usize, height: usize, data: &[u16]) -> Result<Vec<u8>, ImageError> {
    check_buffer(data.len(), width, height, 1)?;
    // The encoder takes the machine's byte order.
    let values: Vec<u8> = data.iter().flat_map(|v| v.to_ne_bytes()).collect();
    let mut bytes = Vec::new();
    write(PngEncoder::new(&mut bytes), &values, width, height, ExtendedColorType::L16)?;
    Ok(bytes)
}

fn write(
    encoder: impl ImageEncoder,
    values: &[u8],
    width: usize,
    height: usize,
    color: ExtendedColorType,
) -> Result<(), ImageError> {
    let failed = |reason: String| ImageError::Encode { width, height, reason };
    let (Ok(across), Ok(down)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(failed("too many pixels in a side".to_owned()));
    };
    encoder.write_image(values, across, down, color).map_err(|error| failed(error.to_string()))
}
