//! PNG and JPEG files, read to interleaved f32 RGB, and written; WebP, TIFF and BMP are read where a program has these
//! features of the crate `image`, as all with `liveview-scene` have.
//!
//! Colours are sRGB values in [0, 1] as stored in the file (no linearisation). Transparent pixels are
//! composited on a background. The EXIF orientation is ignored, as in COLMAP and other pose estimators,
//! so poses belong to the pixels as stored; [`ImageRgb::turned`] applies it. [`read_header`] reports both.
//! Pictures are encoded in memory first, because the PNG encoder drops the error of its last write to a
//! file.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::metadata::Orientation;
use image::{ExtendedColorType, ImageDecoder, ImageEncoder, ImageFormat, ImageReader, Limits};

use super::rgb::check_buffer;
use super::{ImageError, ImageRgb};
use crate::geometry::{MAX_SIDE, Size};

/// Memory that a decoder may use in addition to the pixels, in bytes: a compressed colour profile
/// of a few bytes can expand to gigabytes.
const MAX_EXTRA_BYTES: u64 = 64 << 20;

/// Largest file that is read, bytes.
const MAX_BYTES: u64 = 1 << 30;

/// Properties from the header of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Header {
    /// Size in pixels, as stored.
    pub size: Size,
    /// Its EXIF orientation, 1 (as stored) to 8; [`load`] ignores it.
    pub orientation: u8,
    /// Whether it has an alpha channel.
    pub alpha: bool,
}

/// Reads the header of a picture.
///
/// # Errors
///
/// As [`read_size`].
pub fn read_header(path: &Path) -> Result<Header, ImageError> {
    let (mut decoder, size) = decoder_and_size(path, open(path)?)?;
    // Damaged EXIF data counts as none.
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms).to_exif();
    Ok(Header { size, orientation, alpha: decoder.color_type().has_alpha() })
}

/// Reads the size of a picture in pixels from its header.
///
/// # Errors
///
/// [`ImageError::Read`], [`ImageError::Decode`] or [`ImageError::TooLarge`], naming the file.
pub fn read_size(path: &Path) -> Result<Size, ImageError> {
    Ok(decoder_and_size(path, open(path)?)?.1)
}

