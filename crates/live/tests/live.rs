//! Live sessions under each policy, with a network that measures how well the views agree.

use glam::{DMat3, DVec3};
use liveview::geometry::{Camera, Intrinsics};
use liveview::image::ImageRgb;
use liveview::network::{Alpha, NetworkError, PlaneNetwork};
use liveview::render::Renderer;
use liveview_live::session::{LayerSource, LiveError, LiveFrame, LiveSession, LiveSettings, Policy};
use liveview_synthesizer::LayerSpec;
use liveview_synthesizer::psnr;
use ndarray::{ArrayView4, ArrayViewMut4};

const SIZE: (usize, usize) = (384, 256);

/// A network for that many views: opaque where they agree, with the nearest view's colour.
struct Agreement(usize);

impl PlaneNetwork for Agreement {
    fn views(&self) -> usize {
        self.0
    }

    fn infer(
        &mut self,
        hwv: ArrayView4<'_, f32>,
        _coverage: ArrayView4<'_, f32>,
        mut logits: ArrayViewMut4<'_, f32>,
    ) -> Result<(), NetworkError> {
        for ((n, v, y, x), logit) in logits.indexed_iter_mut() {
            let difference = (3..3 * self.0).map(|c| (hwv[[n, c, y, x]] - hwv[[n, c % 3, y, x]]).abs()).sum::<f32>();
            *logit = if v == 0 { 4.0 - 40.0 * difference } else { -4.0 };
        }
        Ok(())
    }
}

/// A scene that consists of a wall and a board in front of it.
#[derive(Clone, Copy)]
struct Stage {
    /// Depth of the wall.
    wall: f64,
    /// Phase of the colour patterns on wall and board.
    phase: f64,
    /// x coordinate of the board's left edge. The board's depth is 3, its width and height 1.
    board: Option<f64>,
}

const EMPTY: Stage = Stage { wall: 6.0, phase: 0.0, board: None };

impl Stage {
    fn photo(&self, camera: &Camera) -> ImageRgb {
        let (eye, to_ray) = (camera.centre(), camera.k_inverse());
        let colour = |point: DVec3, scale: f64| {
            let wave = |f: f64, g: f64| {
                let wave = (scale * f * point.x + self.phase).sin() * (scale * g * point.y + 2.0 * self.phase).cos();
                (0.5 + 0.25 * wave + 0.2 * (scale * 9.0 * (point.x + g * point.y) + self.phase).sin()) as f32
            };
            [wave(2.0, 3.0), wave(4.0, 1.5), wave(3.0, 5.0)]
        };
        let pixel = |index: usize| {
            let (x, y) = ((index % SIZE.0) as f64 + 0.5, (index / SIZE.0) as f64 + 0.5);
            let ray = camera.rotation().transpose() * (to_ray * DVec3::new(x, y, 1.0));
            let at = |depth: f64| eye + (depth - eye.z) / ray.z * ray;
            let on_board = |point: DVec3, left: f64| (left..left + 1.0).contains(&point.x) && point.y.abs() < 0.5;
            match self.board.filter(|&left| on_board(at(3.0), left)) {
                Some(left) => colour(at(3.0) - DVec3::X * left, 2.0),
                None => colour(at(self.wall), 1.0),
            }
        };
        ImageRgb::new(SIZE.0, SIZE.1, (0..SIZE.0 * SIZE.1).flat_map(pixel).collect()).unwrap()
    }

    fn photos(&self) -> Vec<ImageRgb> {
        rig().iter().map(|camera| self.photo(camera)).collect()
    }
}

fn camera(x: f64, y: f64) -> Camera {
    let k = Intrinsics { fx: 150.0, fy: 150.0, cx: 192.0, cy: 128.0, skew: 0.0 };
    Camera::new(k, SIZE.0, SIZE.1, DMat3::IDENTITY, -DVec3::new(x, y, 0.0)).unwrap()
}

