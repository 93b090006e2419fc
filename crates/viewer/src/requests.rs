//! What clients ask for, and what they are sent; the pending requests of all clients. Of each client only the newest request for a
//! picture is kept, and clients take turns.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use liveview::Camera;
use liveview_synthesizer::FoundDepth;
use serde_json::json;
use tokio::sync::{mpsc, oneshot};

use crate::renderer::ViewRenderer;

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
/// Pending requests for files, and as many that wait for depth.
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
    use std::sync::Arc;

    use super::*;

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

#[cfg(test)]
mod waiting_tests {
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
