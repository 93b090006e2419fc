//! `transforms.json` of nerfstudio and instant-ngp.

use liveview_scene::Format;
use tempfile::tempdir;

use crate::scene_common::{assert_close, assert_says, notes, open, project, refusal, transforms};

#[test]
fn transform_matrix_has_opengl_axes() {
    let root = tempdir().unwrap();
    transforms(root.path(), "\"w\"", "\"near\": 0.5, \"far\": 9, \"w\"");
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.format, Format::Transforms);
    let view = &scene.views[0];
    assert_eq!((view.name.as_str(), view.depth_range), ("a.png", Some((0.5, 9.0))));
    // Straight ahead is −z; 1 to the right and 1 up, at depth 5.
    assert_close(project(&view.camera, 0.0, 0.0, -5.0), [30.0, 25.0, 5.0]);
    assert_close(project(&view.camera, 1.0, 1.0, -5.0), [30.0 + 50.0 / 5.0, 25.0 - 60.0 / 5.0, 5.0]);
}

#[test]
fn transform_matrix_is_world_from_camera() {
    let root = tempdir().unwrap();
    // The camera's axes (right, up, backwards) are the world's (0,0,−1), (0,1,0), (1,0,0): its
    // centre is (4,5,6), it looks along −x.
    transforms(
        root.path(),
        "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
        "[[0, 0, 1, 4], [0, 1, 0, 5], [-1, 0, 0, 6], [0, 0, 0, 1]]",
    );
    let camera = &open(root.path()).unwrap().views[0].camera;
    assert_eq!(camera.centre().to_array(), [4.0, 5.0, 6.0]);
    assert_eq!(camera.forward().to_array(), [-1.0, 0.0, 0.0]);
    assert_close(project(camera, 2.0, 5.0, 5.0), [30.0 + 50.0 * 0.5, 25.0, 2.0]);
}

#[test]
fn focal_length_comes_from_frame_then_file_then_angle() {
    let root = tempdir().unwrap();
    transforms(root.path(), "\"fl_x\": 50.0, \"fl_y\": 60.0, \"cx\": 30.0,", "\"camera_angle_x\": 1.5707963267948966,");
    let k = open(root.path()).unwrap().views[0].camera.intrinsics();
    // A quarter turn across 64 pixels: f = 32.
    assert!((k.fx - 32.0).abs() < 1e-12 && (k.fy - 32.0).abs() < 1e-12, "{k:?}");
    assert_eq!((k.cx, k.cy), (32.0, 25.0));
    transforms(root.path(), "{\"file_path\": ", "{\"fl_x\": 70, \"cy\": 20, \"file_path\": ");
    let k = open(root.path()).unwrap().views[0].camera.intrinsics();
    assert_eq!((k.fx, k.fy, k.cx, k.cy), (70.0, 60.0, 30.0, 20.0));
}

#[test]
fn missing_extension_and_size_are_taken_from_the_photo() {
    let root = tempdir().unwrap();
    transforms(root.path(), "images/a.png", "./images/a");
    assert_eq!(open(root.path()).unwrap().views[0].name, "a.png");
    transforms(root.path(), "\"w\": 64, \"h\": 48,", "");
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.views[0].camera.intrinsics().fx, 50.0);
    assert_says(&notes(&scene), &["w and h are missing"]);
}

#[test]
fn intrinsics_for_another_size_are_scaled() {
    let root = tempdir().unwrap();
    transforms(root.path(), "\"w\": 64, \"h\": 48", "\"w\": 640, \"h\": 478");
    let scene = open(root.path()).unwrap();
    let k = scene.views[0].camera.intrinsics();
    assert!((k.fx - 5.0).abs() < 1e-12 && (k.cy - 25.0 * 48.0 / 478.0).abs() < 1e-12, "{k:?}");
    assert_says(&notes(&scene), &["intrinsics scaled", "a.png 640x478 → 64x48"]);
}

#[test]
fn distorted_photo_is_undistorted_with_a_note() {
    let root = tempdir().unwrap();
    transforms(root.path(), "\"w\"", "\"camera_model\": \"OPENCV\", \"w\"");
    let pinhole = open(root.path()).unwrap().load_image(0).unwrap();
    transforms(root.path(), "\"w\"", "\"k1\": 0.3, \"w\"");
    let scene = open(root.path()).unwrap();
    assert_says(&notes(&scene), &["undistorted on load", "a.png"]);
    let image = scene.load_image(0).unwrap();
    assert_eq!((image.width(), image.height()), (64, 48));
    assert_ne!(image, pinhole);
    // Undistortion keeps the principal point, so the colours there are compared.
    let (a, b) = (image.pixel(30, 25), pinhole.pixel(30, 25));
    assert!((0..2).all(|c| (a[c] - b[c]).abs() < 0.01), "{a:?} {b:?}");
}

