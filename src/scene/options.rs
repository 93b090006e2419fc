//! How to open a scene.

/// How to open a scene.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct SceneOptions {
    /// Photos wider than this many pixels are scaled down on load, their intrinsics with them.
    pub width: Option<usize>,
    /// Folder of the photos inside an LLFF, RealEstate10K or COLMAP scene, instead of the usual search (`images_8`, `images_4`, …).
    pub images: Option<String>,
    /// Which rig position of a Spaces scene, counted from 0.
    pub rig_position: usize,
}
