//! The formats of scenes, by name.

use std::fmt;

/// The format a scene was read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
}

impl Format {
    /// In the order in which they are looked for.
    pub(super) const ALL: [Self; 5] = [Self::Transforms, Self::Llff, Self::Spaces, Self::RealEstate10k, Self::Colmap];
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Transforms => "transforms.json (nerfstudio, instant-ngp)",
            Self::Llff => "LLFF poses_bounds.npy",
            Self::Spaces => "Spaces models.json",
            Self::RealEstate10k => "RealEstate10K",
            Self::Colmap => "COLMAP",
        })
    }
}
