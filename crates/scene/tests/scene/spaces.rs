//! `models.json` of the Spaces data set.

use liveview_scene::Format;
use tempfile::tempdir;

use crate::scene_common::{assert_close, assert_says, notes, open, picture, project, refusal, write};

/// Two cameras at one rig position: declared 2048 wide, photos 64 wide, different heights.
const MODELS: &str = r#"[[
  {"principal_point": [1024, 608], "pixel_aspect_ratio": 1.01, "position": [0, 0, 0], "focal_length": 640,
   "width": 2048, "height": 1216, "relative_path": "cam_00/image_000.png", "orientation": [0, 0, 0]},
  {"principal_point": [1000, 640], "pixel_aspect_ratio": 1.0, "position": [1, 2, 3], "focal_length": 640,
   "width": 2048, "height": 1280.0, "relative_path": "cam_01/image_000.png", "orientation": [0, 1.5707963267948966, 0]}
], []]"#;

#[test]
fn intrinsics_are_scaled_from_declared_to_actual_size() {
    let root = tempdir().unwrap();
    write(&root.path().join("models.json"), MODELS);
    picture(&root.path().join("cam_00/image_000.png"), 64, 38);
    picture(&root.path().join("cam_01/image_000.png"), 64, 40);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.format, Format::Spaces);
    let (first, second) = (&scene.views[0].camera, &scene.views[1].camera);
    assert_eq!((first.height(), second.height()), (38, 40));
    let k = first.intrinsics();
    assert_close([k.fx, k.fy, k.cx], [20.0, 20.2, 32.0]);
    assert!((k.cy - 19.0).abs() < 1e-12, "{k:?}");
    // Rotated by 90° about y, the camera looks along −x: the point is 10 ahead and 5 down.
    assert_close(project(second, 1.0 - 10.0, 2.0 + 5.0, 3.0), [31.25, 20.0 + 10.0, 10.0]);
    assert_says(&notes(&scene), &["2 rig positions", "2 views, such as cam_00/image_000.png 2048x1216 → 64x38"]);
    assert_eq!(scene.view_index("cam_01/image_000.png").unwrap(), 1);
}

#[test]
fn invalid_models_json_is_an_error() {
    let camera = r#"{"principal_point": [32, 24], "pixel_aspect_ratio": 1, "position": [0, 0, 0], "focal_length": 50,
        "width": 64, "height": 48, "relative_path": "a.png", "orientation": [0, 0, 0]}"#;
    let root = tempdir().unwrap();
    picture(&root.path().join("a.png"), 64, 48);
    for (from, to, parts) in [
        ("[32, 24]", "[32]", ["[0][0]: principal_point is [32]", "2 numbers"]),
        ("\"focal_length\"", "\"focal\"", ["[0][0]: focal_length is missing", "a number"]),
        ("\"height\": 48", "\"height\": 20", ["a.png: the image is 64x48", "declares 64x20"]),
        ("a.png", "b.png", ["b.png: missing image", "models.json"]),
        ("\"focal_length\": 50", "\"focal_length\": -1", ["camera of a.png", "K is singular: fx is -1"]),
    ] {
        write(&root.path().join("models.json"), format!("[[{}]]", camera.replace(from, to)));
        assert_says(&refusal(root.path()), &parts);
    }
    write(&root.path().join("models.json"), "[]");
    assert_says(&refusal(root.path()), &["rig position 0 does not exist", "a list of cameras"]);
    write(&root.path().join("models.json"), "[[]]");
    assert_says(&refusal(root.path()), &["no views"]);
}
