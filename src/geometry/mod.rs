//! Cameras, and the positions of the pixels of one in another.

mod camera;
mod matrix;
mod plane_sweep;
mod view_selection;

use std::fmt;

pub use camera::{Camera, CameraError, Intrinsics};
pub use matrix::{cam_from_opengl_world, rotation_and_translation};
pub use plane_sweep::{PlaneSweep, RelativePose, source_from_target};
pub use view_selection::{TooFewViews, choose_views, distance, facing_alike, middle_camera, nearest_camera};

/// Largest side of an image or a camera, in pixels.
pub const MAX_SIDE: usize = 16_384;

/// Width and height in pixels (in cells where documented).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Size {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Size {
    /// Of that width and height.
    pub const fn new(width: usize, height: usize) -> Self {
        Self { width, height }
    }

    /// Width times height.
    pub const fn pixels(self) -> usize {
        self.width * self.height
    }
}

/// `504x352`
impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}
