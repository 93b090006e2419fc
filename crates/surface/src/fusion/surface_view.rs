//! A photo with its confirmed depth, as the fusion takes it.

use super::confirmed_depth::ConfirmedDepth;
use liveview::warp::SourceView;

/// A photo with its confirmed depth.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceView<'a> {
    /// Camera and photo.
    pub view: SourceView<'a>,
    /// The photo's depth where other photos confirm it.
    pub confirmed: &'a ConfirmedDepth,
    /// Factor of each colour channel ([`crate::exposure_gains`]).
    pub gains: [f32; 3],
}
