//! Camera parameters that RealityCapture exports.
#![no_main]

use libfuzzer_sys::fuzz_target;
use liveview_fuzz::check_opened;
use liveview_scene::fuzz;

fuzz_target!(|bytes: &[u8]| {
    check_opened(fuzz::realitycapture(bytes));
});
