//! The library's synthesizer, shared by Python's threads: one picture at a time, ended by Ctrl-C.

use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::{self, ThreadId};
use std::time::Duration;

use liveview::network::RunEnd;
use liveview_synthesizer::{DepthProgress, ModelOptions, Options, Plan, Scene, Shot, Synthesizer};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::arguments::library;
use crate::frame::Frame;

/// The library's synthesizer, and how its work is ended.
pub(crate) struct Engine {
    synthesizer: Mutex<Synthesizer>,
    /// How the network is opened again after an interrupt has ended it; `None` without one.
    model: Option<ModelOptions>,
    runs: Mutex<Option<RunEnd>>,
    control: Arc<Control>,
}

/// What a running search sees from outside, and what it leaves.
#[derive(Default)]
struct Control {
    stop: AtomicBool,
    /// The thread that renders, which calls `progress`.
    worker: Mutex<Option<ThreadId>>,
    /// The exception of `progress`.
    raised: Mutex<Option<PyErr>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Control {
    /// Asks Python's callback whether the next photo is searched.
    fn next(&self, progress: Option<&Py<PyAny>>, next: DepthProgress<'_>) -> ControlFlow<()> {
        let call = |progress: &Py<PyAny>| {
            Python::try_attach(|py| progress.call1(py, (next.done, next.count, next.name)).map(|_| ()))
        };
        match progress.map_or(Some(Ok(())), call) {
            Some(Ok(())) => {}
            Some(Err(raised)) => {
                *locked(&self.raised) = Some(raised);
                return ControlFlow::Break(());
            }
            // The interpreter exits.
            None => return ControlFlow::Break(()),
        }
        if self.stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

impl Engine {
    /// `progress` is called before each search of a photo's depth.
    pub(crate) fn open(scene: Scene, options: Options, progress: Option<Py<PyAny>>) -> PyResult<Self> {
        let mut synthesizer = Synthesizer::with_scene(scene, &options).map_err(library)?;
        let control = Arc::<Control>::default();
        let watched = Arc::clone(&control);
        synthesizer.photos_mut().on_depth_search(move |next| watched.next(progress.as_ref(), next));
        let runs = Mutex::new(synthesizer.run_end());
        let model = options.model.file.is_some().then_some(options.model);
        Ok(Self { synthesizer: Mutex::new(synthesizer), model, runs, control })
    }

    /// Runs work on the library's synthesizer, one at a time. An interrupt ends the work of its own
    /// call only.
    pub(crate) fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Synthesizer) -> PyResult<T> + Send,
    ) -> PyResult<T> {
        if *locked(&self.control.worker) == Some(thread::current().id()) {
            return Err(PyRuntimeError::new_err("progress: it called the synthesizer that called it"));
        }
        let (interrupted, holds) = (AtomicBool::new(false), Mutex::new(false));
        let interrupt = || {
            interrupted.store(true, Ordering::Relaxed);
            // Locked until all is ended: the call that gets the synthesizer next goes on.
            let holds = locked(&holds);
            if *holds {
                self.control.stop.store(true, Ordering::Relaxed);
                locked(&self.runs).iter().for_each(RunEnd::end);
            }
        };
        run(py, interrupt, || {
            let mut synthesizer = locked(&self.synthesizer);
            if self.control.stop.swap(false, Ordering::Relaxed)
                && let Some(options) = &self.model
            {
                // Opens the network whose runs an interrupt has ended.
                let layers = synthesizer.layers().clone();
                let opened = options.open_renderer(Some(&layers)).map_err(library)?;
                *synthesizer.renderer_mut() = opened.renderer;
                *locked(&self.runs) = opened.model.map(|model| model.run_end);
            }
            *locked(&holds) = true;
            let result = if interrupted.load(Ordering::Relaxed) {
                Err(PyRuntimeError::new_err("interrupted while another thread rendered"))
            } else {
                *locked(&self.control.worker) = Some(thread::current().id());
                let result = work(&mut synthesizer);
                *locked(&self.control.worker) = None;
                result
            };
            *locked(&holds) = false;
            locked(&self.control.raised).take().map_or(result, Err)
        })
    }

    /// Whether the running work's call was interrupted: its result is dropped.
    pub(crate) fn is_interrupted(&self) -> bool {
        self.control.stop.load(Ordering::Relaxed)
    }
}

/// Renders one shot, on the layers of a plan that is known or found; `later` are the shots that
/// follow.
pub(crate) fn rendered(
    synthesizer: &mut Synthesizer,
    shot: &Shot,
    later: &[Shot],
    known: Option<Plan>,
) -> PyResult<(Frame, Plan)> {
    let loaded = synthesizer.load(shot, later).map_err(library)?;
    let plan = known.map_or_else(|| synthesizer.plan(&loaded), Ok).map_err(library)?;
    let frame = synthesizer.render_plan(&loaded, &plan, None).map_err(library)?;
    let guessed = plan.surface.as_ref().map(|found| found.surface.guessed_share());
    let before = [("depth", plan.search), ("selection", plan.selection)];
    Ok((Frame::new(shot.name.clone(), frame, before, guessed), plan))
}

/// Time between two looks for a signal.
const SIGNALS: Duration = Duration::from_millis(50);
/// The stack of a program's main thread.
const STACK: usize = 8 << 20;

/// The process that computed first.
static PROCESS: OnceLock<u32> = OnceLock::new();

/// Runs `work` in a thread of its own, without the interpreter. At a signal `interrupt` is called,
/// which is to end the work early; the signal's exception then comes in place of its result. The same is
/// done when the interpreter exits.
///
/// # Errors
///
/// That exception, and `RuntimeError` for a panic and in a fork of a process that has computed: threads
/// are not forked, and work would wait for them for ever.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    interrupt: impl Fn() + Send + Sync,
    work: impl FnOnce() -> PyResult<T> + Send,
) -> PyResult<T> {
    if *PROCESS.get_or_init(std::process::id) != std::process::id() {
        return Err(PyRuntimeError::new_err(
            "this process is a fork of one that used liveview, whose threads are missing; expected a new process: \
             multiprocessing's start method \"spawn\" or \"forkserver\"",
        ));
    }
    py.detach(|| {
        thread::scope(|scope| {
            let (done, waiting) = sync_channel(1);
            let work = move || {
                let result = catch_unwind(AssertUnwindSafe(work));
                let _ = done.send(());
                result
            };
            let worker = thread::Builder::new().name("liveview".to_owned()).stack_size(STACK);
            let worker = worker.spawn_scoped(scope, work)?;
            let mut signal = None;
            while let Err(RecvTimeoutError::Timeout) = waiting.recv_timeout(SIGNALS) {
                match Python::try_attach(|py| py.check_signals()) {
                    Some(Ok(())) => {}
                    Some(Err(raised)) => {
                        signal.get_or_insert(raised);
                        interrupt();
                    }
                    // The interpreter exits.
                    None => interrupt(),
                }
            }
            let result = worker.join().and_then(|result| result);
            match (signal, result) {
                (Some(raised), _) => Err(raised),
                (None, Ok(result)) => result,
                (None, Err(panic)) => Err(PyRuntimeError::new_err(format!("internal error: {}", text(&*panic)))),
            }
        })
    })
}

/// As [`run`], for work that no signal ends early.
pub(crate) fn compute<T: Send>(py: Python<'_>, work: impl FnOnce() -> PyResult<T> + Send) -> PyResult<T> {
    run(py, || (), work)
}

/// The message of a panic.
fn text(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic without a message".to_owned())
}