fn rig() -> Vec<Camera> {
    [(-0.2, 0.1), (0.0, -0.2), (0.2, 0.1), (0.1, 0.15), (0.5, 0.0)].map(|(x, y)| camera(x, y)).to_vec()
}

fn session_of(layers: LayerSpec, policy: Policy, views: &[usize]) -> LiveSession {
    let mut settings = LiveSettings::new(2.0, 12.0);
    (settings.layers, settings.policy) = (layers, policy);
    let renderers =
        views.iter().map(|&views| Renderer::new(Box::new(Agreement(views)), Alpha::Independent, 1)).collect();
    LiveSession::new(rig(), renderers, settings).unwrap()
}

fn session(policy: Policy) -> LiveSession {
    session_of(LayerSpec::guided(2), policy, &[4])
}

fn show(session: &mut LiveSession, stage: Stage, target: &Camera) -> LiveFrame {
    let photos = stage.photos();
    session.render(&photos.iter().map(Some).collect::<Vec<_>>(), target).unwrap()
}

/// The frame that a session with a full search per frame renders.
fn searched(stage: Stage, target: &Camera) -> LiveFrame {
    show(&mut session(Policy::Each), stage, target)
}

fn score(frame: &LiveFrame, stage: Stage, target: &Camera) -> f64 {
    psnr(frame.frame.raw(), &stage.photo(target), 16)
}

#[test]
fn unchanged_scene_gives_the_same_bits() {
    let (mut propagated, target) = (session(Policy::Propagate), camera(0.05, 0.0));
    let first = show(&mut propagated, EMPTY, &target);
    let second = show(&mut propagated, EMPTY, &target);
    assert_eq!(
        (first.layer_source, second.layer_source),
        (LayerSource::Searched, LayerSource::Propagated { refreshed: 0.0 })
    );
    assert_eq!(first.frame.raw().data(), second.frame.raw().data());
    assert_eq!(searched(EMPTY, &target).frame.raw().data(), second.frame.raw().data());
}

#[test]
fn moving_target_propagates_the_surface() {
    let stage = Stage { board: Some(-0.5), ..EMPTY };
    let mut propagated = session(Policy::Propagate);
    let mut full_searches = 0;
    for step in 0..8 {
        let target = camera(-0.1 + 0.02 * f64::from(step), 0.0);
        let frame = show(&mut propagated, stage, &target);
        full_searches += usize::from(frame.layer_source == LayerSource::Searched);
        let (own, best) = (score(&frame, stage, &target), score(&searched(stage, &target), stage, &target));
        assert!(own > best - 0.5, "step {step}: {own:.2} dB, {best:.2} dB if searched");
    }
    assert_eq!(full_searches, 1, "only the first frame is searched");
}

#[test]
fn scene_cut_is_searched_in_the_same_frame() {
    let (mut propagated, target) = (session(Policy::Propagate), camera(0.05, 0.0));
    show(&mut propagated, EMPTY, &target);
    let cut = Stage { wall: 3.0, phase: 2.0, board: None };
    let frame = show(&mut propagated, cut, &target);
    assert_eq!(frame.layer_source, LayerSource::Searched);
    assert_eq!(frame.frame.raw().data(), searched(cut, &target).frame.raw().data());
    // Without a search, the propagated surface does not fit the new scene.
    let mut unsearched = session(Policy::Once);
    show(&mut unsearched, EMPTY, &target);
    let unsearched = show(&mut unsearched, cut, &target);
    assert_eq!(unsearched.layer_source, LayerSource::Propagated { refreshed: 0.0 });
    assert!(score(&frame, cut, &target) > score(&unsearched, cut, &target) + 3.0);
}

