//! The views as the warp takes them.

use super::texture::Texture;
use crate::geometry::{Camera, PlaneSweep};

/// A view: its camera and its photo.
#[derive(Debug, Clone, Copy)]
pub struct SourceView<'a> {
    /// Its camera, for an image of the texture's size.
    pub camera: &'a Camera,
    /// Its photo.
    pub texture: &'a Texture,
}

/// A view with its plane sweep for one target.
#[derive(Debug, Clone, Copy)]
pub struct WarpSource<'a> {
    /// Its photo.
    pub texture: &'a Texture,
    /// Its sweep over the target's disparities.
    pub sweep: PlaneSweep,
}

/// The views' textures, with their plane sweeps for `target`.
pub fn warp_sources<'a>(views: &[SourceView<'a>], target: &Camera) -> Vec<WarpSource<'a>> {
    views.iter().map(|v| WarpSource { texture: v.texture, sweep: PlaneSweep::new(v.camera, target) }).collect()
}
