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
/// PNG's keyword for the program that made a picture, and its value. In a JPEG it is a comment.
const MARK: &[u8; 17] = b"Software\0liveview";
/// CRC-32 of the chunk `tEXt` that holds [`MARK`].
const MARK_CRC: u32 = 0xE2C2_02E6;

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
    Ok(if jpeg {
        let encoder = JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY);
        write(encoder, &rgb8, picture.width(), picture.height(), color)?;
        marked_jpeg(bytes)
    } else {
        write(PngEncoder::new(&mut bytes), &rgb8, picture.width(), picture.height(), color)?;
        marked_png(bytes)
    })
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
    Ok(marked_png(bytes))
}

/// Whether a picture, or its first 256 bytes, bears the mark that [`encode`] and [`encode_gray16_png`] leave in theirs.
pub fn has_mark(picture: &[u8]) -> bool {
    picture.windows(MARK.len()).any(|bytes| bytes == MARK)
}

/// Puts [`MARK`] after the header.
fn marked_png(mut png: Vec<u8>) -> Vec<u8> {
    /// Of the signature and the first chunk.
    const HEADER: usize = 8 + 25;
    let length = (MARK.len() as u32).to_be_bytes();
    let chunk = [&length[..], b"tEXt", MARK, &MARK_CRC.to_be_bytes()].concat();
    png.splice(HEADER..HEADER, chunk);
    png
}

/// Puts [`MARK`] after the first segment, which says what kind of JPEG it is.
fn marked_jpeg(mut jpeg: Vec<u8>) -> Vec<u8> {
    let at = 4 + usize::from(u16::from_be_bytes([jpeg[4], jpeg[5]]));
    let segment = [&[0xFF, 0xFE], &(MARK.len() as u16 + 2).to_be_bytes()[..], MARK].concat();
    jpeg.splice(at..at, segment);
    jpeg
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_bear_a_mark_and_are_still_read() {
        let picture = ImageRgb::new(5, 3, vec![0.5; 45]).unwrap();
        let [png, jpeg] = ["a.png", "a.jpg"].map(|name| encode(name.as_ref(), &picture).unwrap());
        for bytes in [&png, &jpeg, &encode_gray16_png(5, 3, &[7; 15]).unwrap()] {
            assert!(has_mark(&bytes[..bytes.len().min(256)]));
            let read = image::load_from_memory(bytes).unwrap();
            assert_eq!((read.width(), read.height()), (5, 3));
        }
        let crc = [b"tEXt", &MARK[..]].concat().iter().fold(u32::MAX, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xEDB8_8320 } else { c >> 1 })
        });
        assert_eq!(!crc, MARK_CRC);
        // Between the first segment of a JPEG (JFIF) and the next.
        let mark = jpeg.windows(MARK.len()).position(|bytes| bytes == MARK).unwrap();
        assert_eq!((&jpeg[mark - 4..mark - 2], jpeg[mark + MARK.len()]), (&[0xFF, 0xFE][..], 0xFF));
    }
}
