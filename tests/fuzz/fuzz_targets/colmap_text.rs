//! COLMAP, text: cameras, images and points, as `split_into_three_files` divides the input.
#![no_main]

use libfuzzer_sys::fuzz_target;
use liveview_fuzz::{check_opened, split_into_three_files};
use liveview_scene::fuzz;

fuzz_target!(|bytes: &[u8]| {
    check_opened(fuzz::colmap(false, split_into_three_files(bytes)));
});
