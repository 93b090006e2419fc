//! What all connections of the server share.

use std::sync::Arc;

use liveview::Scene;
use tokio::sync::{Semaphore, watch};

use crate::desk::Desk;
use crate::guard::Guard;
use crate::message::Range;

/// What all connections share.
pub(crate) struct App {
    pub(crate) desk: Arc<Desk>,
    pub(crate) scene: Scene,
    /// Time steps of a rig.
    pub(crate) steps: Option<usize>,
    /// The first message to each client.
    pub(crate) hello: String,
    pub(crate) guard: Guard,
    /// Photos that are read at a time.
    pub(crate) reading: Semaphore,
    pub(crate) stopping: watch::Sender<bool>,
}

impl App {
    /// `steps`: the time steps of a rig.
    pub(crate) fn new(desk: Arc<Desk>, scene: Scene, steps: Option<usize>, hello: String, guard: Guard) -> Self {
        Self { desk, scene, steps, hello, guard, reading: Semaphore::new(1), stopping: watch::Sender::new(false) }
    }

    /// What clients may ask for.
    pub(crate) fn range(&self) -> Range<'_> {
        Range { views: self.scene.views.iter().map(|view| &view.camera).collect(), steps: self.steps.unwrap_or(1) }
    }
}
