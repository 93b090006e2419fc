//! Writes PNG and JPEG files. Pictures are encoded in memory first, because the PNG encoder drops
//! the error of its last write to a file.

use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::ImageError;
use super::rgb::{ImageRgb, check_buffer};
use crate::fs::{atomic, has_extension};
use crate::geometry::Size;

/// Quality of JPEG files unless another is asked for, 1 to 100.
pub const JPEG_QUALITY: u8 = 95;
/// PNG's keyword for the program that wrote a picture, and its value. A JPEG holds it as a comment.
const SOFTWARE_TAG: &[u8; 17] = b"Software\0liveview";
/// CRC-32 of the chunk `tEXt` that holds [`SOFTWARE_TAG`].
const SOFTWARE_TAG_CRC: u32 = 0xE2C2_02E6;

impl ImageRgb {
    /// Writes the picture atomically, as JPEG if the name ends in .jpg or .jpeg, else as PNG.
    ///
    /// # Errors
    ///
    /// [`ImageError::Encode`] if the picture is too large for the format; [`ImageError::Write`],
    /// naming the file.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), ImageError> {
        let path = path.as_ref();
        let failed = |source| ImageError::Write { path: path.to_owned(), source };
        atomic::write(path, &encode(path, self)?).map_err(failed)
    }
}

/// Encodes 8-bit RGB, as JPEG if the name ends in .jpg or .jpeg, else as PNG.
///
/// # Errors
///
/// [`ImageError::Encode`] if the picture is too large for the format.
pub fn encode(path: &Path, picture: &ImageRgb) -> Result<Vec<u8>, ImageError> {
    encode_with_quality(path, picture, JPEG_QUALITY)
}

/// As [`encode`], a JPEG with this quality, 1 to 100.
///
/// # Errors
///
/// As [`encode`].
pub fn encode_with_quality(path: &Path, picture: &ImageRgb, quality: u8) -> Result<Vec<u8>, ImageError> {
    let (mut bytes, rgb8, color) = (Vec::new(), picture.to_rgb8(), ExtendedColorType::Rgb8);
    Ok(if has_extension(path, &["jpg", "jpeg"]) {
        write(JpegEncoder::new_with_quality(&mut bytes, quality), &rgb8, picture.size(), color)?;
        tagged_jpeg(bytes)
    } else {
        write(PngEncoder::new(&mut bytes), &rgb8, picture.size(), color)?;
        tagged_png(bytes)
    })
}

/// Encodes a 16-bit greyscale PNG; `data` is row-major.
///
/// # Errors
///
/// [`ImageError::Buffer`] unless `data` holds width · height values; [`ImageError::Encode`] if the
/// picture is too large for a PNG.
pub fn encode_gray16_png(width: usize, height: usize, data: &[u16]) -> Result<Vec<u8>, ImageError> {
    check_buffer(data.len(), width, height, 1)?;
    // The encoder expects native byte order.
    let values: Vec<u8> = data.iter().flat_map(|v| v.to_ne_bytes()).collect();
    let mut bytes = Vec::new();
    write(PngEncoder::new(&mut bytes), &values, Size::new(width, height), ExtendedColorType::L16)?;
    Ok(tagged_png(bytes))
}

/// Whether a picture file was written by [`encode`] or [`encode_gray16_png`]; its first 256 bytes
/// suffice.
pub fn is_tagged(picture: &[u8]) -> bool {
    picture.windows(SOFTWARE_TAG.len()).any(|bytes| bytes == SOFTWARE_TAG)
}

/// Inserts [`SOFTWARE_TAG`] after the header chunk.
fn tagged_png(mut png: Vec<u8>) -> Vec<u8> {
    /// Bytes of the signature and the header chunk.
    const HEADER_LEN: usize = 8 + 25;
    let length = (SOFTWARE_TAG.len() as u32).to_be_bytes();
    let chunk = [&length[..], b"tEXt", SOFTWARE_TAG, &SOFTWARE_TAG_CRC.to_be_bytes()].concat();
    png.splice(HEADER_LEN..HEADER_LEN, chunk);
    png
}

/// Inserts [`SOFTWARE_TAG`] after the first segment, the JFIF header.
fn tagged_jpeg(mut jpeg: Vec<u8>) -> Vec<u8> {
    let at = 4 + usize::from(u16::from_be_bytes([jpeg[4], jpeg[5]]));
    let segment = [&[0xFF, 0xFE], &(SOFTWARE_TAG.len() as u16 + 2).to_be_bytes()[..], SOFTWARE_TAG].concat();
    jpeg.splice(at..at, segment);
    jpeg
}

fn write(encoder: impl ImageEncoder, values: &[u8], size: Size, color: ExtendedColorType) -> Result<(), ImageError> {
    let failed = |reason: String| ImageError::Encode { size, reason };
    let (Ok(across), Ok(down)) = (u32::try_from(size.width), u32::try_from(size.height)) else {
        return Err(failed("too many pixels in a side".to_owned()));
    };
    encoder.write_image(values, across, down, color).map_err(|error| failed(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoded_pictures_are_tagged_and_decodable() {
        let picture = ImageRgb::new(5, 3, vec![0.5; 45]).unwrap();
        let [png, jpeg] = ["a.png", "a.jpg"].map(|name| encode(name.as_ref(), &picture).unwrap());
        for bytes in [&png, &jpeg, &encode_gray16_png(5, 3, &[7; 15]).unwrap()] {
            assert!(is_tagged(&bytes[..bytes.len().min(256)]));
            let read = image::load_from_memory(bytes).unwrap();
            assert_eq!((read.width(), read.height()), (5, 3));
        }
        let crc = [b"tEXt", &SOFTWARE_TAG[..]].concat().iter().fold(u32::MAX, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xEDB8_8320 } else { c >> 1 })
        });
        assert_eq!(!crc, SOFTWARE_TAG_CRC);
        // A comment segment between the first segment of a JPEG (JFIF) and the next.
        let tag = jpeg.windows(SOFTWARE_TAG.len()).position(|bytes| bytes == SOFTWARE_TAG).unwrap();
        assert_eq!((&jpeg[tag - 4..tag - 2], jpeg[tag + SOFTWARE_TAG.len()]), (&[0xFF, 0xFE][..], 0xFF));
    }
}
