//! Width and height.

use std::fmt;

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
