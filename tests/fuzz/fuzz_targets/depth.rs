//! A cached depth file of a photo of 7×5 pixels.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| match liveview_surface::cache::read_for_fuzzing(bytes) {
    Ok(depth) => {
        assert_eq!(depth.disparity.dim(), (5, 7));
        assert!(depth.disparity.iter().all(|disparity| (0.11..0.52).contains(disparity)), "{:?}", depth.disparity);
        assert!(
            depth.disparity_per_pixel.is_finite() && depth.disparity_per_pixel > 0.0,
            "{}",
            depth.disparity_per_pixel
        );
    }
    Err(damage) => assert!(damage.contains("; expected "), "{damage}"),
});
