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

use super::json::{Fields, parse};
use crate::geometry::{Intrinsics, Size};
use crate::scene::declared::{DeclaredSize, DeclaredView, DeclaredViews};
use crate::scene::error::SceneError;
use crate::scene::options::SceneOptions;
use crate::scene::photos::lookup::PhotoLookup;
use crate::scene::photos::source::PhotoSource;
use crate::scene::pose_file::read_json;
use crate::scene::undistort::Distortion;

pub(in crate::scene) fn open(
    root: &Path,
    photos: &dyn PhotoSource,
    options: &SceneOptions,
) -> Result<DeclaredViews, SceneError> {
    let path = root.join("models.json");
    views(&path, &read_json(&path)?, options.rig_position, photos)
}

pub(in crate::scene) fn views(
    path: &Path,
    bytes: &[u8],
    position: usize,
    photos: &dyn PhotoSource,
) -> Result<DeclaredViews, SceneError> {
    let file = parse(path, bytes)?;
    let rigs = file
        .as_array()
        .ok_or_else(|| SceneError::malformed(path, "the file is not a list", "a list of rig positions"))?;
    let cameras = rigs.get(position).and_then(Value::as_array).ok_or_else(|| {
        let what = match rigs.get(position) {
            Some(_) => format!("rig position {position} is not a list"),
            None => format!("rig position {position} does not exist, the file has {}", rigs.len()),
        };
        SceneError::malformed(path, what, "a list of cameras")
    })?;
    let mut lookup = PhotoLookup::new(photos, path);
    let mut views = Vec::with_capacity(cameras.len());
    for (index, camera) in cameras.iter().enumerate() {
        let place = format!("[{position}][{index}]");
        views.extend(view(Fields::new(path, &place, camera, None)?, &mut lookup)?);
    }
    let mut notes = lookup.into_notes(&views)?;
    if rigs.len() > 1 {
        notes.push(format!("the file has {} rig positions, only number {position} is read", rigs.len()));
    }
    Ok(DeclaredViews { cameras: path.to_owned(), views, notes })
}

/// A camera's view; `None` if its entry is skipped.
fn view(camera: Fields<'_>, lookup: &mut PhotoLookup<'_>) -> Result<Option<DeclaredView>, SceneError> {
    // The photo comes first: a skipped entry is not checked any further.
    let Some(photo) = camera.text("relative_path").and_then(|name| lookup.find(name)).transpose() else {
        return Ok(None);
    };
    let (Some(width), Some(height)) = (camera.side("width")?, camera.side("height")?) else {
        return Err(camera.wrong("width", "width and height in pixels"));
    };
    let fx = camera.number("focal_length")?;
    let [cx, cy] = camera.numbers("principal_point")?;
    let rotation = rotation(DVec3::from_array(camera.numbers("orientation")?));
    Ok(Some(DeclaredView {
        photo: photo?,
        intrinsics: Intrinsics { fx, fy: fx * camera.number("pixel_aspect_ratio")?, cx, cy, skew: 0.0 },
        size: DeclaredSize::Scaled(Size::new(width, height)),
        rotation,
        translation: -(rotation * DVec3::from_array(camera.numbers("position")?)),
        distortion: Distortion::default(),
        depth_range: None,
    }))
}

/// `cam_from_world` from an axis times its angle.
fn rotation(angle_axis: DVec3) -> DMat3 {
    let angle = angle_axis.length();
    // The threshold of the data set's code.
    if angle < 1e-7 { DMat3::IDENTITY } else { DMat3::from_axis_angle(angle_axis / angle, angle) }
}
