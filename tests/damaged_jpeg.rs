//! JPEG data that is damaged is refused, as PNG data is; whatever a sound encoder writes is read.

use std::fs;
use std::path::Path;

use liveview::image::load;

fn photos() -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scenes/workshop/images");
    fs::read_dir(folder).unwrap().map(|entry| fs::read(entry.unwrap().path()).unwrap()).collect()
}

/// Where the data of the scan begins and ends.
fn scan(jpeg: &[u8]) -> (usize, usize) {
    (jpeg.windows(2).rposition(|marker| marker == [0xFF, 0xDA]).unwrap() + 14, jpeg.len() - 2)
}

/// What is said of these bytes as a file; empty if it is read.
fn said(bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("photo.jpg");
    fs::write(&path, bytes).unwrap();
    load(&path).map_or_else(|error| error.to_string(), |_| String::new())
}

#[test]
fn half_of_the_data_zeroed() {
    for jpeg in photos() {
        assert_eq!(said(&jpeg), "");
        let (start, end) = scan(&jpeg);
        let mut damaged = jpeg.clone();
        damaged[start + (end - start) / 2..end].fill(0);
        let said = said(&damaged);
        assert!(said.contains("photo.jpg") && said.contains("the JPEG's compressed data is damaged"), "{said}");
    }
}

/// Codes that happen to be right again after the damage cannot be told from right ones: most of it is found, not all.
#[test]
fn forty_bytes_overwritten() {
    let (mut refused, mut all) = (0, 0);
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
            refused += usize::from(!said(&damaged).is_empty());
            all += 1;
        }
    }
    println!("{refused} of {all} refused");
    assert!(10 * refused > 7 * all, "{refused} of {all}"); // 80 in 100 of other photos
}

/// Progressive, with restart markers, of one channel, with channels of less resolution, of sizes that fill no block.
#[test]
fn sound_files_of_every_kind_are_read() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/jpeg");
    let mut kinds = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let picture = load(&path).unwrap();
        assert_eq!((picture.width(), picture.height()), (77, 53), "{}", path.display());
        let jpeg = fs::read(&path).unwrap();
        let (start, end) = scan(&jpeg);
        let without = [&jpeg[..start], &jpeg[start + (end - start) / 2..]].concat();
        assert!(said(&without).contains("photo.jpg"), "{}: half of its last scan is gone", path.display());
        kinds += 1;
    }
    assert_eq!(kinds, 7);
}

/// The size that memory was asked for is the first one's.
#[test]
fn a_second_frame_header() {
    for jpeg in photos() {
        let start = jpeg.windows(2).position(|marker| marker == [0xFF, 0xC0]).unwrap();
        let end = start + 2 + usize::from(u16::from_be_bytes([jpeg[start + 2], jpeg[start + 3]]));
        let said = said(&[&jpeg[..end], &jpeg[start..]].concat());
        assert!(said.contains("photo.jpg") && said.contains("Start of Frame"), "{said}");
    }
}
