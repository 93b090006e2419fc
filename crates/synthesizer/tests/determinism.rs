//! The frame does not depend on the number of threads, the batch size or the run.

#[path = "../../../tests/wheel/mod.rs"]
mod wheel;

use std::path::Path;

use liveview::geometry::{Camera, choose_views};
use liveview::layers::Layers;
use liveview::network::{Alpha, ExecutionProvider, NetworkError, OrtNetwork, PlaneNetwork};
use liveview::render::{Frame, RenderRequest, Renderer};
use liveview::warp::{SourceView, Texture};
use liveview_scene::{Scene, SceneOptions};
use liveview_surface::guided::{GuidedSearch, RangeMap};
use ndarray::{ArrayView4, ArrayViewMut4, Axis};

/// Frames on [0, 1] may differ by this much between thread counts and batch sizes.
const TOLERANCE: f32 = 1e-6;

/// The layers for a guided search's result.
type MakeLayers = fn(&RangeMap) -> Layers;

/// The example scene's first held-out view, and the four views nearest to it.
struct Rig {
    target: Camera,
    views: Vec<(Camera, Texture)>,
}

impl Rig {
    fn open(width: usize) -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/scenes/workshop");
        let options = SceneOptions { width: Some(width), ..SceneOptions::default() };
        let scene = Scene::open(&root, &options).unwrap();
        let held_out = scene.view_index("target_0").unwrap();
        let target = scene.views[held_out].camera.clone();
        let others: Vec<usize> = (0..scene.views.len()).filter(|&view| view != held_out).collect();
        let cameras: Vec<_> = others.iter().map(|&view| &scene.views[view].camera).collect();
        let nearest = choose_views(&cameras, &target, 4, &[]).unwrap().into_iter().map(|i| others[i]);
        let view = |i: usize| (scene.views[i].camera.clone(), Texture::new(&scene.load_image(i).unwrap()));
        Self { target, views: nearest.map(view).collect() }
    }

    /// Renders in a thread pool of that size.
    fn render(&self, renderer: &mut Renderer, threads: usize, layers: MakeLayers) -> Frame {
        let views: Vec<_> = self.views.iter().map(|(camera, texture)| SourceView { camera, texture }).collect();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let pass = GuidedSearch { near: 1.0, far: 8.0, planes: None };
            let range = pass.search(&views, &self.target).unwrap().range;
            renderer.render(RenderRequest::new(&views, &self.target, &layers(&range))).unwrap()
        })
    }
}

/// Renders five guided layers with ONNX Runtime, on that many threads.
fn render(threads: usize, batch: usize) -> Frame {
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/liveview_v4.onnx");
    let network = OrtNetwork::open(&wheel::load(ExecutionProvider::Cpu).unwrap(), &model, threads).unwrap();
    let mut renderer = Renderer::new(Box::new(network), Alpha::Independent, batch);
    Rig::open(200).render(&mut renderer, threads, |range| range.layers(5).unwrap())
}

#[test]
fn frame_with_any_threads_and_batch_size_is_the_same_within_the_tolerance() {
    let first = render(1, 1);
    for (threads, batch) in [(1, 3), (2, 1), (2, 2), (3, 5)] {
        let other = render(threads, batch);
        let difference = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let picture = difference(first.raw().data(), other.raw().data());
        let disparity = difference(first.disparity.as_slice().unwrap(), other.disparity.as_slice().unwrap());
        assert!(picture <= TOLERANCE, "{threads} threads, batch {batch}: pictures differ by {picture:.1e}");
        assert!(disparity <= TOLERANCE, "{threads} threads, batch {batch}: disparities differ by {disparity:.1e}");
    }
}

#[test]
fn frame_rendered_twice_has_the_same_bits() {
    let (first, second) = (render(2, 2), render(2, 2));
    assert_eq!(first.raw().data(), second.raw().data());
    assert_eq!(first.disparity, second.disparity);
    assert_eq!(first.best_layer, second.best_layer);
}

/// Logits are differences of two inputs, with the same bits for any batch size.
struct Difference;

impl PlaneNetwork for Difference {
    fn views(&self) -> usize {
        4
    }

    fn infer(
        &mut self,
        hwv: ArrayView4<'_, f32>,
        _coverage: ArrayView4<'_, f32>,
        mut logits: ArrayViewMut4<'_, f32>,
    ) -> Result<(), NetworkError> {
        for (view, mut logits) in logits.axis_iter_mut(Axis(1)).enumerate() {
            logits.assign(&(&hwv.index_axis(Axis(1), 3 * view) - &hwv.index_axis(Axis(1), 1)));
        }
        Ok(())
    }
}

#[test]
fn native_stages_any_threads_and_batch_size_give_the_same_bits() {
    // The rows are long enough to be processed in several runs of pixels. Each renderer is reused
    // for another size and other layers; no view covers the nearest of these.
    let jobs: [(Rig, MakeLayers); 2] = [
        (Rig::open(200), |range| range.layers(5).unwrap()),
        (Rig::open(136), |_| Layers::uniform(0.05, 8.0, 12).unwrap()),
    ];
    let frame = |renderer: &mut Renderer, threads: usize, job: usize| {
        let (rig, layers) = &jobs[job];
        let frame = rig.render(renderer, threads, *layers);
        (frame.raw().clone(), frame.disparity, frame.transmittance, frame.best_layer, frame.uncovered_layers)
    };
    let first = [0, 1].map(|job| frame(&mut Renderer::new(Box::new(Difference), Alpha::Independent, 1), 1, job));
    assert!((1..12).contains(&first[1].4), "{} layers uncovered", first[1].4);
    let mut renderers: Vec<_> =
        (0..10).map(|i| (1 + i % 2, Renderer::new(Box::new(Difference), Alpha::Independent, 1 + i / 2))).collect();
    for run in 0..100 {
        let (job, (threads, renderer)) = (run / 10 % 2, &mut renderers[run % 10]);
        assert!(frame(renderer, *threads, job) == first[job], "run {run}");
    }
}

#[test]
fn competing_layers_any_threads_and_batch_size_give_the_same_bits() {
    let rig = Rig::open(136);
    let frame = |threads: usize, batch: usize| {
        let mut renderer = Renderer::new(Box::new(Difference), Alpha::Competing { scale: 2.0 }, batch);
        let frame = rig.render(&mut renderer, threads, |_| Layers::uniform(0.05, 8.0, 12).unwrap());
        (frame.raw().clone(), frame.disparity, frame.transmittance, frame.best_layer, frame.uncovered_layers)
    };
    let first = frame(1, 1);
    assert!(first.4 > 0, "no layer uncovered");
    for (threads, batch) in [(2, 1), (1, 3), (2, 12)] {
        assert!(frame(threads, batch) == first, "{threads} threads, batch {batch}");
    }
}
