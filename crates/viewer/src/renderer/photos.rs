//! Pictures from the photos of a scene: at rest the same as those of `liveview render`.

use std::collections::VecDeque;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::Result;
use liveview::geometry::distance;
use liveview::render::Renderer;
use liveview::{Camera, ImageRgb};
use liveview_synthesizer::agreement;
use liveview_synthesizer::{
    FoundDepth, LayerSpec, LoadedShot, Scene, ScenePhotos, Shot, SynthesisError, Synthesizer, TargetCamera, Targets,
    ViewAgreement,
};
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::{AwaitedDepth, MOTION_BUDGET, Rendered, Source};
use crate::ViewSettings;
use crate::requests::{RequestQueue, Viewpoint};

/// Memory of a photo and its depth, at most.
const BYTES_PER_PIXEL: usize = 20;

/// A synthesizer, and the photos that it will need.
pub(crate) struct Photos {
    synthesizer: Synthesizer,
    without_network: bool,
    note: fn(&str),
    held_out: Vec<usize>,
    layers: LayerSpec,
    motion_layers: LayerSpec,
    /// A shot at the camera of each view, those nearest to the last target first.
    view_shots: Vec<Shot>,
    /// Those of them whose photo and depth are not prepared yet.
    unprepared: Vec<Shot>,
    searches: DepthSearches,
    /// The last shot that depth is searched for.
    searched_for: Option<Shot>,
    /// Renders what stands in for a picture that waits: without the network, which takes longest.
    drafts: Renderer,
    size: SizeController,
}

impl Photos {
    /// `start`: the camera at which clients start.
    ///
    /// # Errors
    /// No threads can be started.
    pub(crate) fn new(
        mut synthesizer: Synthesizer,
        settings: &ViewSettings,
        start: &Camera,
        queue: Arc<RequestQueue>,
    ) -> Result<Self> {
        let layers = synthesizer.layers().clone();
        let motion_layers = match layers {
            LayerSpec::Guided { coarse_planes, .. } => LayerSpec::Guided { layers: 1, coarse_planes },
            // Rendering planes takes seconds.
            _ => LayerSpec::Surface(1),
        };
        synthesizer.set_layers(motion_layers.clone());
        let agreement = ViewAgreement { views: synthesizer.renderer().network().views() };
        let drafts = Renderer::new(Box::new(agreement), ViewAgreement::ALPHA, 1);
        let mut photos = Self {
            searches: DepthSearches::new(settings.threads, queue)?,
            synthesizer,
            without_network: settings.without_network,
            note: settings.note,
            held_out: settings.held_out.clone(),
            layers,
            motion_layers,
            view_shots: Vec::new(),
            unprepared: Vec::new(),
            searched_for: None,
            drafts,
            size: SizeController::default(),
        };
        let views = &photos.synthesizer.scene().views;
        let free = (0..views.len()).filter(|view| !photos.held_out.contains(view));
        let mut view_shots: Vec<Shot> = free.filter_map(|view| photos.shot(&views[view].camera).ok()).collect();
        view_shots.sort_by(|a, b| distance(&a.target, start).total_cmp(&distance(&b.target, start)));
        let pixels = views.iter().map(|view| view.camera.size().pixels()).max().unwrap_or(1);
        let capacity = ScenePhotos::KEPT_BYTES / (BYTES_PER_PIXEL * pixels);
        photos.unprepared = view_shots.iter().take(capacity).cloned().collect();
        photos.view_shots = view_shots;
        Ok(photos)
    }

    /// The nearest depth of any photo, scene units.
    pub(crate) fn near(&self) -> Option<f64> {
        self.view_shots.iter().map(|shot| shot.near).reduce(f64::min)
    }

    fn shot(&self, camera: &Camera) -> Result<Shot> {
        let target = TargetCamera { name: "pose".to_owned(), camera: camera.clone(), truth: None };
        let targets = Targets { list: vec![target], held_out: self.held_out.clone(), moving: false };
        Ok(self.synthesizer.shots(targets)?.remove(0))
    }

    /// Loads the photos of a shot. Others stay in memory while there is room, those near it first.
    fn load(&mut self, shot: &Shot) -> Result<LoadedShot> {
        // Almost sorted already where the viewpoint has moved little: the sort is fast then.
        self.view_shots.sort_by(|a, b| distance(&a.target, &shot.target).total_cmp(&distance(&b.target, &shot.target)));
        Ok(self.synthesizer.load(shot, &self.view_shots)?)
    }

