//! Cameras, and the positions of the pixels of one in another.

mod camera;
mod camera_error;
mod camera_file;
mod camera_json;
mod camera_path;
mod interpolated_path;
mod matrix;
mod nerfstudio;
pub mod parallax;
mod plane_sweep;
mod size;
mod view_selection;

pub use camera::{Camera, Intrinsics};
pub use camera_error::CameraError;
pub use camera_file::{CameraFile, camera_from_json, read_cameras};
pub use camera_json::CameraFileError;
pub use camera_path::{CameraPath, CameraPathError, MeanPose};
pub use interpolated_path::interpolated_path;
pub(crate) use matrix::{cam_from_opengl_world, json_numbers, split_json_matrix};
pub use plane_sweep::{PlaneSweep, RelativePose, source_from_target};
pub use size::{MAX_SIDE, Size};
#[cfg(feature = "surface")]
pub(crate) use view_selection::facing_alike;
pub use view_selection::{TooFewViews, choose_views, distance, middle_camera};
