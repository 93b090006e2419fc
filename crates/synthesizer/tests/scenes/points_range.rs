//! The depth range of a `transforms.json` that has points.

use std::path::Path;

use liveview_synthesizer::Scene;
use tempfile::tempdir;

use crate::scene_common::{Colmap, TWO_PHOTOS, assert_says, notes, open, picture, write};

/// A `transforms.json` with the poses of a [`Colmap`] model of these photos, in a world that is turned,
/// shifted and enlarged by `scale`.
fn transforms(root: &Path, scale: f64, fields: &str, names: &[&str]) {
    let frames = names.iter().enumerate().map(|(i, name)| {
        let [w, _, y, _, x, down, z] = Colmap::pose(i);
        let (sin, cos) = (2.0 * w * y, w * w - y * y);
        // World from camera; the world's y is up, and its origin is elsewhere.
        let centre = [-(cos * x - sin * z), -down, -(sin * x + cos * z)].map(|side| scale * side);
        let [a, b, c] = [5.0 + centre[0], -centre[1], -centre[2]];
        format!(
            "{{\"file_path\": \"images/{name}\", \"transform_matrix\": \
             [[{cos}, 0, {sin}, {a}], [0, 1, 0, {b}], [{}, 0, {cos}, {c}], [0, 0, 0, 1]]}}",
            -sin
        )
    });
    let frames = frames.collect::<Vec<_>>().join(",\n");
    let head = "\"fl_x\": 50, \"fl_y\": 60, \"cx\": 30, \"cy\": 25, \"w\": 64, \"h\": 48";
    write(&root.join("transforms.json"), format!("{{{head}, {fields} \"frames\": [\n{frames}\n]}}"));
    names.iter().for_each(|name| picture(&root.join("images").join(name), 64, 48));
}

fn ranges(scene: &Scene) -> Vec<Option<(f64, f64)>> {
    scene.views.iter().map(|view| view.depth_range).collect()
}

/// Twenty points straight ahead of the views at depths 4 to 23, and some that none sees.
fn ply() -> String {
    let seen = (0..20).map(|i| format!("5.1 -0.2 {}\n", -4 - i));
    let unseen = (0..5).map(|i| format!("5 0 {}\n900 0 -{}\n", 10 + i, 100 + i));
    let points: String = seen.chain(unseen).collect();
    let head = "ply\nformat ascii 1.0\nelement vertex 30\nproperty float x\nproperty float y\nproperty float z\n";
    format!("{head}end_header\n{points}")
}

#[test]
fn points_of_ply_file_path_give_the_depth_range() {
    let root = tempdir().unwrap();
    transforms(root.path(), 1.0, "\"ply_file_path\": \"sparse_pc.ply\",", TWO_PHOTOS.names);
    write(&root.path().join("sparse_pc.ply"), ply());
    let scene = open(root.path()).unwrap();
    let (near, far) = ranges(&scene)[0].unwrap();
    // Percentiles 1 and 99 of 4 … 23 lie at ranks 0.19 and 18.81.
    assert!((near - 0.9 * 4.19).abs() < 1e-9 && (far - 1.1 * 22.81).abs() < 1e-9, "{near} {far}");
    assert_says(&notes(&scene), &["depth range from the points of sparse_pc.ply"]);
    transforms(root.path(), 1.0, "\"near\": 1, \"far\": 2, \"ply_file_path\": \"sparse_pc.ply\",", TWO_PHOTOS.names);
    assert_eq!(ranges(&open(root.path()).unwrap()), [Some((1.0, 2.0)); 2]);
}

#[test]
fn points_that_cannot_be_used_are_noted() {
    let root = tempdir().unwrap();
    for (path, contents, says) in [
        ("sparse_pc.ply", "ply\n", "sparse_pc.ply: its points are not used for the depth range: no end_header"),
        ("sparse_pc.ply", &ply().replace(" -", " "), "no view sees enough of them"),
        ("other.ply", "", "sparse_pc.ply: cannot be read"),
        ("../sparse_pc.ply", "", "leaves the scene folder"),
    ] {
        let listed = if path.starts_with("..") { path } else { "sparse_pc.ply" };
        transforms(root.path(), 1.0, &format!("\"ply_file_path\": \"{listed}\","), TWO_PHOTOS.names);
        let _ = std::fs::remove_file(root.path().join("sparse_pc.ply"));
        if !path.starts_with("..") {
            write(&root.path().join(path), contents);
        }
        let scene = open(root.path()).unwrap();
        assert_eq!(ranges(&scene), [None; 2], "{path}");
        assert_says(&notes(&scene), &[says]);
    }
}

#[test]
fn points_of_the_colmap_model_beside_it_give_the_depth_range() {
    let (model, root) = (tempdir().unwrap(), tempdir().unwrap());
    TWO_PHOTOS.write_binary(&model.path().join("sparse/0"));
    TWO_PHOTOS.names.iter().for_each(|name| picture(&model.path().join("images").join(name), 64, 48));
    let expected = ranges(&open(model.path()).unwrap());
    TWO_PHOTOS.write_binary(&root.path().join("colmap/sparse/0"));
    for scale in [1.0, 0.25] {
        // A file that cannot be used does not stand in the way of the model.
        transforms(root.path(), scale, "\"ply_file_path\": \"sparse_pc.ply\",", TWO_PHOTOS.names);
        let scene = open(root.path()).unwrap();
        for (found, expected) in ranges(&scene).into_iter().zip(&expected) {
            let ((near, far), expected) = (found.unwrap(), expected.unwrap());
            let apart = (near - scale * expected.0).abs().max((far - scale * expected.1).abs());
            assert!(apart < 1e-9, "{near} {far}, expected {scale} times {expected:?}");
        }
        assert_says(&notes(&scene), &["depth range from the points of colmap/sparse/0"]);
    }
}

#[test]
fn model_of_other_poses_gives_no_depth_range() {
    let root = tempdir().unwrap();
    let three = Colmap { camera: Colmap::PINHOLE, names: &["a.png", "b.png", "c.png"] };
    three.write_text(&root.path().join("colmap/sparse/0"));
    transforms(root.path(), 1.0, "", three.names);
    assert!(ranges(&open(root.path()).unwrap()).iter().all(Option::is_some));
    let moved = std::fs::read_to_string(root.path().join("transforms.json")).unwrap();
    write(&root.path().join("transforms.json"), moved.replacen("[[1, 0, 0, 5]", "[[1, 0, 0, 5.1]", 1));
    assert_eq!(ranges(&open(root.path()).unwrap()), [None; 3]);
    let root = tempdir().unwrap();
    Colmap { camera: Colmap::PINHOLE, names: &["x.png", "y.png"] }.write_text(&root.path().join("colmap/sparse/0"));
    transforms(root.path(), 1.0, "", TWO_PHOTOS.names);
    let scene = open(root.path()).unwrap();
    assert_eq!(ranges(&scene), [None; 2]);
    assert_says(&notes(&scene), &["colmap/sparse/0: its points are not used", "its poses are not those of the views"]);
}
