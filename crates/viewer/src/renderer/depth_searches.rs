//! Searches the depth of photos beside the rendering, one photo at a time.

use std::sync::Arc;

use anyhow::Result;
use liveview::DepthSearch;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::request_queue::RequestQueue;

/// A thread pool of its own, so that no picture waits for a part of a search.
pub(super) struct DepthSearches {
    pool: Arc<ThreadPool>,
    queue: Arc<RequestQueue>,
    /// The view whose photo is being searched.
    pub(super) running: Option<usize>,
}

impl DepthSearches {
    /// What is found is put into the queue.
    pub(super) fn new(threads: usize, queue: Arc<RequestQueue>) -> Result<Self> {
        Ok(Self { pool: Arc::new(ThreadPoolBuilder::new().num_threads(threads).build()?), queue, running: None })
    }

    /// Starts the search for the depth of a view's photo; none is running.
    pub(super) fn start(&mut self, view: usize, search: DepthSearch) -> Result<()> {
        let (pool, queue) = (Arc::clone(&self.pool), Arc::clone(&self.queue));
        let run = move || queue.found(view, pool.install(|| search.run()));
        std::thread::Builder::new().name("depth".to_owned()).spawn(run)?;
        self.running = Some(view);
        Ok(())
    }
}
