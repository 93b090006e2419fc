//! Searches the depth of photos beside the rendering, one photo at a time.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};

use anyhow::Result;
use liveview_synthesizer::{FoundDepth, SynthesisError};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::request_queue::RequestQueue;

/// A thread pool of its own, so that no picture waits for a part of a search; it yields the
/// processor to the rendering (Linux).
pub(super) struct DepthSearches {
    pool: Arc<ThreadPool>,
    queue: Arc<RequestQueue>,
    running: Option<JoinHandle<()>>,
    /// Views whose photos could not be searched.
    failed: Vec<usize>,
}

impl DepthSearches {
    /// What is found is put into the queue.
    pub(super) fn new(threads: usize, queue: Arc<RequestQueue>) -> Result<Self> {
        Ok(Self {
            pool: Arc::new(ThreadPoolBuilder::new().num_threads(threads).start_handler(|_| lower_priority()).build()?),
            queue,
            running: None,
            failed: Vec::new(),
        })
    }

    /// Whether a search is running, or what it found has not been taken yet.
    pub(super) fn is_running(&self) -> bool {
        self.running.is_some()
    }

    pub(super) fn has_failed(&self, view: usize) -> bool {
        self.failed.contains(&view)
    }

    /// Starts the search of the first of the views' photos that can be searched, unless one is
    /// running. `search`: that of a view; `None` if its depth is known. Returns whether any could
    /// not be started.
    pub(super) fn start_first<S>(
        &mut self,
        views: &[usize],
        mut search: impl FnMut(usize) -> Result<Option<S>, SynthesisError>,
    ) -> bool
    where
        S: FnOnce() -> Result<FoundDepth, SynthesisError> + Send + 'static,
    {
        let failed_before = self.failed.len();
        for &view in views {
            if self.is_running() {
                break;
            }
            if self.has_failed(view) {
                continue;
            }
            match search(view).map(|search| search.map(|search| self.start(view, search))) {
                Ok(None) => {}
                Ok(Some(Ok(thread))) => self.running = Some(thread),
                Ok(Some(Err(_))) | Err(_) => self.failed.push(view),
            }
        }
        self.failed.len() > failed_before
    }

    fn start(
        &self,
        view: usize,
        search: impl FnOnce() -> Result<FoundDepth, SynthesisError> + Send + 'static,
    ) -> io::Result<JoinHandle<()>> {
        let (pool, queue) = (Arc::clone(&self.pool), Arc::clone(&self.queue));
        let run = move || {
            // A search that panics has failed too: without an answer no other would start.
            let found = catch_unwind(AssertUnwindSafe(|| pool.install(search)));
            queue.found(view, found.ok().and_then(Result::ok));
        };
        Builder::new().name("depth".to_owned()).spawn(run)
    }

    /// The search of a view's photo has ended.
    pub(super) fn end(&mut self, view: usize, found: bool) {
        self.running = None;
        if !found {
            self.failed.push(view);
        }
    }
}

/// Gives this thread a tenth of the share of the processor that others have.
fn lower_priority() {
    // Linux has priorities by thread; elsewhere this would be the whole program's. Where it fails,
    // only the rendering beside a search is slower.
    #[cfg(target_os = "linux")]
    let _ = rustix::process::setpriority_process(None, 10);
}

impl Drop for DepthSearches {
    /// Waits for the search that is running, a second or so: it may be writing a file.
    fn drop(&mut self) {
        if let Some(thread) = self.running.take() {
            // Panics are caught in the thread.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::request::Task;

    #[test]
    fn search_starts_for_the_first_view_that_can_be_searched() {
        let queue = Arc::new(RequestQueue::default());
        let mut searches = DepthSearches::new(1, Arc::clone(&queue)).unwrap();
        let mut asked = Vec::new();
        let search = |view| {
            asked.push(view);
            match view {
                1 => Err(SynthesisError::Cancelled),
                2 => Ok(None),
                _ => Ok(Some(|| Err(SynthesisError::Cancelled))),
            }
        };
        assert!(searches.start_first(&[1, 2, 1, 3, 4], search));
        assert_eq!(asked, [1, 2, 3]);
        assert!(searches.is_running() && searches.has_failed(1) && !searches.has_failed(3));
        assert!(matches!(queue.next(false), Task::Found { view: 3, found: None }));
        searches.end(3, false);
        assert!(!searches.is_running() && searches.has_failed(3));
    }

    #[test]
    fn search_that_panics_has_failed() {
        let queue = Arc::new(RequestQueue::default());
        let mut searches = DepthSearches::new(1, Arc::clone(&queue)).unwrap();
        assert!(!searches.start_first(&[5], |_| Ok(Some(|| panic!("a panic of the test")))));
        assert!(matches!(queue.next(false), Task::Found { view: 5, found: None }));
    }

    #[test]
    fn search_that_is_running_is_waited_for() {
        let queue = Arc::new(RequestQueue::default());
        let mut searches = DepthSearches::new(1, Arc::clone(&queue)).unwrap();
        let (started, wait) = std::sync::mpsc::channel();
        let search = move || {
            started.send(()).unwrap();
            std::thread::sleep(std::time::Duration::from_millis(200));
            Err(SynthesisError::Cancelled)
        };
        let mut search = Some(search);
        searches.start_first(&[0], |_| Ok(search.take()));
        wait.recv().unwrap();
        drop(searches);
        assert!(matches!(queue.next(true), Task::Found { view: 0, found: None }));
    }
}
