//! PLY files of points.
#![no_main]

use libfuzzer_sys::fuzz_target;
use liveview_scene::fuzz;

fuzz_target!(|bytes: &[u8]| if let Err(damage) = fuzz::ply(bytes) {
    assert!(damage.contains("; expected "), "{damage}");
});
