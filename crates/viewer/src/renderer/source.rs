//! What pictures are rendered from: the photos of a scene, or the video of a rig.

use std::time::Duration;

use anyhow::Result;
use liveview::{Camera, Frame, ImageRgb};
use liveview_synthesizer::{FoundDepth, LayerSpec, Scene};
use serde_json::{Value, json};

use crate::request::Viewpoint;

/// Target time for one picture while the viewpoint or the time changes.
pub(super) const MOTION_BUDGET: Duration = Duration::from_millis(50);

/// A source of pictures. It renders at full quality at rest, and in motion as fast as it can.
pub(crate) trait Source {
    /// The photos with their cameras.
    fn scene(&self) -> &Scene;
    /// Scale of the target's sides, at most 1, for the next picture in motion; `pixels`: those of the full size.
    fn motion_scale(&self, pixels: usize) -> f64;
    /// A picture in motion.
    fn render_in_motion(&mut self, viewpoint: &Viewpoint) -> Result<Rendered>;
    /// Records the time that a picture in motion took, encoding included.
    fn record_motion_time(&mut self, rendered: &Rendered, took: Duration);
    /// A picture at full quality.
    fn render_at_rest(&mut self, viewpoint: &Viewpoint) -> Result<Rendered>;
    /// The photo of a camera at a time step.
    fn photo(&mut self, view: usize, step: usize) -> Result<ImageRgb>;
    /// The depth that a picture waits for; `None` if it waits for none.
    fn awaited(&mut self, _: &Viewpoint, _moving: bool) -> Option<AwaitedDepth> {
        None
    }
    /// A picture that does not need depth, in place of one that waits for it.
    fn render_draft(&mut self, viewpoint: &Viewpoint) -> Result<Rendered> {
        self.render_in_motion(viewpoint)
    }
    /// Whether a search for depth is running.
    fn is_searching(&self) -> bool {
        false
    }
    /// Starts the search for the depth of the first of the views' photos that can be searched,
    /// unless one is running. Returns whether any cannot be: no picture waits for these any more.
    fn start_search(&mut self, _views: &[usize]) -> bool {
        false
    }
    /// Takes what a search for the depth of a view's photo found; `None` if it failed.
    fn insert(&mut self, _view: usize, _found: Option<Box<FoundDepth>>) {}
    /// Number of calls of [`Self::prepare`] that still have something to do.
    fn unprepared(&self) -> usize;
    /// Number of these that the first picture needs.
    fn needed_first(&self) -> usize;
    /// Does a part of the work that pictures near a camera will need.
    fn prepare(&mut self, near: &Camera) -> Result<()>;
}

/// The depth that a picture waits for.
#[derive(Debug, Clone)]
pub(crate) struct AwaitedDepth {
    /// Views whose photos' depth is to be searched.
    pub(crate) views: Vec<usize>,
    /// Photos whose depth the picture needs.
    pub(crate) count: usize,
}

impl AwaitedDepth {
    /// How far the search is.
    pub(crate) fn to_json(&self) -> Value {
        json!({ "done": self.count - self.views.len(), "count": self.count })
    }
}

/// A picture, and what its header reports.
pub(crate) struct Rendered {
    pub(super) frame: Frame,
    /// Nearest and farthest depth, scene units.
    pub(super) range: (f64, f64),
    pub(super) layers: LayerSpec,
    /// Indices of the views that it was rendered from.
    pub(super) views: Vec<usize>,
    /// Indices of further views that its surface was found with.
    pub(super) helpers: Vec<usize>,
    /// Time to read photos, to search depth, and to select planes.
    pub(super) planning: [Duration; 3],
    /// Share of the pixels on which the photos agree, where it is known.
    pub(super) agreeing_share: Option<f64>,
    /// Cameras without a photo at the time step, and why.
    pub(super) left_out: Vec<String>,
}

/// A source for tests, whose depth is found when the test says so.
#[cfg(test)]
pub(crate) mod fake {
    use std::cell::RefCell;
    use std::rc::Rc;

    use super::*;

    /// A picture of time step s needs the depth of views 2s and 2s + 1. It renders nothing.
    #[derive(Default)]
    pub(crate) struct FakeSource {
        /// The view that is being searched.
        pub(crate) running: Rc<RefCell<Option<usize>>>,
        /// A view whose search cannot be started.
        pub(crate) unsearchable: Option<usize>,
        /// Views whose search has ended.
        pub(crate) ended: Vec<usize>,
    }

    impl Source for FakeSource {
        fn awaited(&mut self, viewpoint: &Viewpoint, _: bool) -> Option<AwaitedDepth> {
            let mut views = vec![2 * viewpoint.step, 2 * viewpoint.step + 1];
            views.retain(|view| !self.ended.contains(view));
            (!views.is_empty()).then_some(AwaitedDepth { views, count: 2 })
        }

        fn is_searching(&self) -> bool {
            self.running.borrow().is_some()
        }

        fn start_search(&mut self, views: &[usize]) -> bool {
            let failed = self.unsearchable.take_if(|view| views.contains(view));
            self.ended.extend(failed);
            *self.running.borrow_mut() = views.iter().copied().find(|view| !self.ended.contains(view));
            failed.is_some()
        }

        fn insert(&mut self, view: usize, _: Option<Box<FoundDepth>>) {
            *self.running.borrow_mut() = None;
            self.ended.push(view);
        }

        fn scene(&self) -> &Scene {
            unimplemented!()
        }

        fn motion_scale(&self, _: usize) -> f64 {
            unimplemented!()
        }

        fn render_in_motion(&mut self, _: &Viewpoint) -> Result<Rendered> {
            unimplemented!()
        }

        fn record_motion_time(&mut self, _: &Rendered, _: Duration) {
            unimplemented!()
        }

        fn render_at_rest(&mut self, _: &Viewpoint) -> Result<Rendered> {
            unimplemented!()
        }

        fn photo(&mut self, _: usize, _: usize) -> Result<ImageRgb> {
            unimplemented!()
        }

        fn unprepared(&self) -> usize {
            unimplemented!()
        }

        fn needed_first(&self) -> usize {
            unimplemented!()
        }

        fn prepare(&mut self, _: &Camera) -> Result<()> {
            unimplemented!()
        }
    }
}
