//! Helpers of the fuzz targets.

use std::path::{Component, PathBuf};

use liveview_scene::fuzz::Opened;

/// Asserts that the views of an opened scene are valid, and that an error names the scene.
///
/// # Panics
///
/// If an assertion fails.
pub fn check_opened(result: Opened) {
    match result {
        Ok((views, _)) => {
            assert!(!views.is_empty());
            for view in views {
                let camera = &view.camera;
                let numbers = [camera.k(), camera.k_inverse(), camera.rotation()].map(|matrix| matrix.to_cols_array());
                assert!(numbers.as_flattened().iter().all(|number| number.is_finite()), "{camera:?}");
                assert!(camera.centre().is_finite(), "{camera:?}");
                assert!(view.depth_range.is_none_or(|(near, far)| 0.0 < near && near < far && far.is_finite()));
                let has_parent = view.image_path().components().any(|part| part == Component::ParentDir);
                assert!(view.image_path().starts_with("scene") && !has_parent, "{}", view.name);
            }
        }
        Err(error) => assert!(error.to_string().starts_with("scene"), "{error}"),
    }
}

/// Splits the fuzzer's bytes into three files. The first and second file are each preceded by their
/// length, a little-endian u16; the third is the rest.
pub fn split_into_three_files(bytes: &[u8]) -> [&[u8]; 3] {
    let file = |bytes: &'_ [u8]| -> (usize, usize) {
        let Some(length) = bytes.first_chunk() else { return (bytes.len(), bytes.len()) };
        (2, (2 + usize::from(u16::from_le_bytes(*length))).min(bytes.len()))
    };
    let (start, end) = file(bytes);
    let (first, rest) = (&bytes[start..end], &bytes[end..]);
    let (start, end) = file(rest);
    [first, &rest[start..end], &rest[end..]]
}

/// A path for the file of each input, in memory where there is such a folder.
///
/// # Panics
///
/// If its folder cannot be created.
pub fn file_in_memory(name: &str) -> PathBuf {
    let memory = PathBuf::from("/dev/shm");
    let folder = if memory.is_dir() { memory } else { std::env::temp_dir() };
    let folder = folder.join(format!("liveview_fuzz_{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder.join(name)
}
