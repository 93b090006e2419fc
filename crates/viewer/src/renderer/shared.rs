//! Networks that several live sessions share.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use liveview::ndarray::{ArrayView4, ArrayViewMut4};
use liveview::network::{Alpha, NetworkError, PlaneNetwork};
use liveview::render::Renderer;

/// A network that several renderers use, one at a time.
#[derive(Clone)]
struct Shared(Arc<Mutex<Box<dyn PlaneNetwork>>>);

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Box<dyn PlaneNetwork>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl PlaneNetwork for Shared {
    fn views(&self) -> usize {
        self.lock().views()
    }

    fn name(&self) -> String {
        self.lock().name()
    }

    fn infer(&mut self, hwv: ArrayView4<'_, f32>, logits: ArrayViewMut4<'_, f32>) -> Result<(), NetworkError> {
        self.lock().infer(hwv, logits)
    }
}

/// A network for each number of views, with its compositing.
pub(super) struct Networks {
    networks: Vec<(Shared, Alpha)>,
    batch: usize,
}

impl Networks {
    pub(super) fn new(renderers: Vec<Renderer>, batch: usize) -> Self {
        let share = |renderer: Renderer| {
            let alpha = renderer.alpha();
            (Shared(Arc::new(Mutex::new(renderer.into_network()))), alpha)
        };
        Self { networks: renderers.into_iter().map(share).collect(), batch }
    }

    /// The smallest and the largest number of views that one of them takes.
    pub(super) fn views(&self) -> (usize, usize) {
        let views = || self.networks.iter().map(|(network, _)| network.views());
        (views().min().unwrap_or(0), views().max().unwrap_or(0))
    }

    /// Renderers for a session.
    pub(super) fn renderers(&self) -> Vec<Renderer> {
        let renderer = |(network, alpha): &(Shared, Alpha)| {
            let mut renderer = Renderer::new(Box::new(network.clone()), self.batch);
            renderer.set_alpha(*alpha);
            renderer
        };
        self.networks.iter().map(renderer).collect()
    }
}
