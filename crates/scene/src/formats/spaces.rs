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

use glam::DVec3;
use serde_json::Value;

use crate::photos::PhotoLookup;
use crate::scene_file::{Fields, parse};
use crate::view::rotation_about;
use crate::{DeclaredView, DeclaredViews, SceneError, SceneOptions};
use liveview::geometry::Intrinsics;

pub(super) fn views(
    bytes: &[u8],
    options: &SceneOptions,
    mut lookup: PhotoLookup<'_>,
) -> Result<DeclaredViews, SceneError> {
    let (path, position) = (lookup.listed_in, options.rig_position);
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
        let camera = Fields::new(path, &place, camera, None)?;
        // The photo comes first: a skipped entry is not checked any further.
        let Some(photo) = lookup.find(camera.text("relative_path")?)? else { continue };
        let fx = camera.number("focal_length")?;
        let [cx, cy] = camera.numbers("principal_point")?;
        let rotation = rotation_about(DVec3::from_array(camera.numbers("orientation")?));
        let intrinsics = Intrinsics { fx, fy: fx * camera.number("pixel_aspect_ratio")?, cx, cy, skew: 0.0 };
        let translation = -(rotation * DVec3::from_array(camera.numbers("position")?));
        lookup.views.push(DeclaredView::new(photo, (intrinsics, camera.size()?), (rotation, translation)));
    }
    let mut found = lookup.finish()?;
    if rigs.len() > 1 {
        found.notes.push(format!("the file has {} rig positions, only number {position} is read", rigs.len()));
    }
    Ok(found)
}
