//! The files of a frame's disparity.

use crate::args::output::Variant;
use anyhow::Result;
use liveview::image::{coloured, encode, encode_gray16_png};
use liveview::{Frame, Shot};
use serde_json::json;

/// The files of a disparity map: 16 bits, in colour, scale.
pub(super) const DEPTH: [Variant; 3] = [("", None), ("_colour", None), ("_scale", Some("json"))];

/// Largest disparity of a frame (1/scene unit): 65535 in the 16-bit PNG.
pub(super) fn disparity_max(frame: &Frame) -> f32 {
    frame.disparity.iter().copied().fold(0.0, f32::max)
}

/// The contents of the files of [`DEPTH`].
pub(super) fn disparity(shot: &Shot, frame: &Frame) -> Result<[Vec<u8>; 3]> {
    let largest = disparity_max(frame);
    let unit = if largest > 0.0 { 65535.0 / largest } else { 0.0 };
    let values: Vec<u16> = frame.disparity.iter().map(|disparity| (disparity * unit).round() as u16).collect();
    let colour = coloured(frame.disparity.view(), (1.0 / shot.far) as f32, (1.0 / shot.near) as f32);
    let scale = json!({
        "liveview": env!("CARGO_PKG_VERSION"), "disparity": "value / 65535 * disparity_max", "disparity_max": largest, "unit": "1/scene unit",
    });
    let grey = encode_gray16_png(shot.target.width(), shot.target.height(), &values)?;
    Ok([grey, encode("disparity.png".as_ref(), &colour)?, format!("{scale:#}\n").into_bytes()])
}
