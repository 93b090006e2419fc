//! Requests for pictures at full quality that wait for the depth of photos.

use std::collections::BTreeMap;

use serde_json::json;
use tokio::sync::oneshot;

use crate::renderer::ViewRenderer;
use crate::request::{FileAnswer, FileRequest, ViewRequest, Viewpoint};
use crate::request_queue::RequestQueue;

/// Requests for files that wait, at most.
const MAX_FILES: usize = 4;

type WaitingFile = (Viewpoint, oneshot::Sender<FileAnswer>);

/// Requests that wait, of each client the last. One in motion is kept only for the depth that it lacks.
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
            let _ = reply.send(Err("too many pictures are requested at once".to_owned()));
        }
    }

    /// Starts a search for depth that a request waits for, unless one is running.
    pub(crate) fn start_search(&mut self, queue: &RequestQueue, renderer: &mut ViewRenderer) {
        if renderer.is_searching() {
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
        if renderer.start_search(&views) {
            self.update(queue, renderer);
        }
    }

    /// Returns requests that need not wait any more to the queue, and tells the other clients how far the search is.
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
