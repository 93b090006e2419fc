//! The synthesizer with each kind of layers, each kind of target, and its errors. The network
//! measures how well the views agree.

use std::collections::HashSet;
use std::path::Path;

use liveview::network::{Alpha, NetworkError, PlaneNetwork};
use liveview::render::Renderer;
use liveview_synthesizer::{
    DepthSource, LayerSpec, Options, Scene, SceneOptions, ScenePhotos, SceneViews, Score, SynthesisError, Synthesizer,
    Target, Targets, ViewAgreement, guessed, psnr,
};
use ndarray::{ArrayView4, ArrayViewMut4};

const WORKSHOP: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/scenes/workshop");

/// Opaque where the views agree.
struct Agreement;

impl PlaneNetwork for Agreement {
    fn views(&self) -> usize {
        4
    }

    fn infer(
        &mut self,
        hwv: ArrayView4<'_, f32>,
        _: ArrayView4<'_, f32>,
        mut logits: ArrayViewMut4<'_, f32>,
    ) -> Result<(), NetworkError> {
        for ((n, v, y, x), logit) in logits.indexed_iter_mut() {
            let difference = (3..12).map(|c| (hwv[[n, c, y, x]] - hwv[[n, c % 3, y, x]]).abs()).sum::<f32>();
            *logit = if v == 0 { 4.0 - 8.0 * difference } else { 0.0 };
        }
        Ok(())
    }
}

fn workshop() -> Scene {
    let options = SceneOptions { width: Some(96), ..SceneOptions::default() };
    Scene::open(Path::new(WORKSHOP), &options).unwrap()
}

fn synthesizer(layers: &str) -> Synthesizer {
    let views = SceneViews::new(workshop(), None, None);
    Synthesizer::new(views, Renderer::new(Box::new(Agreement), Alpha::Independent, 1), layers.parse().unwrap())
}

#[test]
fn every_kind_of_layers_renders_the_held_out_view() {
    let scene = workshop();
    let truth = scene.load_image(scene.view_index("target_0").unwrap()).unwrap();
    let neighbours = (0..7).map(|view| scene.view_index(&format!("source_{view}")).unwrap());
    let neighbours = neighbours.map(|view| psnr(&scene.load_image(view).unwrap(), &truth, 8));
    let nearest = neighbours.fold(0.0, f64::max);
    for (layers, count) in [
        ("planes:24", 24),
        ("guided:3", 3),
        ("guided:2/16", 2),
        ("surface:1", 1),
        ("surface:2", 2),
        ("select:12/24", 12),
        ("list:0.7,0.5,0.4,0.3,0.25,0.2,0.15", 7),
    ] {
        let mut synthesizer = synthesizer(layers);
        let frame = synthesizer.render(&Target::held_out("target_0")).unwrap();
        let own = psnr(frame.raw(), &truth, 8);
        println!("{layers}: {own:.1} dB, the most similar photo {nearest:.1} dB");
        assert!(own > nearest + 6.0, "{layers}: {own:.1} dB, the most similar photo {nearest:.1} dB");

        // Loading, planning and rendering one after the other gives the same picture.
        let shot = synthesizer
            .shots(Targets::held_out(&scene, vec![scene.view_index("target_0").unwrap()]))
            .unwrap()
            .remove(0);
        let loaded = synthesizer.load(&shot, &[]).unwrap();
        let plan = synthesizer.plan(&loaded).unwrap();
        assert_eq!(plan.layers.len(), count, "{layers}");
        assert_eq!(plan.range.is_some(), matches!(synthesizer.layers(), LayerSpec::Guided { .. }), "{layers}");
        assert_eq!(plan.surface.is_some(), matches!(synthesizer.layers(), LayerSpec::Surface(_)), "{layers}");
        let again = synthesizer.render_plan(&loaded, &plan, None).unwrap();
        assert_eq!(frame.raw(), again.raw(), "{layers}");
    }
}

