//! What clients wish to see, and who is next: of each client the newest wish alone counts, and clients take turns.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use liveview::Camera;
use tokio::sync::{mpsc, oneshot};

/// Frames on their way to a client, at most: a slow one gets fewer, never later ones.
const IN_FLIGHT: usize = 2;
/// Clients at a time.
const CLIENTS: usize = 16;
/// Pictures to save that may wait.
const STILLS: usize = 4;

/// What a client wishes to see.
#[derive(Debug, Clone)]
pub(super) struct Wish {
    /// The client's number for it.
    pub(super) id: u64,
    pub(super) camera: Camera,
    /// Whether the viewpoint moves: then speed counts, else quality.
    pub(super) moving: bool,
    /// Disparity in colour in place of the picture.
    pub(super) depth: bool,
}

/// A picture to save: PNG, or why there is none.
pub(super) type Saved = Result<Arc<[u8]>, String>;

/// What the renderer is to do next.
#[derive(Debug)]
pub(super) enum Task {
    Frame {
        client: u64,
        wish: Wish,
    },
    Still {
        camera: Camera,
        reply: oneshot::Sender<Saved>,
    },
    /// Nothing is wished for: time to prepare.
    Spare,
    Stop,
}

/// A message to a client.
#[derive(Debug, Clone)]
pub(super) enum Message {
    /// A header in JSON and a picture.
    Frame(Arc<[u8]>),
    /// JSON.
    Text(String),
}

struct Client {
    wish: Option<Wish>,
    in_flight: usize,
    outbox: mpsc::Sender<Message>,
}

#[derive(Default)]
struct State {
    clients: BTreeMap<u64, Client>,
    stills: VecDeque<(Camera, oneshot::Sender<Saved>)>,
    /// The client that was served last; a picture to save takes its turn like one of them.
    last: u64,
    still_was_last: bool,
    joined: u64,
    stop: bool,
}

/// Wishes of all clients; shared by the renderer and the server.
#[derive(Default)]
pub(super) struct Desk {
    state: Mutex<State>,
    changed: Condvar,
}

impl Desk {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A new client: its number, and where its messages come out; `None` if there are too many.
    pub(super) fn join(&self) -> Option<(u64, mpsc::Receiver<Message>)> {
        let mut state = self.state();
        if state.clients.len() >= CLIENTS || state.stop {
            return None;
        }
        // Room for the frames in flight and for as many words about what failed.
        let (outbox, messages) = mpsc::channel(2 * IN_FLIGHT);
        state.joined += 1;
        let client = state.joined;
        state.clients.insert(client, Client { wish: None, in_flight: 0, outbox });
        Some((client, messages))
    }

    pub(super) fn leave(&self, client: u64) {
        self.state().clients.remove(&client);
    }

    /// How many clients there have been.
    pub(super) fn joined(&self) -> u64 {
        self.state().joined
    }

    /// Takes the place of whatever this client wished for before.
    pub(super) fn wish(&self, client: u64, wish: Wish) {
        if let Some(client) = self.state().clients.get_mut(&client) {
            client.wish = Some(wish);
        }
        self.changed.notify_one();
    }

    /// The client shows a frame that it was sent.
    pub(super) fn shown(&self, client: u64) {
        if let Some(client) = self.state().clients.get_mut(&client) {
            client.in_flight = client.in_flight.saturating_sub(1);
        }
        self.changed.notify_one();
    }

    /// Asks for a picture to save; `None` if too many wait.
    pub(super) fn still(&self, camera: Camera) -> Option<oneshot::Receiver<Saved>> {
        let mut state = self.state();
        if state.stills.len() >= STILLS || state.stop {
            return None;
        }
        let (reply, saved) = oneshot::channel();
        state.stills.push_back((camera, reply));
        self.changed.notify_one();
        Some(saved)
    }

    /// Sends a frame, or a word about it, to a client that may be gone.
    pub(super) fn send(&self, client: u64, message: Message) {
        if let Some(client) = self.state().clients.get_mut(&client) {
            client.in_flight += usize::from(matches!(message, Message::Frame(_)));
            // Full only of words that the client does not read.
            let _ = client.outbox.try_send(message);
        }
    }

