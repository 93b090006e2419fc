//! DeepView's Spaces data set: `models.json`, a list of rig positions, each a list of cameras.
//!
//! Conventions are those of the data set's `code/utils.py`: OpenCV axes, metres, pixel centres at
//! half-integers. `orientation` is the rotation axis times the angle (radians) of `cam_from_world`
//! (that code builds world from camera with the *negated* angle), `position` is the camera's
//! centre; fx = `focal_length`, fy = `focal_length` · `pixel_aspect_ratio`, (cx, cy) =
//! `principal_point`.
//!
//! Heights differ between cameras, and in some scenes the declared size (2048 wide) differs from
//! that of the photos (800 wide), so K is always scaled by actual over declared size.

use std::path::Path;

use glam::{DMat3, DVec3};
use serde_json::Value;

use crate::photos::PhotoLookup;
use crate::scene_file::{Fields, parse, read_json};
use crate::{DeclaredView, DeclaredViews, PhotoSource, SceneError, SceneOptions};
use liveview::geometry::{Intrinsics, Size};

pub(super) fn open(root: &Path, photos: &dyn PhotoSource, options: &SceneOptions) -> Result<DeclaredViews, SceneError> {
    let path = root.join("models.json");
    views(&read_json(&path)?, options.rig_position, PhotoLookup::new(photos, &path))
}

pub(super) fn views(bytes: &[u8], position: usize, mut lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
    let path = lookup.listed_in;
    let file = parse(path, bytes)?;
    let rigs = file
        .as_array()
        .ok_or_else(|| SceneError::malformed(path, "the file is not a list", "a list of rig positions"))?;
    let cameras = rigs.get(position).and_then(Value::as_array).ok_or_else(|| {
        let what = match rigs.get(position) {
            Some(_) => format!("rig position {position} is not a list"),
            None => format!("rig position {position} does not exist, the file has {}", rigs.len()),
        };
        SceneError::malformed(path, what, "a list of cameras at that position (the first is 0)")
    })?;
    for (index, camera) in cameras.iter().enumerate() {
        let place = format!("[{position}][{index}]");
        add_view(Fields::new(path, &place, camera, None)?, &mut lookup)?;
    }
    let mut found = lookup.finish()?;
    if rigs.len() > 1 {
        found.notes.push(format!("the file has {} rig positions, only number {position} is read", rigs.len()));
    }
    Ok(found)
}

/// Adds a camera's view, unless its entry is skipped.
fn add_view(camera: Fields<'_>, lookup: &mut PhotoLookup<'_>) -> Result<(), SceneError> {
    // The photo comes first: a skipped entry is not checked any further.
    let Some(photo) = camera.text("relative_path").and_then(|name| lookup.find(name)).transpose() else {
        return Ok(());
    };
    let (Some(width), Some(height)) = (camera.side("width")?, camera.side("height")?) else {
        return Err(camera.wrong("width", "width and height in pixels"));
    };
    let fx = camera.number("focal_length")?;
    let [cx, cy] = camera.numbers("principal_point")?;
    let rotation = rotation(DVec3::from_array(camera.numbers("orientation")?));
    let intrinsics = Intrinsics { fx, fy: fx * camera.number("pixel_aspect_ratio")?, cx, cy, skew: 0.0 };
    let translation = -(rotation * DVec3::from_array(camera.numbers("position")?));
    lookup.views.push(DeclaredView::new(photo?, (intrinsics, Size::new(width, height)), (rotation, translation)));
    Ok(())
}

/// `cam_from_world` from an axis times its angle.
fn rotation(angle_axis: DVec3) -> DMat3 {
    let angle = angle_axis.length();
    // The threshold of the data set's code.
    if angle < 1e-7 { DMat3::IDENTITY } else { DMat3::from_axis_angle(angle_axis / angle, angle) }
}