#[test]
fn held_out_view_is_not_rendered_from_but_other_views_may_be_targets() {
    let mut synthesizer = synthesizer("guided:2");
    let scene = workshop();
    let view = scene.view_index("source_3").unwrap();
    let shots = |targets| synthesizer.shots(targets).unwrap();
    assert!(!shots(Targets::held_out(&scene, vec![view])).remove(0).views.contains(&view));
    let camera = scene.views[view].camera.clone();
    assert_eq!(shots(Targets::cameras(vec![camera.clone()])).remove(0).views[0], view, "the nearest view is itself");
    let frame = synthesizer.render(&Target::Camera(camera)).unwrap();
    assert!(psnr(frame.raw(), &scene.load_image(view).unwrap(), 8) > 40.0);
}

/// The depth of photos must not depend on held-out photos: replacing a held-out photo does not
/// change the picture.
#[test]
fn depth_of_photos_does_not_depend_on_held_out_photos() {
    let folder = tempfile::tempdir().unwrap();
    let copy = |from: &Path, to: &Path| {
        std::fs::create_dir_all(to).unwrap();
        for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap).filter(|entry| entry.path().is_file()) {
            std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
        }
    };
    for part in ["images", "sparse/0"] {
        copy(&Path::new(WORKSHOP).join(part), &folder.path().join(part));
    }
    let options = SceneOptions { width: Some(96), ..SceneOptions::default() };
    let picture = |scene: Scene| {
        let views = SceneViews::new(scene, None, None);
        let mut synthesizer =
            Synthesizer::new(views, Renderer::new(Box::new(Agreement), Alpha::Independent, 1), LayerSpec::Surface(2));
        synthesizer.render(&Target::held_out("target_0")).unwrap().raw().clone()
    };
    let with = picture(Scene::open(folder.path(), &options).unwrap());
    // The black photo has the same size, so the scene still lists it.
    let photo = folder.path().join("images/target_0.jpg");
    let size = liveview::image::read_size(&photo).unwrap();
    liveview::ImageRgb::new(size.width, size.height, vec![0.0; 3 * size.pixels()]).unwrap().save(&photo).unwrap();
    assert_eq!(with, picture(Scene::open(folder.path(), &options).unwrap()));
}

/// A path searches the depth of each photo once. Its frames equal frames rendered alone.
#[test]
fn frames_of_a_path_equal_frames_rendered_alone() {
    let mut along = synthesizer("surface:1");
    let targets = Targets::path(along.scene(), "line:4".parse().unwrap()).unwrap();
    let shots = along.shots(targets.clone()).unwrap();
    assert!(shots.iter().all(|shot| shot.helpers.len() == 2 && shot.helpers.iter().all(|h| !shot.views.contains(h))));
    let mut pictures = Vec::new();
    pictures.extend(along.frames(targets).unwrap().map(|frame| frame.unwrap().1.raw().clone()));
    for (shot, picture) in shots.iter().zip(&pictures) {
        let mut alone = synthesizer("surface:1");
        let loaded = alone.load(shot, &[]).unwrap();
        let plan = alone.plan(&loaded).unwrap();
        assert!(alone.render_plan(&loaded, &plan, None).unwrap().raw().clone() == *picture, "{}", shot.name);
    }
}