#[test]
fn unknown_camera_model_is_read_as_pinhole_with_a_note() {
    let root = tempdir().unwrap();
    transforms(root.path(), "\"w\"", "\"camera_model\": \"NEW_PINHOLE\", \"w\"");
    assert_says(&notes(&open(root.path()).unwrap()), &["camera_model NEW_PINHOLE is unknown"]);
}

#[test]
fn byte_order_mark_is_ignored() {
    let root = tempdir().unwrap();
    transforms(root.path(), "{\n", "\u{feff}{\n");
    assert_eq!(open(root.path()).unwrap().views.len(), 1);
}

/// Invalid variants of `transforms.json`: a part of its text, its replacement, and parts of the
/// expected message.
const INVALID: &[(&str, &str, &[&str])] = &[
    ("images/a.png", "images/b.png", &["images/b.png: missing image, listed in", "transforms.json"]),
    ("images/a.png", "../../../b.png", &["b.png: missing image"]),
    ("images/a.png", "/etc/b.png", &["/etc/b.png: missing image, listed in", "expected it in the scene folder"]),
    ("images/a.png", "", &["missing image, listed in"]),
    ("\"w\": 64", "\"w\": 65.5", &["w is 65.5", "a whole number of pixels"]),
    ("\"w\": 64, ", "", &["w is missing", "both w and h"]),
    ("\"w\": 64", "\"w\": 80", &["the image is 64x48", "declares 80x48, expected equal sizes"]),
    ("50.0", "NaN", &["transforms.json", "fl_x is missing"]),
    ("50.0", "1e999", &["fl_x is missing"]),
    ("50.0", "0", &["camera of a.png: K is singular: fx is 0"]),
    ("60.0", "-60", &["camera of a.png: K is singular: fy is -60"]),
    ("50.0", "\"fifty\"", &["frames[0]: fl_x is \"fifty\"", "a number"]),
    ("\"fl_x\": 50.0,", "", &["fl_x is missing", "camera_angle_x"]),
    ("[1, 0, 0, 0]", "[2, 0, 0, 0]", &["camera of a.png: the rotation is not orthonormal", "3.000e0", "1e-3"]),
    ("[1, 0, 0, 0]", "[-1, 0, 0, 0]", &["not orthonormal", "det R is -1"]),
    ("[1, 0, 0, 0]", "[1, 0, 0]", &["transform_matrix is [[1,0,0]", "4 rows of 4 numbers"]),
    ("[0, 0, 0, 1]", "[0, 0, 1, 1]", &["transform_matrix", "the last 0 0 0 1"]),
    ("\"frames\": [", "\"frames\": [], \"old\": [", &["no views; expected at least one"]),
    ("\"frames\"", "\"pictures\"", &["frames is missing; expected a list"]),
    ("\"w\"", "\"camera_model\": \"THIN_PRISM_FISHEYE\", \"w\"", &["THIN_PRISM_FISHEYE is not supported"]),
    ("\"w\"", "\"k4\": 0.1, \"w\"", &["distortion k4 = 0.1 is not supported"]),
    ("}\n  ]", "},\n 7\n  ]", &["frames[1] is not an object"]),
    ("{", "[", &["transforms.json", "line"]),
];

#[test]
fn invalid_transforms_json_is_an_error() {
    for (from, to, parts) in INVALID {
        let root = tempdir().unwrap();
        transforms(root.path(), from, to);
        assert_says(&refusal(root.path()), parts);
    }
}

#[test]
fn photo_listed_twice_is_an_error_unless_it_has_the_same_pose() {
    let root = tempdir().unwrap();
    let frame = "{\"file_path\": \"./images/a.png\", \"transform_matrix\": \
                 [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},";
    transforms(root.path(), "\"frames\": [", &format!("\"frames\": [{frame}"));
    assert_says(&notes(&open(root.path()).unwrap()), &["listed twice with the same pose, read once: images/a.png"]);
    transforms(
        root.path(),
        "\"frames\": [",
        &format!("\"frames\": [{}", frame.replace("[1, 0, 0, 0]", "[1, 0, 0, 7]")),
    );
    assert_says(&refusal(root.path()), &["\"images/a.png\" is listed twice"]);
}
