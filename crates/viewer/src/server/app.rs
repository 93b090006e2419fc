//! The state that all connections of the server share.

use std::sync::Arc;

use liveview_synthesizer::Scene;
use tokio::sync::{Semaphore, watch};

use super::guard::Guard;
use super::message::Limits;
use crate::request_queue::RequestQueue;

/// The state that all connections share.
pub(crate) struct App {
    pub(crate) queue: Arc<RequestQueue>,
    pub(crate) scene: Scene,
    /// Time steps of a rig; `None` for a scene of photos.
    pub(crate) steps: Option<usize>,
    /// The first message to each client, JSON.
    pub(crate) session_info: String,
    pub(crate) guard: Guard,
    /// Held while a photo is read: one at a time.
    pub(crate) reading: Semaphore,
    pub(crate) stopping: watch::Sender<bool>,
}

impl App {
    /// `steps`: the time steps of a rig.
    pub(crate) fn new(
        queue: Arc<RequestQueue>,
        scene: Scene,
        steps: Option<usize>,
        session_info: String,
        guard: Guard,
    ) -> Self {
        let (reading, stopping) = (Semaphore::new(1), watch::Sender::new(false));
        Self { queue, scene, steps, session_info, guard, reading, stopping }
    }

    /// What clients may request.
    pub(crate) fn limits(&self) -> Limits<'_> {
        Limits { views: self.scene.views.iter().map(|view| &view.camera).collect(), steps: self.steps.unwrap_or(1) }
    }
}