    fn render(&mut self, camera: &Camera, layers: LayerSpec) -> Result<Rendered> {
        self.synthesizer.set_layers(layers.clone());
        let shot = self.shot(camera)?;
        let started = Instant::now();
        let loaded = self.load(&shot)?;
        let photos = started.elapsed();
        let plan = self.synthesizer.plan(&loaded)?;
        self.synthesizer.photos_mut().take_notes().iter().for_each(|note| (self.note)(note));
        let (frame, agreeing_share) =
            agreement::render(&mut self.synthesizer, &loaded, &plan, self.without_network, &mut |_| ())?;
        Ok(Rendered {
            frame,
            range: (shot.near, shot.far),
            layers,
            views: shot.views,
            helpers: shot.helpers,
            planning: [photos, plan.search, plan.selection],
            agreeing_share,
            left_out: Vec::new(),
        })
    }
}

impl Source for Photos {
    fn scene(&self) -> &Scene {
        self.synthesizer.scene()
    }

    fn motion_scale(&self, pixels: usize) -> f64 {
        self.size.scale(pixels)
    }

    fn render_in_motion(&mut self, viewpoint: &Viewpoint) -> Result<Rendered> {
        self.synthesizer.searches_holes = false;
        let rendered = self.render(&viewpoint.camera, self.motion_layers.clone());
        self.synthesizer.searches_holes = true;
        rendered
    }

    fn record_motion_time(&mut self, rendered: &Rendered, took: Duration) {
        let [_, search, _] = rendered.planning;
        self.size.record(rendered.frame.transmittance.len(), took, search);
    }

    fn render_at_rest(&mut self, viewpoint: &Viewpoint) -> Result<Rendered> {
        self.render(&viewpoint.camera, self.layers.clone())
    }

    fn photo(&mut self, view: usize, _: usize) -> Result<ImageRgb> {
        Ok(self.synthesizer.scene().load_image(view)?)
    }

    /// A picture does not wait for depth whose search has failed: rendering it says why.
    fn awaited(&mut self, viewpoint: &Viewpoint, moving: bool) -> Option<AwaitedDepth> {
        let layers = if moving { &self.motion_layers } else { &self.layers };
        self.synthesizer.set_layers(layers.clone());
        if !self.synthesizer.uses_depth() {
            return None;
        }
        let shot = self.shot(&viewpoint.camera).ok()?;
        let mut views = self.synthesizer.photos_mut().unknown_depths(&shot);
        views.retain(|&view| !self.searches.has_failed(view));
        let count = shot.views.len() + shot.helpers.len();
        (!views.is_empty()).then(|| {
            self.searched_for = Some(shot);
            AwaitedDepth { views, count }
        })
    }

    fn render_draft(&mut self, viewpoint: &Viewpoint) -> Result<Rendered> {
        std::mem::swap(self.synthesizer.renderer_mut(), &mut self.drafts);
        let rendered = self.render(&viewpoint.camera, LayerSpec::guided(1));
        std::mem::swap(self.synthesizer.renderer_mut(), &mut self.drafts);
        rendered
    }

    fn is_searching(&self) -> bool {
        self.searches.is_running()
    }

    fn start_search(&mut self, views: &[usize]) -> bool {
        let Some(shot) = &self.searched_for else { return false };
        let photos = self.synthesizer.photos_mut();
        let search = |view| Ok(photos.depth_search(view, shot)?.map(|search| move || search.run()));
        self.searches.start_first(views, search)
    }

    fn insert(&mut self, view: usize, found: Option<Box<FoundDepth>>) {
        self.searches.end(view, found.is_some());
        if let Some(found) = found {
            self.synthesizer.photos_mut().insert_depth(*found);
        }
    }

    /// None while a search is running: what it finds comes first.
    fn unprepared(&self) -> usize {
        if self.is_searching() { 0 } else { self.unprepared.len() }
    }

    fn needed_first(&self) -> usize {
        self.view_shots.first().map_or(0, |shot| shot.views.len() + shot.helpers.len())
    }

