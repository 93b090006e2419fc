//! What clients ask for, and what they are sent; the pending requests of all clients. Of each client only the newest request for a
//! picture is kept, and clients take turns.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use liveview::Camera;
use liveview_synthesizer::FoundDepth;
use tokio::sync::{mpsc, oneshot};

/// A camera, and a time step of a rig.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Viewpoint {
    pub(crate) camera: Camera,
    /// 0 for a scene of photos.
    pub(crate) step: usize,
}

/// A client's request for a picture.
#[derive(Debug, Clone)]
pub(crate) struct ViewRequest {
    /// The client's number of the request.
    pub(crate) id: u64,
    pub(crate) viewpoint: Viewpoint,
    /// Whether the viewpoint or the time is changing: speed then goes before quality.
    pub(crate) moving: bool,
    /// Disparity as colours instead of the picture.
    pub(crate) depth: bool,
}

/// A client's request for a file.
#[derive(Debug)]
pub(crate) enum FileRequest {
    /// A picture at full quality, as PNG.
    Picture(Viewpoint),
    /// A camera's photo at a time step, as JPEG.
    Photo { view: usize, step: usize },
}

/// The bytes of a file, or the reason why there are none.
pub(crate) type FileAnswer = Result<Arc<[u8]>, FileError>;

/// Why there is no file.
#[derive(Debug, PartialEq)]
pub(crate) enum FileError {
    /// Too many wait for depth.
    TooMany,
    /// The picture cannot be rendered, or the photo cannot be read.
    Failed(String),
}

/// The renderer's next task.
#[derive(Debug)]
pub(crate) enum Task {
    Frame {
        client: u64,
        request: ViewRequest,
    },
    File {
        request: FileRequest,
        reply: oneshot::Sender<FileAnswer>,
    },
    /// The depth of a view's photo; `None` if it could not be searched.
    Found {
        view: usize,
        found: Option<Box<FoundDepth>>,
    },
    /// No request is pending: time to load photos and search depth ahead.
    Prepare,
    Stop,
}

/// A message to a client.
#[derive(Debug, Clone)]
pub(crate) enum Message {
    /// A header in JSON, then a picture.
    Frame(Arc<[u8]>),
    /// JSON.
    Text(String),
}

#[cfg(test)]
impl Viewpoint {
    /// A viewpoint for tests.
    pub(crate) fn sample(step: usize) -> Self {
        use liveview::Intrinsics;
        use liveview::glam::{DMat3, DVec3};

        let k = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        Self { camera: Camera::new(k, 64, 48, DMat3::IDENTITY, DVec3::ZERO).unwrap(), step }
    }
}

/// Frames sent to a client that it has not shown yet, at most: a slow client gets fewer frames, not older ones.
const MAX_FRAMES_IN_FLIGHT: usize = 2;
/// Clients at a time.
const MAX_CLIENTS: usize = 16;
/// Pending requests for files.
const MAX_FILES: usize = 4;

struct Client {
    request: Option<ViewRequest>,
    in_flight: usize,
    outbox: mpsc::Sender<Message>,
}

#[derive(Default)]
struct State {
    clients: BTreeMap<u64, Client>,
    files: VecDeque<(FileRequest, oneshot::Sender<FileAnswer>)>,
    /// What a search found, and for which view.
    found: Option<(usize, Option<Box<FoundDepth>>)>,
    /// The client that was served last; files take turns with clients.
    last_client: u64,
    file_was_last: bool,
    joined: u64,
    stopped: bool,
}

/// Pending requests; shared by the renderer and the server.
#[derive(Default)]
pub(crate) struct RequestQueue {
    state: Mutex<State>,
    changed: Condvar,
}

impl RequestQueue {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a client: its number and the receiver of its messages; `None` if there are too many.
    pub(crate) fn join(&self) -> Option<(u64, mpsc::Receiver<Message>)> {
        let mut state = self.state();
        if state.clients.len() >= MAX_CLIENTS || state.stopped {
            return None;
        }
        // Room for the frames in flight and for as many texts.
        let (outbox, messages) = mpsc::channel(2 * MAX_FRAMES_IN_FLIGHT);
        state.joined += 1;
        let client = state.joined;
        state.clients.insert(client, Client { request: None, in_flight: 0, outbox });
        Some((client, messages))
    }

