//! Options for opening a scene.

/// Options for opening a scene.
#[derive(Debug, Clone, Default)]
pub struct SceneOptions {
    /// Photos wider than this, in pixels, are scaled down to it on load, together with their
    /// intrinsics.
    pub width: Option<usize>,
    /// The photo folder inside an LLFF, RealEstate10K or COLMAP scene, or that in place of `images`
    /// in a `transforms.json`; by default the first that exists of the format's usual ones
    /// (`images_8`, `images_4`, …).
    pub images: Option<String>,
    /// The rig position to read from a Spaces scene, counted from 0.
    pub rig_position: usize,
}
