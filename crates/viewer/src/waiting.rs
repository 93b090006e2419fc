//! Requests for pictures at full quality that wait for the depth of photos.

use std::collections::BTreeMap;

use serde_json::json;
use tokio::sync::oneshot;

use crate::renderer::ViewRenderer;
use crate::request::{FileAnswer, FileRequest, Message, ViewRequest, Viewpoint};
use crate::request_queue::RequestQueue;

/// Requests for files that wait, at most.
const MAX_FILES: usize = 4;

type WaitingFile = (Viewpoint, oneshot::Sender<FileAnswer>);

/// Requests that wait, of each client the last.
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

    /// Returns requests whose depth is known now to the queue, and tells the other clients how far the search is.
    pub(crate) fn update(&mut self, queue: &RequestQueue, renderer: &mut ViewRenderer) {
        for (client, request) in std::mem::take(&mut self.views) {
            match renderer.awaited(&request.viewpoint, false) {
                None => queue.restore_view(client, request),
                Some(search) => {
                    queue.send(client, Message::Text(json!({ "search": search.to_json() }).to_string()));
                    self.views.insert(client, request);
                }
            }
        }
        self.files.retain(|(_, reply)| !reply.is_closed());
        for (viewpoint, reply) in std::mem::take(&mut self.files) {
            match renderer.awaited(&viewpoint, false) {
                None => queue.restore_file(FileRequest::Picture(viewpoint), reply),
                Some(_) => self.files.push((viewpoint, reply)),
            }
        }
    }
}
