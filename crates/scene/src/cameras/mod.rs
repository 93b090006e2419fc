//! Cameras from JSON files, and camera paths among the views of a scene.

pub(crate) mod camera_file;
mod camera_path;

pub use camera_file::{CameraFile, camera_from_json, read_cameras};
pub use camera_path::{CameraPath, CameraPathError, MeanPose, interpolated_path};
