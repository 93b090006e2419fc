//! COLMAP binary: three files, as `three_files` divides them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use liveview::fuzz::scene;
use liveview_fuzz::{opened, three_files};

fuzz_target!(|bytes: &[u8]| {
    opened(scene::colmap(true, three_files(bytes)));
});