/// Depth cached by an earlier run gives the same pictures. Depth that held-out photos would have
/// influenced is not reused.
#[test]
fn cached_depth_gives_the_same_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("cache");
    let files = || std::fs::read_dir(&cache).unwrap().map(|entry| entry.unwrap().file_name()).collect::<HashSet<_>>();
    let picture = |name: &str| {
        let mut synthesizer = synthesizer("surface:2");
        synthesizer.photos_mut().keep_depths_in(&cache).unwrap();
        let picture = synthesizer.render(&Target::held_out(name)).unwrap().raw().clone();
        assert_eq!(synthesizer.photos_mut().take_notes(), Vec::<String>::new());
        picture
    };
    let plain = synthesizer("surface:2").render(&Target::held_out("target_0")).unwrap().raw().clone();
    assert!(picture("target_0") == plain);
    let first = files();
    assert_eq!(first.len(), 6, "the four source views and two helpers");
    assert!(picture("target_0") == plain);
    assert_eq!(files(), first, "nothing is searched again");
    let source = workshop().view_index("target_0").unwrap();
    let mut photos = ScenePhotos::new(SceneViews::new(workshop(), None, None));
    photos.keep_depths_in(&cache).unwrap();
    let views: Vec<usize> = (0..workshop().views.len()).filter(|&view| view != source).collect();
    let mut sources = Vec::new();
    for (index, &view) in views.iter().enumerate() {
        sources.push(photos.view_depth(view, &[source], &views[index + 1..], false).unwrap().source);
    }
    assert_eq!(sources.iter().filter(|&&source| source == DepthSource::Kept).count(), 6);
    // With another view held out, each photo has other neighbours or another depth range.
    let held_out_target_0 = files();
    picture("target_1");
    assert_eq!(files().len(), held_out_target_0.len() + 6, "no file of the first run is reused");

    let taken = folder.path().join("file");
    std::fs::write(&taken, "").unwrap();
    let refused = ScenePhotos::new(SceneViews::new(workshop(), None, None)).keep_depths_in(&taken).unwrap_err();
    assert!(matches!(refused, SynthesisError::Cache { .. }) && refused.to_string().contains("file: "), "{refused}");
    let options = Options { cache: Some(taken), ..Options::default() };
    let refused = Synthesizer::open(WORKSHOP, &options).unwrap_err();
    assert!(matches!(refused, SynthesisError::Cache { .. }), "{refused}");
}

#[test]
fn frames_of_a_path_share_one_depth_range() {
    let mut synthesizer = synthesizer("guided:1");
    let targets = Targets::path(synthesizer.scene(), "line:5".parse().unwrap()).unwrap();
    let shots = synthesizer.shots(targets.clone()).unwrap();
    assert!(shots.iter().all(|shot| (shot.near, shot.far) == (shots[0].near, shots[0].far)));
    let mut names = Vec::new();
    names.extend(
        synthesizer
            .frames(targets)
            .unwrap()
            .map(|frame| frame.map(|(shot, frame)| (shot.name, frame.raw().clone())).unwrap()),
    );
    let found: Vec<&str> = names.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(found, ["frame_0000", "frame_0001", "frame_0002", "frame_0003", "frame_0004"]);
    assert!(names.windows(2).all(|pair| pair[0].1 != pair[1].1));
}

#[test]
fn errors_name_view_scene_and_expectation() {
    let unknown = synthesizer("guided:2").render(&Target::held_out("nobody")).unwrap_err();
    assert!(matches!(unknown, SynthesisError::Scene(_)) && unknown.to_string().contains("nobody"), "{unknown}");

    let render = |scene: Scene, near, far| {
        let views = SceneViews::new(scene, near, far);
        Synthesizer::new(views, Renderer::new(Box::new(Agreement), Alpha::Independent, 1), LayerSpec::guided(2))
            .render(&Target::held_out("target_0"))
    };
    let mut few = workshop();
    few.views.retain(|view| {
        !["source_3", "source_4", "source_5", "source_6", "target_1"].iter().any(|name| view.name.starts_with(name))
    });
    let error = render(few, None, None).unwrap_err().to_string();
    assert!(error.contains("target_0") && error.contains("4 views are needed, but only 3 of 3"), "{error}");

    // From cameras in one place no range is found.
    let mut flat = workshop();
    let camera = flat.views[0].camera.clone();
    flat.views.iter_mut().for_each(|view| (view.camera, view.depth_range) = (camera.clone(), None));
    let error = render(flat.clone(), None, Some(9.0)).unwrap_err().to_string();
    assert!(error.contains("workshop") && error.ends_with("expected near, in scene units"), "{error}");
    assert!(render(flat.clone(), Some(1.0), Some(9.0)).is_ok());
    let error = render(flat, Some(3.0), Some(2.0)).unwrap_err().to_string();
    assert!(error.contains("0 < near < far"), "{error}");

    let nowhere = Synthesizer::open("/nonexistent", &Options::default()).unwrap_err();
    assert!(matches!(nowhere, SynthesisError::Scene(_)) && nowhere.to_string().contains("/nonexistent"), "{nowhere}");
    let mut options = Options::default();
    (options.model.views, options.model.folders) = (Some(63), vec!["elsewhere".into()]);
    options.model.network = Some(true);
    let error = Synthesizer::open(WORKSHOP, &options).unwrap_err().to_string();
    assert!(error.contains("liveview_v63.onnx") && error.contains("elsewhere"), "{error}");
}

