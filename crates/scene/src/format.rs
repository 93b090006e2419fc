//! The scene formats and their conventions.

use std::fmt;

/// The format a scene was read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// nerfstudio / instant-ngp `transforms.json`.
    Transforms,
    /// LLFF `poses_bounds.npy`.
    Llff,
    /// DeepView Spaces `models.json`.
    Spaces,
    /// RealEstate10K `cameras.txt` with `frames/`.
    RealEstate10k,
    /// COLMAP sparse model, binary or text.
    Colmap,
    /// No files: photos and cameras in memory.
    Memory,
}

impl Format {
    /// Its conventions for poses and intrinsics, as text for the user.
    pub fn conventions(self) -> &'static str {
        match self {
            Self::Transforms => "world from camera with OpenGL axes (x right, y up, z backwards); K in pixels of w x h",
            Self::Llff => "world from camera with columns [down, right, backwards]; K in pixels of the declared size",
            Self::Spaces => "axis-angle rotation and camera centre, OpenCV axes; K in pixels of the declared size",
            Self::RealEstate10k => "camera from world, OpenCV axes; K as fractions of width and height",
            Self::Colmap | Self::Memory => "camera from world, OpenCV axes (x right, y down, z forward); K in pixels",
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Transforms => "transforms.json (nerfstudio, instant-ngp)",
            Self::Llff => "LLFF poses_bounds.npy",
            Self::Spaces => "Spaces models.json",
            Self::RealEstate10k => "RealEstate10K",
            Self::Colmap => "COLMAP",
            Self::Memory => "photos in memory",
        })
    }
}