#[test]
fn entering_object_is_searched_in_its_region_only() {
    let (mut propagated, target) = (session(Policy::Propagate), camera(0.05, 0.0));
    show(&mut propagated, EMPTY, &target);
    for left in [0.2, 0.1, 0.0] {
        let stage = Stage { board: Some(left), ..EMPTY };
        let frame = show(&mut propagated, stage, &target);
        let LayerSource::Propagated { refreshed } = frame.layer_source else { panic!("{:?}", frame.layer_source) };
        assert!(refreshed > 0.0 && refreshed < 0.4, "{refreshed}");
        let (own, best) = (score(&frame, stage, &target), score(&searched(stage, &target), stage, &target));
        assert!(own > best - 0.5, "board at {left}: {own:.2} dB, {best:.2} dB if searched");
    }
    let away = show(&mut propagated, EMPTY, &target);
    assert!(score(&away, EMPTY, &target) > score(&searched(EMPTY, &target), EMPTY, &target) - 0.3);
}

#[test]
fn paper_layers_select_their_planes_on_the_first_frame() {
    let (mut paper, target) = (session_of(LayerSpec::PAPER, Policy::Once, &[4]), camera(0.05, 0.0));
    let sources = [(); 3].map(|()| {
        let frame = show(&mut paper, EMPTY, &target);
        let best = frame.frame.best_layer.iter().flatten().max().copied();
        (frame.layer_source, best.is_some_and(|best| best >= 16))
    });
    assert_eq!(sources, [(LayerSource::Dense, true), (LayerSource::Selected, false), (LayerSource::Selected, false)]);
}

#[test]
fn age_counts_the_frames_since_the_last_search() {
    let ages = |policy| {
        let mut session = session(policy);
        [(); 3].map(|()| show(&mut session, EMPTY, &camera(0.05, 0.0)).age)
    };
    assert_eq!((ages(Policy::Each), ages(Policy::Once), ages(Policy::Propagate)), ([0; 3], [0, 1, 2], [0, 1, 2]));
}

#[test]
fn missing_camera_is_skipped_and_a_smaller_network_renders_from_fewer() {
    let (mut propagated, target) = (session_of(LayerSpec::guided(2), Policy::Propagate, &[2, 4]), camera(0.05, 0.0));
    let photos = EMPTY.photos();
    let mut render = |missing: &[usize]| {
        let photos: Vec<_> = (0..photos.len()).map(|i| Some(&photos[i]).filter(|_| !missing.contains(&i))).collect();
        propagated.render(&photos, &target)
    };
    let views = render(&[]).unwrap().views;
    assert!(views.len() == 4 && !views.contains(&4), "{views:?}");
    let views = render(&[1]).unwrap().views;
    assert!(views.len() == 4 && views.contains(&4) && !views.contains(&1), "{views:?}");
    assert_eq!(render(&[0, 1]).unwrap().views, [3, 2]);
    let refused = render(&[0, 1, 2, 3]).unwrap_err();
    assert!(matches!(refused, LiveError::Views(_)) && refused.to_string().contains("2 views"), "{refused}");
    assert_eq!(render(&[]).unwrap().views.len(), 4, "the session continues after the error");
}

#[test]
fn photos_that_do_not_match_the_cameras_are_an_error() {
    let mut session = session(Policy::Propagate);
    let small = ImageRgb::new(8, 8, vec![0.5; 192]).unwrap();
    let refused = session.render(&[Some(&small), None, None, None, None], &camera(0.0, 0.0)).unwrap_err();
    assert_eq!(refused.to_string(), "the photo of camera 0 is 8x8; expected 384x256");
    assert!(matches!(session.render(&[None], &camera(0.0, 0.0)), Err(LiveError::Photos(_))));
}

#[test]
fn target_of_another_size_causes_a_full_search() {
    let mut session = session(Policy::Propagate);
    show(&mut session, EMPTY, &camera(0.0, 0.0));
    let half = camera(0.0, 0.0).with_size_scaled(192, 128).unwrap();
    let frame = show(&mut session, EMPTY, &half);
    assert_eq!((frame.layer_source, frame.frame.raw().width()), (LayerSource::Searched, 192));
}

fn surface_session(policy: Policy) -> LiveSession {
    session_of(LayerSpec::Surface(1), policy, &[4])
}