/// `Agreement`, with that many logits that are not finite.
struct PartlyNonFinite(usize);

impl PlaneNetwork for PartlyNonFinite {
    fn views(&self) -> usize {
        4
    }

    fn infer(
        &mut self,
        hwv: ArrayView4<'_, f32>,
        coverage: ArrayView4<'_, f32>,
        mut logits: ArrayViewMut4<'_, f32>,
    ) -> Result<(), NetworkError> {
        Agreement.infer(hwv, coverage, logits.view_mut())?;
        let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().cycle().take(self.0);
        logits.iter_mut().skip(1000).zip(values).for_each(|(logit, value)| *logit = value);
        Ok(())
    }
}

#[test]
fn few_logits_that_are_not_finite_are_counted_and_more_are_an_error() {
    let render = |non_finite: usize| {
        let views = SceneViews::new(workshop(), None, None);
        let renderer = Renderer::new(Box::new(PartlyNonFinite(non_finite)), Alpha::Independent, 1);
        Synthesizer::new(views, renderer, "guided:1".parse().unwrap()).render(&Target::held_out("target_0"))
    };
    let pixels = 96 * 72; // of the padded target; each has four logits
    let few = pixels * 4 / 10_000;
    let frame = render(few).unwrap();
    assert_eq!(frame.logits_not_finite, few);
    assert!(frame.raw().data().iter().all(|value| value.is_finite()));
    assert!(render(few + 1).unwrap_err().to_string().contains("NaN or infinite"));
}

/// What is guessed of a picture: little of a photo between others, much of a view past all of them.
#[test]
fn guessed_pixels_are_counted_and_explained() {
    let renderer = Renderer::new(Box::new(ViewAgreement { views: 4 }), ViewAgreement::ALPHA, 1);
    let views = SceneViews::new(workshop(), None, None);
    let mut synthesizer = Synthesizer::new(views, renderer, "surface:3".parse().unwrap());
    let view = synthesizer.scene().view_index("target_1").unwrap();
    let (camera, truth) =
        (synthesizer.scene().views[view].camera.clone(), synthesizer.scene().load_image(view).unwrap());
    let mut found = |targets: Targets| {
        let shot = synthesizer.shots(targets).unwrap().remove(0);
        let loaded = synthesizer.load(&shot, &[]).unwrap();
        let plan = synthesizer.plan(&loaded).unwrap();
        let frame = synthesizer.render_plan(&loaded, &plan, None).unwrap();
        let share = plan.surface.as_ref().unwrap().surface.guessed_share();
        (share, guessed::advice(synthesizer.views(), &shot, &plan, &frame), frame)
    };
    let (share, advice, frame) = found(Targets::held_out(&workshop(), vec![view]));
    assert!((0.01..0.15).contains(&share) && advice.is_none(), "{share} {advice:?}");
    assert!(frame.uncovered_share() > 0.0 && Score::of_delivered(&frame, &truth).1 > Some(20.0));

    let turn = glam::DMat3::from_rotation_y(0.5);
    let past = camera.with_pose(turn * camera.rotation(), turn * camera.translation()).unwrap();
    let (share, advice, _) = found(Targets::cameras(vec![past]));
    assert!(share > 0.15 && advice.is_some_and(|advice| advice.contains("too few photos")), "{share}");
}
