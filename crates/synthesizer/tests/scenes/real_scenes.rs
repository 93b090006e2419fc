//! Real scenes from the folder `LIVEVIEW_DATA`, by default `../shared/data`. These tests are
//! ignored unless requested, because the scenes are not part of the repository; `make test` runs
//! them if the folder exists.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use liveview::geometry::{middle_camera, source_from_target};
use liveview::image::ImageRgb;
use liveview_scene::{Format, Scene, SceneOptions};
use liveview_synthesizer::SceneViews;

fn data() -> PathBuf {
    let folder = std::env::var_os("LIVEVIEW_DATA").map(PathBuf::from);
    folder.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"))
}

/// Scene, format, number of views, whether the views have depth ranges.
const SCENES: &[(&str, Format, usize, bool)] = &[
    ("dev/grid3x3", Format::Colmap, 9, true),
    ("dev/llff_flower", Format::Llff, 34, true),
    ("dev/coffee_5cam", Format::Llff, 5, true),
    ("train/office_table", Format::Llff, 64, true),
    ("dev/strecha_fountain-P11", Format::Transforms, 11, false),
    ("train/strecha_castle-P30", Format::Transforms, 30, false),
    ("train/strecha_entry-P10", Format::Transforms, 10, false),
    ("train/sevenscenes_kitchen", Format::Transforms, 125, false),
    ("train/fox", Format::Transforms, 50, false),
    ("dev/realestate10k/6b658b1d8562dc85", Format::RealEstate10k, 8, false),
    ("dev/realestate10k/bcbfc12f1cc350c0", Format::RealEstate10k, 14, false),
];

#[test]
#[ignore = "needs the real scenes"]
fn all_scenes_open_and_load() {
    let data = data();
    for &(name, format, count, has_range) in SCENES {
        let options = SceneOptions { width: Some(160), ..SceneOptions::default() };
        let scene = Scene::open(&data.join(name), &options).unwrap();
        println!("{name}: {} views, {:?}", scene.views.len(), scene.notes);
        assert_eq!((scene.format, scene.views.len()), (format, count), "{name}");
        assert!(scene.views.iter().all(|view| view.depth_range.is_some() == has_range), "{name}");
        assert!(scene.views.is_sorted_by(|a, b| a.name < b.name), "{name}");
        let image = scene.load_image(0).unwrap();
        let camera = &scene.views[0].camera;
        assert_eq!((image.width(), image.height()), (camera.width(), camera.height()), "{name}");
        assert!(image.data().iter().all(|v| (0.0..=1.0).contains(v)), "{name}");
    }
}

/// Adds the scenes in a folder and its subfolders.
fn scenes_in(folder: &Path, found: &mut Vec<PathBuf>) {
    if ["transforms.json", "poses_bounds.npy", "cameras.txt", "sparse"].iter().any(|name| folder.join(name).exists()) {
        found.push(folder.to_owned());
        return;
    }
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| path.is_dir()).for_each(|path| scenes_in(&path, found));
}

#[test]
#[ignore = "needs the real scenes"]
fn no_scene_needs_an_option() {
    let mut scenes = Vec::new();
    scenes_in(&data(), &mut scenes);
    assert!(scenes.len() >= SCENES.len(), "{scenes:?}");
    for path in &scenes {
        let views = SceneViews::new(Scene::open(path, &SceneOptions::default()).unwrap(), None, None);
        let target = middle_camera(&views.all_cameras());
        let camera = views.scene().views[target].camera.clone();
        let chosen = views.choose("middle", &camera, &[target], 4, &[]).unwrap();
        let (near, far) = views.depth_range(&chosen, &[target]).unwrap();
        println!("{}: {near} to {far}", path.display());
    }
}

#[test]
#[ignore = "needs the real scenes"]
fn colmap_reprojection_error_is_below_a_pixel() {
    let data = data();
    let scene = Scene::open(&data.join("dev/grid3x3"), &SceneOptions::default()).unwrap();
    let median = scene.reprojection_error.unwrap();
    assert!(median < 1.0, "{median}");
}

