//! A JSON file of cameras, or a camera path of nerfstudio's viewer.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use liveview::glam::{DMat3, DVec3};
use liveview::{Camera, Intrinsics};
use liveview_fuzz::file_in_memory;
use liveview_scene::cameras::read_cameras;

static FILE: LazyLock<PathBuf> = LazyLock::new(|| file_in_memory("cameras.json"));

fuzz_target!(|bytes: &[u8]| {
    let intrinsics = Intrinsics { fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0, skew: 0.0 };
    let view = Camera::new(intrinsics, 64, 48, DMat3::IDENTITY, DVec3::ZERO).unwrap();
    std::fs::write(&*FILE, bytes).unwrap();
    match read_cameras(&FILE, &[&view], FILE.parent().unwrap()) {
        Ok(found) => {
            assert!(!found.cameras.is_empty());
            for camera in found.cameras {
                let numbers = [camera.k(), camera.k_inverse(), camera.rotation()].map(|matrix| matrix.to_cols_array());
                assert!(numbers.as_flattened().iter().all(|number| number.is_finite()), "{camera:?}");
                assert!(camera.centre().is_finite(), "{camera:?}");
            }
        }
        Err(error) => assert!(error.to_string().contains("cameras.json"), "{error}"),
    }
});
