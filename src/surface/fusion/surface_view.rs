//! A photo with its confirmed depth, as the fusion takes it.

use super::confirmed_depth::ConfirmedDepth;
use crate::warp::SourceView;

/// A photo with what is known of its depth.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceView<'a> {
    /// Camera and photo.
    pub view: SourceView<'a>,
    /// What other photos confirm of its depth.
    pub known: &'a ConfirmedDepth,
    /// What its colours are multiplied by, per channel ([`super::exposure_gains`]).
    pub gains: [f32; 3],
}
