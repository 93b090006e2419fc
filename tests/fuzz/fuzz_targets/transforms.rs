//! transforms.json.
#![no_main]

use libfuzzer_sys::fuzz_target;
use liveview_scene::fuzz;
use liveview_fuzz::check_opened;

fuzz_target!(|bytes: &[u8]| {
    check_opened(scene::transforms(bytes));
});
