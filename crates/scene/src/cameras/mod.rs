//! Cameras from JSON files, and camera paths among the views of a scene.

mod camera_file;
mod camera_json;
mod camera_path;
mod interpolated_path;
mod nerfstudio;

pub use camera_file::{CameraFile, camera_from_json, read_cameras};
pub use camera_json::CameraFileError;
pub(crate) use camera_json::{json_numbers, split_json_matrix};
pub use camera_path::{CameraPath, CameraPathError, MeanPose};
pub use interpolated_path::interpolated_path;
