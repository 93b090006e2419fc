//! Photos: detecting the format, reading the size, decoding.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use liveview::image::read_size;
use liveview_fuzz::file_in_memory;
use liveview_scene::load_photo;

static FILE: LazyLock<PathBuf> = LazyLock::new(|| file_in_memory("photo"));

fuzz_target!(|bytes: &[u8]| {
    std::fs::write(&*FILE, bytes).unwrap();
    // Larger pictures take too long.
    if read_size(&FILE).is_ok_and(|size| size.pixels() > 1 << 12) {
        return;
    }
    match load_photo(&FILE, [1.0; 3]) {
        Ok(photo) => {
            assert_eq!(photo.data().len(), 3 * photo.width() * photo.height());
            assert!(photo.data().iter().all(|value| (0.0..=1.0).contains(value)));
        }
        Err(error) => assert!(error.to_string().contains("photo: "), "{error}"),
    }
});
