//! Cameras from a JSON file.
//!
//! A camera is an object `{"transform_matrix": 4x4 world from camera, OpenGL axes}` or
//! `{"cam_from_world": 3x4 or 4x4, OpenCV axes}`, with `fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`
//! (pixels) where they differ from those of the nearest view, w and h together. The file contains
//! one such object or a list of them, or a camera path of nerfstudio's viewer.

use std::path::Path;

use liveview::geometry::{Camera, CameraError, Intrinsics, cam_from_opengl_world, nearest_camera};
use serde_json::Value;

use super::camera_json::{CameraFileError, read_json, side, split_matrix};
use super::nerfstudio::{self, TrainedFromScene};

/// The cameras of a file.
#[derive(Debug)]
pub struct CameraFile {
    /// In the order of the file.
    pub cameras: Vec<Camera>,
    /// For a path of nerfstudio's viewer: which axes its poses are assumed to have.
    pub note: Option<String>,
}

/// Reads all cameras of the file. Missing fields are those of the nearest of the `views`. Poses of
/// nerfstudio's viewer are converted from the axes of its training to those of the scene if its
/// `dataparser_transforms.json` is beside the file or in the scene's folder.
///
/// # Errors
///
/// [`CameraFileError`], naming the file, the camera and the field.
///
/// # Panics
///
/// If there are no views.
pub fn read_cameras(path: &Path, views: &[&Camera], scene: &Path) -> Result<CameraFile, CameraFileError> {
    let refused = |index, reason| CameraFileError { path: path.to_owned(), index, reason };
    let file = read_json(path)?;
    let path_frames = nerfstudio::frames(&file);
    let list = path_frames.or(file.as_array());
    let entries = list.map_or_else(|| std::slice::from_ref(&file), Vec::as_slice);
    if entries.is_empty() {
        return Err(refused(None, "the list of cameras is empty; expected at least one".to_owned()));
    }
    let axes = path_frames.map(|_| TrainedFromScene::find(path, scene)).transpose()?;
    let read = |entry| match &axes {
        None => camera_from_json(entry, views),
        Some(None) => nerfstudio::camera(&file, entry),
        Some(Some(axes)) => axes.camera(&nerfstudio::camera(&file, entry)?).map_err(|error| error.to_string()),
    };
    let index = |index: usize| list.is_some().then_some(index);
    let cameras =
        entries.iter().enumerate().map(|(at, entry)| read(entry).map_err(|reason| refused(index(at), reason)));
    let cameras = cameras.collect::<Result<_, _>>()?;
    let note = axes.map(|axes| match axes {
        Some(axes) => format!("converted from nerfstudio's axes to the scene's by {}", axes.file.display()),
        None => "assumed to be in the scene's own axes; if nerfstudio rotated, shifted or scaled the scene, put its \
                 dataparser_transforms.json (beside the model's config.yml) beside this file or in the scene's folder"
            .to_owned(),
    });
    let note = note.map(|note| format!("{}: {note}", path.display()));
    Ok(CameraFile { cameras, note })
}

/// Keys of a camera.
const KEYS: [&str; 8] = ["transform_matrix", "cam_from_world", "fl_x", "fl_y", "cx", "cy", "w", "h"];

/// One camera in the format of such a file. Missing fields are those of the nearest of the `views`.
///
/// # Errors
///
/// The field, and what was expected.
///
/// # Panics
///
/// If there are no views.
pub fn camera_from_json(entry: &Value, views: &[&Camera]) -> Result<Camera, String> {
    let mut keys = entry.as_object().into_iter().flat_map(|entry| entry.keys());
    if let Some(unknown) = keys.find(|key| !KEYS.contains(&key.as_str())) {
        return Err(format!("unknown key \"{unknown}\"; expected {}", KEYS.join(", ")));
    }
    if entry.get("w").is_some() != entry.get("h").is_some() {
        return Err("one of w and h is given; expected both or neither".to_owned());
    }
    let (rotation, translation) = match (entry.get("transform_matrix"), entry.get("cam_from_world")) {
        (Some(matrix), None) => {
            let (axes, centre) = split_matrix(matrix, "transform_matrix", 4)?;
            cam_from_opengl_world(axes, centre)
        }
        (None, Some(matrix)) => split_matrix(matrix, "cam_from_world", 3)?,
        _ => return Err("expected either \"transform_matrix\" or \"cam_from_world\"".to_owned()),
    };
    let centre = -(rotation.transpose() * translation);
    let text = |error: CameraError| error.to_string();
    let like = views[nearest_camera(views, centre)].with_pose(rotation, translation).map_err(text)?;
    let (width, height) = match entry.get("w") {
        Some(_) => (side(entry, "w")?, side(entry, "h")?),
        None => (like.width(), like.height()),
    };
    let sized = like.with_size_scaled(width, height).map_err(text)?;
    let Intrinsics { fx, fy, cx, cy, skew } = sized.intrinsics();
    let number = |key: &str, default: f64| match entry.get(key) {
        None => Ok(default),
        Some(value) => value.as_f64().ok_or_else(|| format!("{key} is {value}; expected a number, in pixels")),
    };
    let fx = number("fl_x", fx)?;
    // As in transforms.json, fl_x alone is used for both.
    let fy = number("fl_y", if entry.get("fl_x").is_some() { fx } else { fy })?;
    let intrinsics = Intrinsics { fx, fy, cx: number("cx", cx)?, cy: number("cy", cy)?, skew };
    Camera::new(intrinsics, sized.width(), sized.height(), rotation, translation).map_err(text)
}
