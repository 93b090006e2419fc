//! What clients wish to see, and who is next: of each client the newest wish alone counts, and clients take turns.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use tokio::sync::{mpsc, oneshot};

use crate::wish::{Answer, Asked, Message, Task, Wish};

/// Frames on their way to a client, at most: a slow one gets fewer, never later ones.
const IN_FLIGHT: usize = 2;
/// Clients at a time.
const CLIENTS: usize = 16;
/// Files that may wait.
const FILES: usize = 4;

struct Client {
    wish: Option<Wish>,
    in_flight: usize,
    outbox: mpsc::Sender<Message>,
}

#[derive(Default)]
struct State {
    clients: BTreeMap<u64, Client>,
    files: VecDeque<(Asked, oneshot::Sender<Answer>)>,
    /// The client that was served last; a file takes its turn like one of them.
    last: u64,
    file_was_last: bool,
    joined: u64,
    stop: bool,
}

/// Wishes of all clients; shared by the renderer and the server.
#[derive(Default)]
pub(crate) struct Desk {
    state: Mutex<State>,
    changed: Condvar,
}

impl Desk {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A new client: its number, and where its messages come out; `None` if there are too many.
    pub(crate) fn join(&self) -> Option<(u64, mpsc::Receiver<Message>)> {
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

    pub(crate) fn leave(&self, client: u64) {
        self.state().clients.remove(&client);
    }

    /// How many clients there have been.
    pub(crate) fn joined(&self) -> u64 {
        self.state().joined
    }

    /// Takes the place of whatever this client wished for before.
    pub(crate) fn wish(&self, client: u64, wish: Wish) {
        if let Some(client) = self.state().clients.get_mut(&client) {
            client.wish = Some(wish);
        }
        self.changed.notify_one();
    }

    /// The client shows a frame that it was sent.
    pub(crate) fn shown(&self, client: u64) {
        if let Some(client) = self.state().clients.get_mut(&client) {
            client.in_flight = client.in_flight.saturating_sub(1);
        }
        self.changed.notify_one();
    }

    /// Asks for a file; `None` if too many wait.
    pub(crate) fn ask(&self, asked: Asked) -> Option<oneshot::Receiver<Answer>> {
        let mut state = self.state();
        if state.files.len() >= FILES || state.stop {
            return None;
        }
        let (reply, answer) = oneshot::channel();
        state.files.push_back((asked, reply));
        self.changed.notify_one();
        Some(answer)
    }

    /// Sends a frame, or a word about it, to a client that may be gone.
    pub(crate) fn send(&self, client: u64, message: Message) {
        if let Some(client) = self.state().clients.get_mut(&client) {
            client.in_flight += usize::from(matches!(message, Message::Frame(_)));
            // Full only of words that the client does not read.
            let _ = client.outbox.try_send(message);
        }
    }

    /// Ends it: nothing is served any more.
    pub(crate) fn stop(&self) {
        let mut state = self.state();
        state.stop = true;
        state.clients.clear();
        state.files.clear();
        self.changed.notify_all();
    }

    /// Whether there is any client.
    pub(crate) fn is_watched(&self) -> bool {
        !self.state().clients.is_empty()
    }

    /// What is to be done next; waits for it, or where `spare` is set, says at once that there is nothing.
    pub(crate) fn next(&self, spare: bool) -> Task {
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
        if !(self.file_was_last && next.is_some())
            && let Some((asked, reply)) = self.files.pop_front()
        {
            self.file_was_last = true;
            return Some(Task::File { asked, reply });
        }
        let client = next?;
        (self.last, self.file_was_last) = (client, false);
        let wish = self.clients.get_mut(&client)?.wish.take()?;
        Some(Task::Frame { client, wish })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use liveview::glam::{DMat3, DVec3};
    use liveview::{Camera, Intrinsics};

    use super::*;
    use crate::wish::Moment;

    fn wish(id: u64) -> Wish {
        let k = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        let camera = Camera::new(k, 64, 48, DMat3::IDENTITY, DVec3::ZERO).unwrap();
        Wish { id, at: Moment { camera, step: 0 }, moving: true, depth: false }
    }

    fn file() -> Asked {
        Asked::Picture(wish(0).at)
    }

    fn served(desk: &Desk) -> Option<(u64, u64)> {
        match desk.next(true) {
            Task::Frame { client, wish } => Some((client, wish.id)),
            Task::File { .. } => Some((0, 0)),
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
        let _saved = [0, 1].map(|_| desk.ask(file()).unwrap());
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
    fn there_is_an_end_to_clients_and_to_files_that_wait() {
        let desk = Desk::default();
        let clients: Vec<_> = std::iter::from_fn(|| desk.join()).collect();
        assert_eq!(clients.len(), CLIENTS);
        desk.leave(clients[0].0);
        assert!(desk.join().is_some());
        let saved: Vec<_> = std::iter::from_fn(|| desk.ask(file())).collect();
        assert_eq!(saved.len(), FILES);
        desk.stop();
        assert!(matches!(desk.next(true), Task::Stop));
        assert!(desk.join().is_none() && desk.ask(file()).is_none());
    }
}
