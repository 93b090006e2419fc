//! Reading and writing pictures.

use std::fs;

use image::ImageEncoder;
use liveview::geometry::MAX_SIDE;
use liveview::image::{ImageRgb, encode_gray16_png, load, read_size};
use tempfile::tempdir;

use crate::scene_common::{assert_says, crc32, notes, open, picture, refusal, transforms, write};

#[test]
fn truncated_photo_is_an_error_that_names_the_file() {
    for name in ["a.png", "a.jpg"] {
        let root = tempdir().unwrap();
        transforms(root.path(), "images/a.png", &format!("images/{name}"));
        let path = root.path().join("images").join(name);
        picture(&path, 64, 48);
        let bytes = fs::read(&path).unwrap();
        assert!(open(root.path()).unwrap().load_image(0).is_ok(), "{name}");
        for keep in [bytes.len() * 3 / 4, bytes.len() * 95 / 100, bytes.len() - 3] {
            fs::write(&path, &bytes[..keep]).unwrap();
            // Of a PNG, the checksum of the last chunk, which is empty, is not needed.
            let is_needed = name == "a.jpg" || keep != bytes.len() - 3;
            if is_needed {
                assert_says(&refusal(root.path()), &[name, "not a complete picture", "before its end marker"]);
            }
        }
        fs::write(&path, &bytes[..10]).unwrap();
        assert_says(&refusal(root.path()), &[name, "not a complete picture"]);
        fs::write(&path, "not a picture").unwrap();
        assert_says(&refusal(root.path()), &[name, "unknown file format"]);
    }
}

#[test]
fn oversized_picture_is_an_error_before_decoding() {
    let root = tempdir().unwrap();
    let path = root.path().join("wide.png");
    // A small PNG with another width in its header: no pixels of such a picture exist.
    picture(&path, 8, 8);
    let mut bytes = fs::read(&path).unwrap();
    bytes[16..20].copy_from_slice(&20_000_u32.to_be_bytes());
    let checksum = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
    fs::write(&path, bytes).unwrap();
    for result in [load(&path).map(|_| ()), read_size(&path).map(|_| ())] {
        let message = result.unwrap_err().to_string();
        assert_says(&message, &["wide.png", "20000x8", &MAX_SIDE.to_string()]);
    }
}

#[test]
fn exif_orientation_and_alpha_are_ignored_with_a_note() {
    let root = tempdir().unwrap();
    transforms(root.path(), "", "");
    let path = root.path().join("images/a.png");
    let orientation =
        |value| [b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0", &[value][..], b"\0\0\0\0\0\0"].concat();
    let write_photo = |exif: Vec<u8>| {
        let mut encoder = image::codecs::png::PngEncoder::new(fs::File::create(&path).unwrap());
        encoder.set_exif_metadata(exif).unwrap();
        encoder.write_image(&[128; 4 * 64 * 48], 64, 48, image::ExtendedColorType::Rgba8).unwrap();
    };
    write_photo(orientation(6));
    let notes_of_oriented = notes(&open(root.path()).unwrap());
    assert_says(&notes_of_oriented, &["EXIF orientation ignored", "transparent pixels composited", "images/a.png"]);
    write_photo(orientation(1));
    assert!(!notes(&open(root.path()).unwrap()).contains("EXIF"));
}

#[test]
fn saved_picture_loads_within_8_bit_rounding() {
    let root = tempdir().unwrap();
    let values: Vec<f32> = (0..5 * 3 * 3).map(|i| i as f32 / 44.0).collect();
    let picture = ImageRgb::new(5, 3, values).unwrap();
    let path = root.path().join("out.png");
    picture.save(&path).unwrap();
    let loaded = load(&path).unwrap();
    let worst = picture.data().iter().zip(loaded.data()).fold(0.0_f32, |worst, (a, b)| worst.max((a - b).abs()));
    assert!(worst <= 0.5 / 255.0 + 1e-6, "{worst}");
    let depth: Vec<u16> = (0..15).map(|i| i * 4000).collect();
    let grey = encode_gray16_png(5, 3, &depth).unwrap();
    assert_eq!(image::load_from_memory(&grey).unwrap().into_luma16().into_raw(), depth);
    // No temporary file is left.
    assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1);
    let out_of_range = ImageRgb::new(1, 1, vec![f32::NAN, -1.0, 7.0]).unwrap();
    out_of_range.save(&path).unwrap();
    assert_eq!(load(&path).unwrap().pixel(0, 0), [0.0, 0.0, 1.0]);
}

#[test]
fn unwritable_file_and_wrong_buffer_length_are_errors() {
    let root = tempdir().unwrap();
    let picture = ImageRgb::new(1, 1, vec![0.0; 3]).unwrap();
    let message = picture.save(root.path().join("no/where.png")).unwrap_err().to_string();
    assert_says(&message, &["where.png: cannot be written"]);
    fs::create_dir(root.path().join("folder.png")).unwrap();
    let message = picture.save(root.path().join("folder.png")).unwrap_err().to_string();
    assert_says(&message, &["folder.png: cannot be written"]);
    assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1, "no temporary file is left");
    let message = ImageRgb::new(2, 2, vec![0.0; 11]).unwrap_err().to_string();
    assert_eq!(message, "11 values given for a 2x2 image with 3 channels");
    let message = encode_gray16_png(usize::MAX, 2, &[]).unwrap_err().to_string();
    assert_says(&message, &["0 values given"]);
}

/// A file that the fuzzer found; another decoder panicked on it.
#[test]
fn jpeg_with_bytes_between_headers_is_an_error() {
    let root = tempdir().unwrap();
    let photo = root.path().join("photo.jpg");
    write(&photo, include_bytes!("../../../../tests/fixtures/damaged/fine_chroma.jpg"));
    let message = liveview_scene::load_photo(&photo, [1.0; 3]).unwrap_err().to_string();
    assert_says(&message, &["photo.jpg: not a complete picture", "Extra bytes between headers"]);
}

#[test]
fn arrays_have_rows_columns_and_channels() {
    let bytes = ndarray::Array3::from_shape_fn((2, 4, 3), |(y, x, channel)| (100 * y + 10 * x + channel) as u8);
    let picture = ImageRgb::from_array_u8(bytes.view()).unwrap();
    assert_eq!((picture.width(), picture.height()), (4, 2));
    assert_eq!(picture.pixel(3, 1), [130.0, 131.0, 132.0].map(|value| value / 255.0));
    assert_eq!(picture.to_array_u8(), bytes);
    assert_eq!(picture.as_array()[[1, 3, 2]], picture.pixel(3, 1)[2]);
    // A view in another order, such as that of a transposed array, is read by its indices.
    let turned = picture.as_array().permuted_axes([1, 0, 2]);
    let turned = ImageRgb::from_array(turned).unwrap();
    assert_eq!((turned.width(), turned.pixel(1, 3)), (2, picture.pixel(3, 1)));
    let message = ImageRgb::from_array_u8(bytes.view().permuted_axes([2, 0, 1])).unwrap_err().to_string();
    assert_eq!(message, "the array has shape [3, 2, 4]; expected [height, width, 3]");
}
