//! JPEG files that are cut are an error; valid files of all kinds are read.

use std::fs;
use std::path::Path;

use liveview_scene::{SceneError, load_photo};

fn load(path: &Path) -> Result<liveview::ImageRgb, SceneError> {
    load_photo(path, [1.0; 3])
}

fn photos() -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/scenes/workshop/images");
    fs::read_dir(folder).unwrap().map(|entry| fs::read(entry.unwrap().path()).unwrap()).collect()
}

/// Start and end of the last scan's data, in bytes.
fn scan(jpeg: &[u8]) -> (usize, usize) {
    (jpeg.windows(2).rposition(|marker| marker == [0xFF, 0xDA]).unwrap() + 14, jpeg.len() - 2)
}

/// The error message on loading these bytes as a file; empty if they are valid.
fn load_error(bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("photo.jpg");
    fs::write(&path, bytes).unwrap();
    load(&path).map_or_else(|error| error.to_string(), |_| String::new())
}

/// A file that was copied or written in part.
#[test]
fn cut_files_are_an_error() {
    for jpeg in photos() {
        assert_eq!(load_error(&jpeg), "");
        let (start, end) = scan(&jpeg);
        for length in [start, start + (end - start) / 2, end - (end - start) / 50] {
            let error = load_error(&jpeg[..length]);
            assert!(error.contains("photo.jpg: not a complete picture"), "{length} of {}: {error}", jpeg.len());
        }
    }
}

/// Progressive, with restart markers, greyscale, with subsampled chroma, all with partial blocks.
#[test]
fn valid_files_of_all_kinds_load_as_other_decoders_read_them() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/jpeg");
    let mut files = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let picture = load(&path).unwrap();
        assert_eq!((picture.width(), picture.height()), (77, 53), "{}", path.display());
        assert_eq!(picture.to_rgb8(), liveview::image::load(&path).unwrap().to_rgb8(), "{}", path.display());
        files += 1;
    }
    assert_eq!(files, 7);
}

/// The memory check uses the size in the first frame header, so a second header must not change it.
#[test]
fn second_frame_header_is_an_error() {
    for jpeg in photos() {
        let start = jpeg.windows(2).position(|marker| marker == [0xFF, 0xC0]).unwrap();
        let end = start + 2 + usize::from(u16::from_be_bytes([jpeg[start + 2], jpeg[start + 3]]));
        let error = load_error(&[&jpeg[..end], &jpeg[start..]].concat());
        assert!(error.contains("photo.jpg") && error.contains("Start of Frame"), "{error}");
    }
}

/// The decoder would panic.
#[test]
fn chroma_sampled_more_finely_than_luma_is_an_error() {
    for mut jpeg in photos() {
        let start = jpeg.windows(2).position(|marker| marker == [0xFF, 0xC0]).unwrap();
        // The sampling factors of the first component and of the second.
        (jpeg[start + 11], jpeg[start + 14]) = (0x11, 0x22);
        let error = load_error(&jpeg);
        assert!(error.contains("photo.jpg") && error.contains("sampled more finely than the first"), "{error}");
    }
}