    /// Ends it: nothing is served any more.
    pub(super) fn stop(&self) {
        let mut state = self.state();
        state.stop = true;
        state.clients.clear();
        state.stills.clear();
        self.changed.notify_all();
    }

    /// Whether there is any client.
    pub(super) fn is_watched(&self) -> bool {
        !self.state().clients.is_empty()
    }

    /// What is to be done next; waits for it, or where `spare` is set, says at once that there is nothing.
    pub(super) fn next(&self, spare: bool) -> Task {
        let mut state = self.state();
        loop {
            if let Some(task) = state.take() {
                return task;
            }
            if spare {
                return Task::Spare;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl State {
    fn take(&mut self) -> Option<Task> {
        if self.stop {
            return Some(Task::Stop);
        }
        // In the order of their numbers, from the one after the last on.
        let ready = |client: &Client| client.wish.is_some() && client.in_flight < IN_FLIGHT;
        let after = self.clients.range(self.last + 1..).chain(self.clients.range(..=self.last));
        let next = after.filter(|(_, client)| ready(client)).map(|(&number, _)| number).next();
        if !(self.still_was_last && next.is_some())
            && let Some((camera, reply)) = self.stills.pop_front()
        {
            self.still_was_last = true;
            return Some(Task::Still { camera, reply });
        }
        let client = next?;
        (self.last, self.still_was_last) = (client, false);
        let wish = self.clients.get_mut(&client)?.wish.take()?;
        Some(Task::Frame { client, wish })
    }
}

#[cfg(test)]
mod tests {
    use liveview::Intrinsics;
    use liveview::glam::{DMat3, DVec3};

    use super::*;

    fn wish(id: u64) -> Wish {
        let k = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        let camera = Camera::new(k, 64, 48, DMat3::IDENTITY, DVec3::ZERO).unwrap();
        Wish { id, camera, moving: true, depth: false }
    }

    fn served(desk: &Desk) -> Option<(u64, u64)> {
        match desk.next(true) {
            Task::Frame { client, wish } => Some((client, wish.id)),
            Task::Still { .. } => Some((0, 0)),
            _ => None,
        }
    }

    #[test]
    fn only_the_newest_wish_of_each_client_counts_and_they_take_turns() {
        let desk = Desk::default();
        let [a, b] = [0, 1].map(|_| desk.join().unwrap().0);
        (1..=5).for_each(|id| desk.wish(a, wish(id)));
        desk.wish(b, wish(7));
        assert_eq!([served(&desk), served(&desk), served(&desk)], [Some((a, 5)), Some((b, 7)), None]);
        desk.wish(a, wish(8));
        desk.wish(b, wish(9));
        let _saved = [0, 1].map(|_| desk.still(wish(0).camera).unwrap());
        let turns: Vec<_> = std::iter::from_fn(|| served(&desk)).collect();
        assert_eq!(turns, [(0, 0), (a, 8), (0, 0), (b, 9)]);
    }

    #[test]
    fn a_client_that_shows_nothing_gets_no_more() {
        let desk = Desk::default();
        let (client, mut messages) = desk.join().unwrap();
        let frame = || Message::Frame(Arc::from(&b"frame"[..]));
        for id in 0..IN_FLIGHT as u64 {
            desk.wish(client, wish(id));
            assert_eq!(served(&desk), Some((client, id)));
            desk.send(client, frame());
        }
        desk.wish(client, wish(9));
        assert_eq!(served(&desk), None);
        assert!(messages.try_recv().is_ok());
        desk.shown(client);
        assert_eq!(served(&desk), Some((client, 9)));
    }

    #[test]
    fn there_is_an_end_to_clients_and_to_pictures_that_wait() {
        let desk = Desk::default();
        let clients: Vec<_> = std::iter::from_fn(|| desk.join()).collect();
        assert_eq!(clients.len(), CLIENTS);
        desk.leave(clients[0].0);
        assert!(desk.join().is_some());
        let saved: Vec<_> = std::iter::from_fn(|| desk.still(wish(0).camera)).collect();
        assert_eq!(saved.len(), STILLS);
        desk.stop();
        assert!(matches!(desk.next(true), Task::Stop));
        assert!(desk.join().is_none() && desk.still(wish(0).camera).is_none());
    }
}
