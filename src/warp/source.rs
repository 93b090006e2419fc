//! Views: the input of the warp.

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
    /// Factor of each colour channel of its samples.
    pub gains: [f32; 3],
}

impl<'a> WarpSource<'a> {
    /// A photo with unchanged colours.
    pub fn new(texture: &'a Texture, sweep: PlaneSweep) -> Self {
        Self { texture, sweep, gains: NO_GAINS }
    }
}

/// Gains that change nothing.
pub const NO_GAINS: [f32; 3] = [1.0; 3];

/// The views' textures, with their plane sweeps for `target`.
pub fn warp_sources<'a>(views: &[SourceView<'a>], target: &Camera) -> Vec<WarpSource<'a>> {
    views.iter().map(|v| WarpSource::new(v.texture, PlaneSweep::new(v.camera, target))).collect()
}
