//! Damaged JPEG data is an error, as for PNG; valid files of all kinds are read.

use std::fs;
use std::path::Path;

use liveview_scene::load_photo as load;

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

#[test]
fn half_of_the_data_zeroed_is_an_error() {
    for jpeg in photos() {
        assert_eq!(load_error(&jpeg), "");
        let (start, end) = scan(&jpeg);
        let mut damaged = jpeg.clone();
        damaged[start + (end - start) / 2..end].fill(0);
        let error = load_error(&damaged);
        assert!(error.contains("photo.jpg") && error.contains("the JPEG's compressed data is damaged"), "{error}");
    }
}

/// Not all damage is detectable: the codes after it may be valid by chance.
#[test]
fn forty_bytes_overwritten_are_mostly_an_error() {
    let (mut refused, mut total) = (0, 0);
    let mut random = 1_u64;
    let mut next = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as usize
    };
    for jpeg in photos() {
        let (start, end) = scan(&jpeg);
        for _ in 0..8 {
            let mut damaged = jpeg.clone();
            let at = start + next() % (end - start - 40);
            damaged[at..at + 40].fill_with(|| next() as u8);
            refused += usize::from(!load_error(&damaged).is_empty());
            total += 1;
        }
    }
    println!("{refused} of {total} refused");
    assert!(10 * refused > 7 * total, "{refused} of {total}"); // measured on other photos: 80 %
}

/// Progressive, with restart markers, greyscale, with subsampled chroma, all with partial blocks.
#[test]
fn valid_files_of_all_kinds_load_and_fail_when_truncated() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/jpeg");
    let mut files = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let picture = load(&path).unwrap();
        assert_eq!((picture.width(), picture.height()), (77, 53), "{}", path.display());
        let jpeg = fs::read(&path).unwrap();
        let (start, end) = scan(&jpeg);
        let truncated = [&jpeg[..start], &jpeg[start + (end - start) / 2..]].concat();
        assert!(load_error(&truncated).contains("photo.jpg"), "{}: half of the last scan removed", path.display());
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
