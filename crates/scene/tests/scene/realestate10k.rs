//! RealEstate10K's `cameras.txt`.

use liveview_scene::Format;
use tempfile::tempdir;

use crate::scene_common::{assert_close, assert_says, notes, open, picture, refusal, write};

const CAMERAS: &str = "https://example.org/video\n\
    1000 0.5 0.8 0.45 0.55 0 0 1 0 0 0.5 0 1 0 0 0 0 1 0\n\
    2000 0.5 0.8 0.45 0.55 0 0 1 0 0 0.6 0 1 0 0 0 0 1 0\n";

#[test]
fn intrinsics_are_fractions_of_the_image_size() {
    let root = tempdir().unwrap();
    write(&root.path().join("cameras.txt"), CAMERAS);
    picture(&root.path().join("frames/1000.jpg"), 64, 40);
    let scene = open(root.path()).unwrap();
    assert_eq!((scene.format, scene.views.len()), (Format::RealEstate10k, 1));
    let camera = &scene.views[0].camera;
    let k = camera.intrinsics();
    assert_close([k.fx, k.fy, k.cx], [32.0, 32.0, 28.8]);
    assert!((k.cy - 22.0).abs() < 1e-12, "{k:?}");
    assert_eq!(camera.translation().to_array(), [0.5, 0.0, 0.0]);
    assert_says(&notes(&scene), &["1 of the listed timestamps have no photo, skipped: 2000"]);
}

#[test]
fn pose_in_the_first_line_is_read_with_a_note() {
    let root = tempdir().unwrap();
    write(&root.path().join("cameras.txt"), CAMERAS.split_once('\n').unwrap().1);
    picture(&root.path().join("frames/1000.jpg"), 64, 40);
    picture(&root.path().join("frames/2000.jpg"), 64, 40);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.views.len(), 2);
    assert_says(&notes(&scene), &["the first line is read as a pose"]);
}

#[test]
fn invalid_cameras_txt_is_an_error() {
    let root = tempdir().unwrap();
    picture(&root.path().join("frames/1000.png"), 64, 40);
    let pose = "1 0 0 0 0 1 0 0 0 0 1 0";
    for (line, parts) in [
        (format!("1000 .5 .8 .5 .5 0 0 {pose} 4"), ["line 2: 20 words", "timestamp fx fy cx cy 0 0"]),
        (format!("1000 .5 .8 .5 x 0 0 {pose}"), ["line 2: \"x\" is not a number", "timestamp"]),
        (format!("1000 .5 .8 .5 .5 0.1 0 {pose}"), ["line 2: columns 6 and 7 are 0.1 and 0", "timestamp"]),
        (format!("1000 nan .8 .5 .5 0 0 {pose}"), ["cameras.txt: camera of 1000.png", "fx is NaN"]),
        ("1000 .5 .8 .5 .5 0 0 1 0 0 0 0 1 0 0 0 0 2 0".to_owned(), ["camera of 1000.png", "not orthonormal"]),
        (format!("2000 .5 .8 .5 .5 0 0 {pose}"), ["none of its 1 timestamps has a photo", "frames"]),
        (
            format!("1000 .5 .8 .5 .5 0 0 {pose}\n1000 .5 .8 .5 .5 0 0 1 0 0 7 0 1 0 0 0 0 1 0"),
            ["frames/1000.png", "is listed twice"],
        ),
        ("1000".to_owned(), ["line 2: 1 word", "timestamp"]),
    ] {
        write(&root.path().join("cameras.txt"), format!("https://example.org\n{line}\n"));
        assert_says(&refusal(root.path()), &parts);
    }
}