    /// Removes a client.
    pub(crate) fn leave(&self, client: u64) {
        self.state().clients.remove(&client);
    }

    /// Whether the client has not left.
    pub(crate) fn has_client(&self, client: u64) -> bool {
        self.state().clients.contains_key(&client)
    }

    /// Clients that have joined so far.
    pub(crate) fn joined(&self) -> u64 {
        self.state().joined
    }

    /// Replaces the client's pending request, if there is one.
    pub(crate) fn request_view(&self, client: u64, request: ViewRequest) {
        if let Some(client) = self.state().clients.get_mut(&client) {
            client.request = Some(request);
        }
        self.changed.notify_one();
    }

    /// Puts a request back that had to wait, unless the client has sent a newer one or has left.
    pub(crate) fn restore_view(&self, client: u64, request: ViewRequest) {
        if let Some(client) = self.state().clients.get_mut(&client) {
            client.request.get_or_insert(request);
        }
        self.changed.notify_one();
    }

    /// Puts a request for a file back that had to wait.
    pub(crate) fn restore_file(&self, request: FileRequest, reply: oneshot::Sender<FileAnswer>) {
        self.state().files.push_front((request, reply));
        self.changed.notify_one();
    }

    /// Hands over what a search for the depth of a view's photo found.
    pub(crate) fn found(&self, view: usize, found: Option<FoundDepth>) {
        self.state().found = Some((view, found.map(Box::new)));
        self.changed.notify_one();
    }

    /// The client has shown a frame that it was sent.
    pub(crate) fn frame_shown(&self, client: u64) {
        if let Some(client) = self.state().clients.get_mut(&client) {
            client.in_flight = client.in_flight.saturating_sub(1);
        }
        self.changed.notify_one();
    }

    /// Adds a request for a file; `None` if too many are pending.
    pub(crate) fn request_file(&self, request: FileRequest) -> Option<oneshot::Receiver<FileAnswer>> {
        let mut state = self.state();
        if state.files.len() >= MAX_FILES || state.stopped {
            return None;
        }
        let (reply, answer) = oneshot::channel();
        state.files.push_back((request, reply));
        self.changed.notify_one();
        Some(answer)
    }

    /// Sends a message to a client, which may have left.
    pub(crate) fn send(&self, client: u64, message: Message) {
        if let Some(client) = self.state().clients.get_mut(&client) {
            let frames = usize::from(matches!(message, Message::Frame(_)));
            // Full only of error messages that the client does not read.
            if client.outbox.try_send(message).is_ok() {
                client.in_flight += frames;
            }
        }
    }

    /// Sends a text that a later one replaces, unless an earlier message is still to be sent: it
    /// takes no frame's room.
    pub(crate) fn send_progress(&self, client: u64, text: String) {
        if let Some(client) = self.state().clients.get(&client)
            && client.outbox.capacity() == client.outbox.max_capacity()
        {
            let _ = client.outbox.try_send(Message::Text(text));
        }
    }

    /// Drops all clients and requests, and accepts no more.
    pub(crate) fn stop(&self) {
        let mut state = self.state();
        state.stopped = true;
        state.clients.clear();
        state.files.clear();
        self.changed.notify_all();
    }

    /// Whether any client is connected.
    pub(crate) fn has_clients(&self) -> bool {
        !self.state().clients.is_empty()
    }

