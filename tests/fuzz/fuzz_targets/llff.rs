//! LLFF poses_bounds.npy.
#![no_main]

use libfuzzer_sys::fuzz_target;
use liveview::fuzz::scene;
use liveview_fuzz::opened;

fuzz_target!(|bytes: &[u8]| {
    opened(scene::llff(bytes));
});
