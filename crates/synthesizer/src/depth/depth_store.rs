//! The depth of photos in memory, and the folder that keeps it.

use std::ops::ControlFlow;

use super::scene_depth::{DepthProgress, SceneDepth};
use crate::error::SynthesisError;
use crate::scene_views::SceneViews;
use liveview_surface::cache::{DepthCache, PhotoDigest};

/// The depth of photos in memory, and the folder that keeps it from run to run, if there is one.
#[derive(Default)]
pub(crate) struct DepthStore {
    /// For the views held out by the last shot.
    pub(super) depth: Option<SceneDepth>,
    pub(super) files: Option<DepthFiles>,
    pub(super) progress: Option<OnSearch>,
}

/// Called before each search; returning `Break` ends it.
pub(super) type OnSearch = Box<dyn FnMut(DepthProgress<'_>) -> ControlFlow<()> + Send>;

/// A folder of depths, with the digests of photos and what went wrong with its files.
pub(super) struct DepthFiles {
    pub(super) folder: DepthCache,
    /// Of each view's photo, once it has been loaded.
    pub(super) digests: Vec<Option<PhotoDigest>>,
    pub(super) notes: Vec<String>,
}

impl DepthStore {
    /// Drops the depth of all views but these, and what confirms it unless it is needed `soon`.
    pub(crate) fn retain(&mut self, views: &[usize], soon: &[usize]) {
        if let Some(depth) = &mut self.depth {
            depth.retain(views, soon);
        }
    }

    /// Bytes of the depth of a view's photo; 0 if it is not in memory.
    pub(crate) fn bytes(&self, view: usize) -> usize {
        self.depth.as_ref().map_or(0, |depth| depth.bytes(view))
    }
}

/// The depths with these views held out: those in memory, or none yet.
pub(super) fn with_held_out<'a>(
    depth: &'a mut Option<SceneDepth>,
    views: &SceneViews,
    held_out: &[usize],
) -> Result<&'a mut SceneDepth, SynthesisError> {
    *depth = match depth.take().filter(|depth| depth.held_out == held_out) {
        None => Some(SceneDepth::new(views, held_out)?),
        known => known,
    };
    Ok(depth.as_mut().expect("set just now"))
}
