//! Photos: detecting the format, reading the size, detecting truncation, decoding.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| match liveview::fuzz::image(bytes) {
    Ok(Some(photo)) => {
        assert_eq!(photo.data().len(), 3 * photo.width() * photo.height());
        assert!(photo.data().iter().all(|value| (0.0..=1.0).contains(value)));
    }
    Ok(None) => {}
    Err(error) => assert!(error.to_string().starts_with("photo: "), "{error}"),
});
