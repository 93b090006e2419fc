//! A source for tests, whose depth is found when the test says so.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use anyhow::Result;
use liveview::{Camera, FoundDepth, ImageRgb, Scene};

use super::source::{AwaitedDepth, Rendered, Source};
use crate::request::Viewpoint;

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