/// Checks that poses, axes and intrinsics are consistent: a plane sweep between neighbouring views
/// finds matches, and far fewer with the relative pose inverted.
#[test]
#[ignore = "needs the real scenes"]
fn neighbouring_views_match_along_epipolar_lines() {
    let data = data();
    for &(name, ..) in SCENES {
        let options = SceneOptions { width: Some(320), ..SceneOptions::default() };
        let scene = Scene::open(&data.join(name), &options).unwrap();
        let target = scene.views.len() / 2;
        let distance = |&i: &usize| (scene.views[i].camera.centre() - scene.views[target].camera.centre()).length();
        let source =
            (0..scene.views.len()).filter(|&i| i != target).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
        let (share, inverted) = (matches(&scene, source, target, false), matches(&scene, source, target, true));
        println!("{name}: {:.0} % of patches match, {:.0} % with the pose inverted", 100.0 * share, 100.0 * inverted);
        assert!(share > 0.5 && share > inverted + 0.2, "{name}: {share} {inverted}");
    }
}

/// Share of textured target patches that correlate above 0.9 with the source at some depth.
fn matches(scene: &Scene, source: usize, target: usize, invert: bool) -> f64 {
    let (target_image, source_image) = (scene.load_image(target).unwrap(), scene.load_image(source).unwrap());
    let (target, source) = (&scene.views[target].camera, &scene.views[source].camera);
    let mut pose = source_from_target(source, target);
    if invert {
        pose = source_from_target(target, source);
    }
    let infinite = source.k() * pose.rotation * target.k_inverse();
    let epipole = source.k() * pose.translation;
    // Up to 200 pixels of disparity at the focal length of the target.
    let step = 0.5 / (target.intrinsics().fx * pose.translation.length());
    let (mut textured, mut matched) = (0, 0);
    for y in (8..target.height() - 8).step_by(16) {
        for x in (8..target.width() - 8).step_by(16) {
            let Some(patch) = normalised(|dx, dy| grey(&target_image, x as f64 + dx + 0.5, y as f64 + dy + 0.5)) else {
                continue;
            };
            textured += 1;
            let best = (0..400)
                .filter_map(|k| correlation(&source_image, &infinite, epipole * (f64::from(k) * step), (x, y), &patch))
                .fold(-1.0, f64::max);
            matched += usize::from(best > 0.9);
        }
    }
    matched as f64 / f64::from(textured)
}

fn correlation(
    image: &ImageRgb,
    infinite: &DMat3,
    shift: DVec3,
    (x, y): (usize, usize),
    patch: &[f64; 49],
) -> Option<f64> {
    let found = normalised(|dx, dy| {
        let p = *infinite * DVec3::new(x as f64 + dx + 0.5, y as f64 + dy + 0.5, 1.0) + shift;
        (p.z > 0.0).then(|| grey(image, p.x / p.z, p.y / p.z)).flatten()
    })?;
    Some(found.iter().zip(patch).map(|(a, b)| a * b).sum())
}

/// A 7×7 patch with mean 0 and norm 1, if it is inside the image and textured.
fn normalised(sample: impl Fn(f64, f64) -> Option<f64>) -> Option<[f64; 49]> {
    let mut patch = [0.0; 49];
    for (i, value) in patch.iter_mut().enumerate() {
        *value = sample((i % 7) as f64 - 3.0, (i / 7) as f64 - 3.0)?;
    }
    let mean = patch.iter().sum::<f64>() / 49.0;
    let length = patch.iter().map(|v| (v - mean).powi(2)).sum::<f64>().sqrt();
    (length > 0.3).then(|| patch.map(|v| (v - mean) / length))
}

/// Bilinear grey value at pixel coordinates (centres at .5), if inside the image.
fn grey(image: &ImageRgb, u: f64, v: f64) -> Option<f64> {
    let (u, v) = (u - 0.5, v - 0.5);
    let inside = u >= 0.0 && v >= 0.0 && u < (image.width() - 1) as f64 && v < (image.height() - 1) as f64;
    inside.then(|| {
        let at = |x: usize, y: usize| f64::from(image.pixel(x, y).iter().sum::<f32>()) / 3.0;
        let (x, y, a, b) = (u as usize, v as usize, u.fract(), v.fract());
        let upper = at(x, y) * (1.0 - a) + at(x + 1, y) * a;
        let lower = at(x, y + 1) * (1.0 - a) + at(x + 1, y + 1) * a;
        upper * (1.0 - b) + lower * b
    })
}
