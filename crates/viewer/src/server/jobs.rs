//! What clients wait for: depths of photos and pictures, computed one after the other by one thread; each result goes to all who
//! asked for it.

use std::collections::{HashMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use liveview::Camera;
use tokio::sync::oneshot;

use super::source::Source;

/// A camera, and a time step of a rig.
pub(crate) struct Viewpoint {
    pub(crate) camera: Camera,
    /// 0 for a scene of photos.
    pub(crate) step: usize,
}

/// The photo of a view at a time step.
pub(crate) type PhotoKey = (usize, usize);
/// The bytes of a file, or that there are none: the reason is for the program's output.
pub(crate) type Answer = Result<Arc<[u8]>, ()>;

/// Pictures that wait, at most.
const MAX_PICTURES: usize = 4;
/// Requests for depth that wait, at most.
const MAX_WAITING: usize = 512;
/// Memory for the files that clients get.
const KEPT_BYTES: usize = 192 << 20;

/// Files that were sent; of more than a number of bytes the oldest are dropped.
#[derive(Default)]
pub(crate) struct KeptFiles {
    files: HashMap<PhotoKey, Arc<[u8]>>,
    order: VecDeque<PhotoKey>,
    bytes: usize,
}

impl KeptFiles {
    pub(crate) fn get(&self, key: PhotoKey) -> Option<Arc<[u8]>> {
        self.files.get(&key).cloned()
    }

    pub(crate) fn insert(&mut self, key: PhotoKey, file: Arc<[u8]>) {
        if self.files.contains_key(&key) {
            return;
        }
        self.bytes += file.len();
        self.files.insert(key, file);
        self.order.push_back(key);
        while self.bytes > KEPT_BYTES && self.order.len() > 1 {
            let dropped = self.order.pop_front().and_then(|key| self.files.remove(&key));
            self.bytes -= dropped.map_or(0, |file| file.len());
        }
    }
}

#[derive(Default)]
struct State {
    depths: KeptFiles,
    /// Depths that are wanted, in the order in which they were asked for, and who waits.
    wanted: VecDeque<(PhotoKey, Vec<oneshot::Sender<Answer>>)>,
    pictures: VecDeque<(Viewpoint, oneshot::Sender<Answer>)>,
    stopped: bool,
}

enum Job {
    Depth(PhotoKey, Vec<usize>),
    Picture(Viewpoint, oneshot::Sender<Answer>),
}

/// The jobs; shared by the worker and the server.
#[derive(Default)]
pub(crate) struct Jobs {
    state: Mutex<State>,
    changed: Condvar,
}

impl Jobs {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks for the depth of a photo; `None` if too many wait.
    pub(crate) fn depth(&self, key: PhotoKey) -> Option<oneshot::Receiver<Answer>> {
        let (reply, answer) = oneshot::channel();
        let mut state = self.state();
        if let Some(known) = state.depths.get(key) {
            let _ = reply.send(Ok(known));
        } else if state.stopped || state.wanted.iter().map(|(_, replies)| replies.len()).sum::<usize>() >= MAX_WAITING {
            return None;
        } else if let Some((_, replies)) = state.wanted.iter_mut().find(|(wanted, _)| *wanted == key) {
            replies.push(reply);
        } else {
            state.wanted.push_back((key, vec![reply]));
        }
        self.changed.notify_one();
        Some(answer)
    }

    /// Asks for a picture; `None` if too many wait.
    pub(crate) fn picture(&self, viewpoint: Viewpoint) -> Option<oneshot::Receiver<Answer>> {
        let (reply, answer) = oneshot::channel();
        let mut state = self.state();
        state.pictures.retain(|(_, reply)| !reply.is_closed());
        if state.stopped || state.pictures.len() >= MAX_PICTURES {
            return None;
        }
        state.pictures.push_back((viewpoint, reply));
        self.changed.notify_one();
        Some(answer)
    }

    /// Ends the worker; whoever waits gets no answer.
    pub(crate) fn stop(&self) {
        let mut state = self.state();
        *state = State { stopped: true, ..State::default() };
        self.changed.notify_all();
    }

    /// Waits for the next job: pictures first, then depths. `None` once it is stopped.
    fn next(&self) -> Option<Job> {
        let mut state = self.state();
        loop {
            if state.stopped {
                return None;
            }
            if let Some((viewpoint, reply)) = state.pictures.pop_front() {
                return Some(Job::Picture(viewpoint, reply));
            }
            // Whoever has left does not count; a depth stays in the list until it is found, so that others can join.
            state.wanted.iter_mut().for_each(|(_, replies)| replies.retain(|reply| !reply.is_closed()));
            state.wanted.retain(|(_, replies)| !replies.is_empty());
            if let Some(&(key, _)) = state.wanted.front() {
                return Some(Job::Depth(key, state.wanted.iter().skip(1).map(|((view, _), _)| *view).collect()));
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn found(&self, key: PhotoKey, answer: &Answer) {
        let mut state = self.state();
        if let Ok(file) = answer {
            state.depths.insert(key, Arc::clone(file));
        }
        let replies = state.wanted.iter().position(|(wanted, _)| *wanted == key);
        for reply in replies.and_then(|at| state.wanted.remove(at)).into_iter().flat_map(|(_, replies)| replies) {
            // Sending fails if the client has left.
            let _ = reply.send(answer.clone());
        }
    }

    /// Does the jobs until it is stopped; returns the number of pictures. `failed` is told why there is no answer.
    pub(crate) fn work(&self, source: &mut Source, failed: impl Fn(String)) -> u64 {
        let mut pictures = 0;
        while let Some(job) = self.next() {
            match job {
                Job::Picture(viewpoint, reply) => {
                    let _ = reply.send(attempt("the picture", || source.picture(&viewpoint), &failed));
                    pictures += 1;
                }
                Job::Depth(key, later) => {
                    self.found(key, &attempt("the depth of a photo", || source.depth(key, &later), &failed));
                }
            }
        }
        pictures
    }
}

/// The file that a job makes. One that panics has failed too: the others go on.
fn attempt(what: &str, job: impl FnOnce() -> anyhow::Result<Vec<u8>>, failed: &impl Fn(String)) -> Answer {
    match catch_unwind(AssertUnwindSafe(job)) {
        Ok(Ok(file)) => return Ok(file.into()),
        Ok(Err(error)) => failed(format!("{what} failed: {error:#}")),
        Err(_) => failed(format!("{what} failed: an error of the program")),
    }
    Err(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(jobs: &Jobs) -> Option<usize> {
        match jobs.next() {
            Some(Job::Depth((view, _), _)) => Some(view),
            _ => None,
        }
    }

    #[test]
    fn depths_are_found_once_in_the_order_in_which_they_are_wanted() {
        let jobs = Jobs::default();
        let mut answers = [3, 1, 3].map(|view| jobs.depth((view, 0)).unwrap());
        drop(jobs.depth((5, 0)));
        for expected in [3, 1] {
            assert_eq!(key(&jobs), Some(expected));
            jobs.found((expected, 0), &Ok(Arc::from([expected as u8])));
        }
        let found = answers.each_mut().map(|answer| answer.try_recv().unwrap().unwrap()[0]);
        assert_eq!(found, [3, 1, 3]);
        assert_eq!(jobs.depth((1, 0)).unwrap().try_recv().unwrap().unwrap()[..], [1]);
        let mut fails = jobs.depth((6, 0)).unwrap();
        assert_eq!(key(&jobs), Some(6), "whoever has left is not served");
        jobs.found((6, 0), &Err(()));
        assert_eq!(fails.try_recv().unwrap(), Err(()));
    }

    #[test]
    fn what_waits_is_bounded_and_a_stop_ends_it() {
        let jobs = Jobs::default();
        let k = liveview::Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        let camera = Camera::new(k, 64, 48, liveview::glam::DMat3::IDENTITY, liveview::glam::DVec3::ZERO).unwrap();
        let picture = || jobs.picture(Viewpoint { camera: camera.clone(), step: 0 });
        let waiting: Vec<_> = std::iter::from_fn(picture).collect();
        assert_eq!(waiting.len(), MAX_PICTURES);
        drop(waiting);
        assert!(picture().is_some(), "those who left make room");
        let depths: Vec<_> = std::iter::from_fn(|| jobs.depth((1, 0))).take(MAX_WAITING + 1).collect();
        assert_eq!(depths.len(), MAX_WAITING);
        jobs.stop();
        assert!(jobs.next().is_none() && picture().is_none() && jobs.depth((2, 0)).is_none());
    }

    #[test]
    fn a_panic_is_the_failure_of_one_job() {
        let told = std::cell::RefCell::new(Vec::new());
        let failed = |text| told.borrow_mut().push(text);
        assert_eq!(attempt("it", || panic!("a panic of the test"), &failed), Err(()));
        assert_eq!(attempt("it", || anyhow::bail!("reason"), &failed), Err(()));
        assert_eq!(*told.borrow(), ["it failed: an error of the program", "it failed: reason"]);
    }

    #[test]
    fn kept_files_are_bounded() {
        let mut kept = KeptFiles::default();
        let file: Arc<[u8]> = vec![0; KEPT_BYTES / 3].into();
        (0..5).for_each(|view| kept.insert((view, 0), Arc::clone(&file)));
        assert_eq!(
            (0..5).map(|view| kept.get((view, 0)).is_some()).collect::<Vec<_>>(),
            [false, false, true, true, true]
        );
        assert!(kept.bytes <= KEPT_BYTES);
    }
}