    /// Waits for the next task; with `prepare`, returns [`Task::Prepare`] at once if no request is pending.
    pub(crate) fn next(&self, prepare: bool) -> Task {
        let mut state = self.state();
        loop {
            if let Some(task) = state.take() {
                return task;
            }
            if prepare {
                return Task::Prepare;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl State {
    fn take(&mut self) -> Option<Task> {
        if self.stopped {
            return Some(Task::Stop);
        }
        if let Some((view, found)) = self.found.take() {
            return Some(Task::Found { view, found });
        }
        // Round robin: from the client after the last one on.
        let is_ready = |client: &Client| client.request.is_some() && client.in_flight < MAX_FRAMES_IN_FLIGHT;
        let in_turn = self.clients.range(self.last_client + 1..).chain(self.clients.range(..=self.last_client));
        let next = in_turn.filter(|(_, client)| is_ready(client)).map(|(&number, _)| number).next();
        if !(self.file_was_last && next.is_some())
            && let Some((request, reply)) = self.files.pop_front()
        {
            self.file_was_last = true;
            return Some(Task::File { request, reply });
        }
        let client = next?;
        (self.last_client, self.file_was_last) = (client, false);
        let request = self.clients.get_mut(&client)?.request.take()?;
        Some(Task::Frame { client, request })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use Viewpoint;

    fn view_request(id: u64) -> ViewRequest {
        ViewRequest { id, viewpoint: Viewpoint::sample(0), moving: true, depth: false }
    }

    fn file_request() -> FileRequest {
        FileRequest::Picture(view_request(0).viewpoint)
    }

    /// The client and the number of the next request; zeros for a file.
    fn served(queue: &RequestQueue) -> Option<(u64, u64)> {
        match queue.next(true) {
            Task::Frame { client, request } => Some((client, request.id)),
            Task::File { .. } => Some((0, 0)),
            _ => None,
        }
    }

    #[test]
    fn newest_request_of_each_client_is_served_in_turn() {
        let queue = RequestQueue::default();
        let [a, b] = [0, 1].map(|_| queue.join().unwrap().0);
        (1..=5).for_each(|id| queue.request_view(a, view_request(id)));
        queue.request_view(b, view_request(7));
        assert_eq!([served(&queue), served(&queue), served(&queue)], [Some((a, 5)), Some((b, 7)), None]);
        queue.request_view(a, view_request(8));
        queue.request_view(b, view_request(9));
        let _answers = [0, 1].map(|_| queue.request_file(file_request()).unwrap());
        let turns: Vec<_> = std::iter::from_fn(|| served(&queue)).collect();
        assert_eq!(turns, [(0, 0), (a, 8), (0, 0), (b, 9)]);
    }

    #[test]
    fn client_that_shows_no_frame_gets_no_more() {
        let queue = RequestQueue::default();
        let (client, mut messages) = queue.join().unwrap();
        let frame = || Message::Frame(Arc::from(&b"frame"[..]));
        for id in 0..MAX_FRAMES_IN_FLIGHT as u64 {
            queue.request_view(client, view_request(id));
            assert_eq!(served(&queue), Some((client, id)));
            queue.send(client, frame());
        }
        queue.request_view(client, view_request(9));
        assert_eq!(served(&queue), None);
        assert!(messages.try_recv().is_ok());
        queue.frame_shown(client);
        assert_eq!(served(&queue), Some((client, 9)));
    }

    #[test]
    fn texts_leave_room_for_frames_and_only_sent_frames_are_in_flight() {
        let queue = RequestQueue::default();
        let (client, mut messages) = queue.join().unwrap();
        let frame = || Message::Frame(Arc::from(&b"frame"[..]));
        (0..9).for_each(|_| queue.send_progress(client, "progress".to_owned()));
        (0..MAX_FRAMES_IN_FLIGHT).for_each(|_| queue.send(client, frame()));
        let sent: Vec<_> = std::iter::from_fn(|| messages.try_recv().ok()).collect();
        assert!(matches!(sent[..], [Message::Text(_), Message::Frame(_), Message::Frame(_)]), "{sent:?}");
        (0..MAX_FRAMES_IN_FLIGHT).for_each(|_| queue.frame_shown(client));
        (0..9).for_each(|_| queue.send(client, Message::Text("error".to_owned())));
        (0..MAX_FRAMES_IN_FLIGHT).for_each(|_| queue.send(client, frame()));
        queue.request_view(client, view_request(1));
        assert_eq!(served(&queue), Some((client, 1)));
    }

    #[test]
    fn clients_and_pending_files_are_limited() {
        let queue = RequestQueue::default();
        let clients: Vec<_> = std::iter::from_fn(|| queue.join()).collect();
        assert_eq!(clients.len(), MAX_CLIENTS);
        queue.leave(clients[0].0);
        assert!(queue.join().is_some());
        let answers: Vec<_> = std::iter::from_fn(|| queue.request_file(file_request())).collect();
        assert_eq!(answers.len(), MAX_FILES);
        queue.stop();
        assert!(matches!(queue.next(true), Task::Stop));
        assert!(queue.join().is_none() && queue.request_file(file_request()).is_none());
    }
}