    /// Reads the nearest photo that is not prepared, and starts the search for its depth.
    fn prepare(&mut self, near: &Camera) -> Result<()> {
        let far = |&i: &usize| distance(&self.unprepared[i].target, near);
        let nearest = (0..self.unprepared.len()).min_by(|a, b| far(a).total_cmp(&far(b)));
        let Some(nearest) = nearest else { return Ok(()) };
        let mut shot = self.unprepared.swap_remove(nearest);
        self.searched_for = Some(shot.clone());
        // One photo at a time, so that a client that starts to move does not wait long.
        shot.views.truncate(1);
        shot.helpers.clear();
        self.synthesizer.set_layers(self.motion_layers.clone());
        let view = shot.views[0];
        self.load(&shot)?;
        if self.synthesizer.uses_depth() {
            // A failure is reported with the first picture that needs the photo.
            self.start_search(&[view]);
        }
        Ok(())
    }
}

/// Scales of the target's sides, the largest first.
const SCALES: [f64; 3] = [1.0, 0.75, 0.5];
/// Pixels, at most, of the first picture in motion, before any time is known.
const FIRST_PIXELS: f64 = 200_000.0;
/// Number of recent pictures whose median counts: a single one that waits for the depth of a photo changes nothing.
const RECENT_PICTURES: usize = 5;

/// Times of recent pictures: seconds that do not depend on the picture's size (searching the photos' depth), and seconds per pixel.
#[derive(Debug, Default)]
pub(super) struct SizeController {
    recent: VecDeque<(f64, f64)>,
}

impl SizeController {
    /// Records the time of a picture; `fixed`: the part of it that does not depend on the size.
    pub(super) fn record(&mut self, pixels: usize, took: Duration, fixed: Duration) {
        let variable = took.saturating_sub(fixed).as_secs_f64();
        self.recent.push_back((fixed.as_secs_f64(), variable / pixels as f64));
        if self.recent.len() > RECENT_PICTURES {
            self.recent.pop_front();
        }
    }

    /// The largest scale at which a target of `pixels` at full size is expected to fit the budget, else the smallest.
    pub(super) fn scale(&self, pixels: usize) -> f64 {
        let median = |of: fn(&(f64, f64)) -> f64| {
            let mut values: Vec<f64> = self.recent.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(0.0)
        };
        let (fixed, per_pixel) = (median(|times| times.0), median(|times| times.1));
        let fits = |scale: &f64| {
            let pixels = pixels as f64 * scale * scale;
            if self.recent.is_empty() {
                pixels <= FIRST_PIXELS
            } else {
                fixed + per_pixel * pixels <= MOTION_BUDGET.as_secs_f64()
            }
        };
        SCALES.into_iter().find(fits).unwrap_or(SCALES[SCALES.len() - 1])
    }
}

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

    const PIXELS: usize = 10_000;

    fn scale_after(controller: &mut SizeController, pixels: usize, milliseconds: u64, fixed: u64) -> f64 {
        for _ in 0..RECENT_PICTURES {
            controller.record(pixels, Duration::from_millis(milliseconds), Duration::from_millis(fixed));
        }
        controller.scale(PIXELS)
    }

    #[test]
    fn scale_follows_the_median_time() {
        let mut controller = SizeController::default();
        assert_eq!((controller.scale(PIXELS), controller.scale(540 * 960)), (1.0, 0.5));
        for (milliseconds, scale) in [(50, 1.0), (80, 0.75), (150, 0.5), (3000, 0.5), (20, 1.0)] {
            assert_eq!(scale_after(&mut controller, PIXELS, milliseconds, 0), scale, "{milliseconds} ms");
        }
        controller.record(PIXELS, Duration::from_secs(2), Duration::from_secs(1));
        assert_eq!(controller.scale(PIXELS), 1.0);
    }

    #[test]
    fn fixed_time_does_not_scale_with_the_size() {
        // A quarter of the pixels in 25 ms: 100 ms for all of them, or 40 ms where 20 of the 25 are fixed.
        let mut controller = SizeController::default();
        assert_eq!(scale_after(&mut controller, PIXELS / 4, 25, 0), 0.5);
        assert_eq!(scale_after(&mut controller, PIXELS / 4, 25, 20), 1.0);
    }
}

#[cfg(test)]
mod depth_searches_tests {
    use super::*;
    use crate::requests::Task;

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
