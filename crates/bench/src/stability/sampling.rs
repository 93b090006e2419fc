//! Extreme sampling: tiny photos, samples exactly on edges and far outside, magnification and minification. The target's pixel x is at
//! `scale` x + `shift` in the source.

use std::borrow::Cow;

use glam::{DMat3, DVec3};
use liveview::geometry::{Camera, CameraError, Intrinsics};
use liveview::image::ImageRgb;

use super::case::{Case, Seeded, decades};
use super::warp::{BOUND, WarpCase};

/// Size of the sampled photo, except in the family of sizes: odd, and not a multiple of any block size.
const PHOTO_SIZE: (usize, usize) = (37, 23);

/// Error bound at whole and half pixels: samples are pixels or means of two, rounded once or twice.
const EXACT_BOUND: f64 = 1.2e-7;

fn photo((width, height): (usize, usize)) -> ImageRgb {
    let noise = Seeded((width * 1000 + height) as u64).units(3 * width * height);
    ImageRgb::new(width, height, noise).expect("one value per channel and pixel")
}

/// A camera at the origin.
fn camera((width, height): (usize, usize), scale: f64, shift: (f64, f64)) -> Result<Camera, CameraError> {
    let intrinsics = Intrinsics { fx: scale, fy: scale, cx: shift.0, cy: shift.1, skew: 0.0 };
    Camera::new(intrinsics, width, height, DMat3::IDENTITY, DVec3::ZERO)
}

/// A photo sampled at `scale` times the pixel, plus `shift`, by a target of this size.
fn sampled<'a>(photo: ImageRgb, size: (usize, usize), scale: f64, shift: (f64, f64)) -> WarpCase<'a> {
    let beside = scale == 1.0 && (shift.0.abs() >= photo.width() as f64 || shift.1.abs() >= photo.height() as f64);
    WarpCase {
        source: camera((photo.width(), photo.height()), scale, shift),
        target: camera(size, 1.0, (0.0, 0.0)),
        photo: Cow::Owned(photo),
        disparity: 0.0,
        covers_nothing: beside,
        equivalent_rig: None,
        well_conditioned: None,
    }
}

pub(super) fn families<'a>() -> Vec<Vec<Case<'a>>> {
    let sizes = [(1, 1), (1, 9), (9, 1), (2, 2), (3, 5), (17, 1), (65, 63), (129, 7)];
    let sizes = sizes.map(|size| {
        let target = (size.0 + 2, size.1 + 3);
        (format!("{}x{}", size.0, size.1), sampled(photo(size), target, 1.0, (-0.75, -1.25)))
    });
    let (width, height) = (PHOTO_SIZE.0 as f64, PHOTO_SIZE.1 as f64);
    let shifts =
        [0.0, 0.5, 1.0].map(|by| [(by, 0.0), (-by, by), (width - by, 0.0), (by - width, 0.0), (0.0, by - height)]);
    let edges = shifts
        .into_iter()
        .flatten()
        .map(|shift| (format!("shift {}, {}", shift.0, shift.1), sampled(photo(PHOTO_SIZE), PHOTO_SIZE, 1.0, shift)));
    let outside = decades((0..=9).chain([15, 30, 150, 300])).map(|shift| {
        Case::new(
            "far outside",
            shift,
            format!("shift {shift:.0e}"),
            sampled(photo(PHOTO_SIZE), PHOTO_SIZE, 1.0, (shift, -shift)),
            BOUND,
        )
    });
    let scaled = |family: &'static str, scale: f64| {
        let middle = (width / 2.0 * (1.0 - scale) + 0.3, height / 2.0 * (1.0 - scale) - 0.2);
        Case::new(
            family,
            scale.max(1.0 / scale),
            format!("scale {scale:.0e}"),
            sampled(photo(PHOTO_SIZE), PHOTO_SIZE, scale, middle),
            BOUND,
        )
    };
    vec![
        Case::listed("photo size", BOUND, sizes),
        Case::listed("exact hits of edges", EXACT_BOUND, edges),
        outside.collect(),
        decades(0..=6).map(|by| scaled("magnification", 1.0 / by)).collect(),
        decades(0..=6).map(|by| scaled("minification", by)).collect(),
    ]
}