/// The share of a frame's source photos whose depth was searched.
fn share(frame: &LiveFrame) -> f64 {
    match frame.layer_source {
        LayerSource::Searched => 1.0,
        LayerSource::Propagated { refreshed } => refreshed,
        other => panic!("{other}"),
    }
}

const BOARD: Stage = Stage { board: Some(0.2), ..EMPTY };

#[test]
fn unchanged_scene_is_searched_once_for_a_moving_target() {
    let mut propagated = surface_session(Policy::Propagate);
    for step in 0..4 {
        let target = camera(-0.1 + 0.05 * f64::from(step), 0.0);
        let frame = show(&mut propagated, BOARD, &target);
        assert_eq!(share(&frame), if step == 0 { 1.0 } else { 0.0 });
        let anew = show(&mut surface_session(Policy::Propagate), BOARD, &target);
        assert_eq!(frame.frame.raw().data(), anew.frame.raw().data(), "step {step}");
    }
}

#[test]
fn depth_is_searched_only_where_photos_change() {
    let (mut propagated, target) = (surface_session(Policy::Propagate), camera(0.05, 0.0));
    let mut unsearched = surface_session(Policy::Once);
    show(&mut propagated, EMPTY, &target);
    show(&mut unsearched, EMPTY, &target);
    for left in [0.2, 0.1, 0.0] {
        let stage = Stage { board: Some(left), ..EMPTY };
        let frame = show(&mut propagated, stage, &target);
        assert!(share(&frame) > 0.0 && share(&frame) < 0.5, "{}", share(&frame));
        let best = show(&mut surface_session(Policy::Propagate), stage, &target);
        let (own, best) = (score(&frame, stage, &target), score(&best, stage, &target));
        assert!(own > best - 0.3, "board at {left}: {own:.2} dB, {best:.2} dB if all of it is searched");
        let outdated = show(&mut unsearched, stage, &target);
        assert!(share(&outdated) == 0.0 && score(&outdated, stage, &target) < own - 1.0, "depth of the first frame");
    }
}

#[test]
fn depth_is_searched_as_often_as_the_policy_sets() {
    let target = camera(0.05, 0.0);
    for (policy, expected) in [(Policy::Each, [1.0, 1.0, 1.0, 1.0]), (Policy::Once, [1.0, 0.0, 0.0, 0.0])] {
        let mut session = surface_session(policy);
        let shares = [0.2, 0.1, 0.0, -0.1].map(|left| {
            let stage = Stage { board: Some(left), ..EMPTY };
            share(&show(&mut session, stage, &target))
        });
        assert_eq!(shares, expected, "{policy}");
    }
}

#[test]
fn missing_camera_is_skipped_and_a_joining_camera_is_searched() {
    let (mut propagated, target) = (surface_session(Policy::Propagate), camera(0.05, 0.0));
    let photos = BOARD.photos();
    let mut render = |missing: &[usize]| {
        let photos: Vec<_> = (0..photos.len()).map(|i| Some(&photos[i]).filter(|_| !missing.contains(&i))).collect();
        propagated.render(&photos, &target).unwrap()
    };
    assert_eq!(share(&render(&[4])), 1.0);
    assert_eq!(share(&render(&[])), 0.0, "a camera that is not among the nearest four");
    let without = render(&[1]);
    assert!(share(&without) == 0.25 && !without.views.contains(&1), "one of four: {without:?}");
    assert!(score(&without, BOARD, &target) > 20.0);
    assert_eq!(share(&render(&[])), 0.0, "the camera is back with the same photo, whose depth is cached");
}

#[test]
fn surface_layers_do_not_depend_on_the_number_of_threads() {
    let target = camera(0.05, 0.0);
    let pictures = [1, 2, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut session = surface_session(Policy::Propagate);
            let frames =
                [None, Some(0.2), Some(0.0)].map(|board| show(&mut session, Stage { board, ..EMPTY }, &target));
            frames.map(|frame| frame.frame.raw().data().to_vec())
        })
    });
    assert!(pictures[0] == pictures[1] && pictures[0] == pictures[2]);
}