fn open(path: &Path) -> Result<BufReader<File>, ImageError> {
    let failed = |source| ImageError::Read { path: path.to_owned(), source };
    let file = File::open(path).map_err(failed)?;
    match file.metadata().map_err(failed)?.len() {
        ..=MAX_BYTES => Ok(BufReader::new(file)),
        bytes => Err(failed(io::Error::new(
            io::ErrorKind::FileTooLarge,
            format!("the file has {bytes} bytes; expected at most {MAX_BYTES}"),
        ))),
    }
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
fn reader<R: BufRead + Seek>(path: &Path, mut input: R) -> Result<ImageReader<R>, ImageError> {
    let failed = |source| ImageError::Read { path: path.to_owned(), source };
    let reason = why_unsupported(input.fill_buf().map_err(failed)?);
    let reader = ImageReader::new(input).with_guessed_format().map_err(failed)?;
    use ImageFormat::{Bmp, Jpeg, Png, Tiff, WebP};
    match reader.format() {
        Some(Bmp | Jpeg | Png | Tiff | WebP) => Ok(reader),
        _ => Err(ImageError::Decode { path: path.to_owned(), reason }),
    }
}

/// What a file is that is no picture of a supported format, by its first bytes, and what helps.
fn why_unsupported(head: &[u8]) -> String {
    let brand = head.get(4..12).filter(|brand| brand.starts_with(b"ftyp")).map_or(&[][..], |brand| &brand[4..]);
    let (kind, extension) = match (head, brand) {
        ([], _) => return "the file is empty".to_owned(),
        (_, b"avif" | b"avis") => ("AVIF", "avif"),
        (_, b"heic" | b"heix" | b"hevc" | b"heim" | b"heis" | b"mif1" | b"msf1") => ("HEIC", "heic"),
        ([0x76, 0x2F, 0x31, 0x01, ..], _) => ("OpenEXR", "exr"),
        _ if head.starts_with(b"version https://git-lfs") => {
            return "a pointer of Git LFS, not the photo; `git lfs pull` fetches it".to_owned();
        }
        _ => return "unknown file format".to_owned(),
    };
    format!("{kind} is not supported; `magick mogrify -format jpg *.{extension}` converts the photos of a folder")
}

/// Decodes a picture, transparent pixels on white.
///
/// # Errors
///
/// [`ImageError::Read`], and those of [`decode`].
pub fn load(path: &Path) -> Result<ImageRgb, ImageError> {
    let mut bytes = Vec::new();
    // A device or a pipe does not report its size beforehand.
    let read = open(path)?.take(MAX_BYTES).read_to_end(&mut bytes);
    read.map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
    decode(path, &bytes, WHITE)
}

/// Decodes the bytes of a picture file, transparent pixels on a background (RGB); `path` is for errors.
///
/// # Errors
///
/// [`ImageError::TooLarge`]; [`ImageError::Decode`] if the file is damaged or ends early. JPEG data has no
/// checksum: some damage gives another picture instead.
pub fn decode(path: &Path, bytes: &[u8], background: [f32; 3]) -> Result<ImageRgb, ImageError> {
    let (_, size) = decoder_and_size(path, Cursor::new(bytes))?;
    let mut reader = reader(path, Cursor::new(bytes))?;
    let mut limits = Limits::no_limits();
    // A PNG has up to four channels of 16 bits.
    limits.max_alloc = Some(8 * size.pixels() as u64 + MAX_EXTRA_BYTES);
    reader.limits(limits);
    // If the decoder panics, the error names the file; no state of the decoder outlives the call.
    let decoded = catch_unwind(AssertUnwindSafe(|| reader.decode()));
    let failed = |_| ImageError::Decode { path: path.to_owned(), reason: "the decoder failed".to_owned() };
    let decoded = decoded.map_err(failed)?.map_err(|error| decode_error(path, &error))?;
    let rgb = match decoded.color().has_alpha() {
        false => decoded.into_rgb32f().into_raw(),
        true => {
            let on_background = |&[r, g, b, alpha]: &[f32; 4]| {
                let mix = |colour: f32, behind: f32| behind + alpha * (colour - behind);
                [mix(r, background[0]), mix(g, background[1]), mix(b, background[2])]
            };
            decoded.into_rgba32f().as_chunks().0.iter().flat_map(on_background).collect()
        }
    };
    ImageRgb::new(size.width, size.height, rgb)
}

/// The background of [`load`].
pub const WHITE: [f32; 3] = [1.0; 3];

fn decode_error(path: &Path, error: &image::ImageError) -> ImageError {
    ImageError::Decode { path: path.to_owned(), reason: error.to_string() }
}

/// Quality of JPEG files unless another is asked for, 1 to 100.
pub const JPEG_QUALITY: u8 = 95;
/// PNG's keyword for the program that wrote a picture, and its value. A JPEG holds it as a comment.
const SOFTWARE_TAG: &[u8; 17] = b"Software\0liveview";
/// CRC-32 of the chunk `tEXt` that holds [`SOFTWARE_TAG`].
const SOFTWARE_TAG_CRC: u32 = 0xE2C2_02E6;

impl ImageRgb {
    /// Writes the picture, as JPEG if the name ends in .jpg or .jpeg, else as PNG.
    ///
    /// # Errors
    ///
    /// [`ImageError::Encode`] if the picture is too large for the format; [`ImageError::Write`],
    /// naming the file.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), ImageError> {
        let path = path.as_ref();
        let failed = |source| ImageError::Write { path: path.to_owned(), source };
        fs::write(path, encode(path, self)?).map_err(failed)
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
    let is_jpeg = |found: &OsStr| found.eq_ignore_ascii_case("jpg") || found.eq_ignore_ascii_case("jpeg");
    Ok(if path.extension().is_some_and(is_jpeg) {
        write(JpegEncoder::new_with_quality(&mut bytes, quality), &rgb8, picture.size(), color)?;
        // After the first segment, the JFIF header.
        let at = 4 + usize::from(u16::from_be_bytes([bytes[4], bytes[5]]));
        let segment = [&[0xFF, 0xFE], &(SOFTWARE_TAG.len() as u16 + 2).to_be_bytes()[..], SOFTWARE_TAG].concat();
        bytes.splice(at..at, segment);
        bytes
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
