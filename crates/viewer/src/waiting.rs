//! Requests for pictures at full quality that wait for the depth of photos.

use std::collections::BTreeMap;

use serde_json::json;
use tokio::sync::oneshot;

use crate::renderer::ViewRenderer;
use crate::requests::{FileAnswer, FileError, FileRequest, RequestQueue, ViewRequest, Viewpoint};

/// Requests for files that wait, at most.
const MAX_FILES: usize = 4;

type WaitingFile = (Viewpoint, oneshot::Sender<FileAnswer>);

/// Requests that wait, of each client the last. One in motion is kept only for the depth that it
/// lacks.
#[derive(Default)]
pub(crate) struct Waiting {
    views: BTreeMap<u64, ViewRequest>,
    files: Vec<WaitingFile>,
}

impl Waiting {
    /// The client's request waits, in place of an earlier one; with `None` none does.
    pub(crate) fn set_view(&mut self, client: u64, request: Option<ViewRequest>) {
        self.views.remove(&client);
        self.views.extend(request.map(|request| (client, request)));
    }

    /// The request for a picture's file waits, or is refused if too many do.
    pub(crate) fn add_file(&mut self, viewpoint: Viewpoint, reply: oneshot::Sender<FileAnswer>) {
        if self.files.len() < MAX_FILES {
            self.files.push((viewpoint, reply));
        } else {
            // Sending fails if the client has left.
            let _ = reply.send(Err(FileError::TooMany));
        }
    }

    /// Starts a search for depth that a request waits for, unless one is running.
    pub(crate) fn start_search(&mut self, queue: &RequestQueue, renderer: &mut ViewRenderer) {
        if renderer.source.is_searching() {
            return;
        }
        self.forget_those_that_left(queue);
        let views = self.views.values().map(|request| (&request.viewpoint, request.moving));
        let files = self.files.iter().map(|(viewpoint, _)| (viewpoint, false));
        let mut requests: Vec<_> = views.chain(files).collect();
        // Those in motion last: they need other depth soon.
        requests.sort_by_key(|&(_, moving)| moving);
        let awaited = requests.into_iter().filter_map(|(viewpoint, moving)| renderer.awaited(viewpoint, moving));
        let views: Vec<usize> = awaited.flat_map(|awaited| awaited.views).collect();
        if renderer.source.start_search(&views) {
            self.update(queue, renderer);
        }
    }

    /// Returns requests that need not wait any more to the queue, and tells the other clients how
    /// far the search is.
    pub(crate) fn update(&mut self, queue: &RequestQueue, renderer: &mut ViewRenderer) {
        self.forget_those_that_left(queue);
        for (client, request) in std::mem::take(&mut self.views) {
            match renderer.awaited(&request.viewpoint, request.moving) {
                // The client's next request in motion comes by itself.
                None if request.moving => {}
                None => queue.restore_view(client, request),
                Some(awaited) => {
                    if !request.moving {
                        queue.send_progress(client, json!({ "search": awaited.to_json() }).to_string());
                    }
                    self.views.insert(client, request);
                }
            }
        }
        for (viewpoint, reply) in std::mem::take(&mut self.files) {
            match renderer.awaited(&viewpoint, false) {
                None => queue.restore_file(FileRequest::Picture(viewpoint), reply),
                Some(_) => self.files.push((viewpoint, reply)),
            }
        }
    }

    fn forget_those_that_left(&mut self, queue: &RequestQueue) {
        self.views.retain(|&client, _| queue.has_client(client));
        self.files.retain(|(_, reply)| !reply.is_closed());
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;

    use super::*;
    use crate::renderer::FakeSource;
    use crate::requests::Task;

    struct Fixture {
        queue: RequestQueue,
        renderer: ViewRenderer,
        waiting: Waiting,
        running: Rc<RefCell<Option<usize>>>,
    }

    impl Fixture {
        fn new(source: FakeSource) -> Self {
            let running = Rc::clone(&source.running);
            let renderer = ViewRenderer::new(Box::new(source), Vec::new(), Viewpoint::sample(0).camera);
            Self { queue: RequestQueue::default(), renderer, waiting: Waiting::default(), running }
        }

        fn wait(&mut self, client: u64, step: usize, moving: bool) {
            let request = ViewRequest { id: 0, viewpoint: Viewpoint::sample(step), moving, depth: false };
            self.waiting.set_view(client, Some(request));
        }

        /// Runs all searches: their views, in order.
        fn search_all(&mut self) -> Vec<usize> {
            let mut searched = Vec::new();
            loop {
                self.waiting.start_search(&self.queue, &mut self.renderer);
                let Some(view) = *self.running.borrow() else { return searched };
                searched.push(view);
                self.renderer.source.insert(view, None);
                self.waiting.update(&self.queue, &mut self.renderer);
            }
        }

        /// The clients whose requests are in the queue; 0 for a file.
        fn restored(&self) -> Vec<u64> {
            let client = || match self.queue.next(true) {
                Task::Frame { client, .. } => Some(client),
                Task::File { .. } => Some(0),
                _ => None,
            };
            std::iter::from_fn(client).collect()
        }
    }

    #[test]
    fn depth_that_any_request_waits_for_is_searched() {
        let mut fixture = Fixture::new(FakeSource::default());
        let clients = [0; 3].map(|_| fixture.queue.join().unwrap());
        let [moving, first, second] = clients.each_ref().map(|client| client.0);
        let (reply, _answer) = oneshot::channel();
        fixture.waiting.add_file(Viewpoint::sample(0), reply);
        fixture.wait(moving, 3, true);
        fixture.wait(first, 1, false);
        fixture.wait(second, 2, false);
        assert_eq!(fixture.search_all(), [2, 3, 4, 5, 0, 1, 6, 7]);
        assert_eq!(fixture.restored(), [0, first, second]);
    }

    #[test]
    fn request_whose_depth_cannot_be_searched_is_rendered() {
        let mut fixture = Fixture::new(FakeSource { unsearchable: Some(1), ended: vec![0], ..FakeSource::default() });
        let (client, _messages) = fixture.queue.join().unwrap();
        fixture.wait(client, 0, false);
        assert!(fixture.search_all().is_empty());
        assert_eq!(fixture.restored(), [client]);
    }

    #[test]
    fn nothing_is_searched_for_clients_that_left() {
        let mut fixture = Fixture::new(FakeSource::default());
        let (client, _messages) = fixture.queue.join().unwrap();
        fixture.wait(client, 0, false);
        fixture.waiting.add_file(Viewpoint::sample(1), oneshot::channel().0);
        fixture.queue.leave(client);
        assert!(fixture.search_all().is_empty());
        assert!(fixture.waiting.views.is_empty() && fixture.waiting.files.is_empty());
    }

    #[test]
    fn files_that_wait_are_limited() {
        let mut waiting = Waiting::default();
        let mut answers = [0; MAX_FILES + 1].map(|_| {
            let (reply, answer) = oneshot::channel();
            waiting.add_file(Viewpoint::sample(0), reply);
            answer
        });
        assert_eq!(answers[MAX_FILES].try_recv(), Ok(Err(FileError::TooMany)));
        assert!(answers[0].try_recv().is_err());
    }
}
