//! LLFF's `poses_bounds.npy`.

use liveview_files::npy;
use liveview_scene::{Format, Scene, SceneOptions};
use tempfile::tempdir;

use crate::scene_common::{
    LLFF_ROW, assert_close, assert_says, notes, open, picture, poses_bounds, project, refusal, write,
};

#[test]
fn pose_columns_are_down_right_backwards() {
    let root = tempdir().unwrap();
    poses_bounds(&root.path().join("poses_bounds.npy"), &[LLFF_ROW]);
    picture(&root.path().join("images/x.png"), 64, 48);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.format, Format::Llff);
    let view = &scene.views[0];
    assert_eq!(view.depth_range, Some((1.5, 20.0)));
    assert_eq!(view.camera.centre().to_array(), [1.0, 2.0, 3.0]);
    // 0.5 to the right, 0.25 up, 2 ahead: K is f = 80 about (32, 24).
    assert_close(project(&view.camera, 1.5, 2.25, 1.0), [32.0 + 80.0 * 0.25, 24.0 - 80.0 * 0.125, 2.0]);
}

#[test]
fn rows_match_downscaled_photos_in_byte_order_with_scaled_intrinsics() {
    let root = tempdir().unwrap();
    let mut second = LLFF_ROW;
    second[3] = 7.0;
    poses_bounds(&root.path().join("poses_bounds.npy"), &[LLFF_ROW, second]);
    for name in ["10.png", "9.png"] {
        picture(&root.path().join("images").join(name), 64, 48);
        picture(&root.path().join("images_4").join(name), 16, 12);
    }
    write(&root.path().join("images_4/notes.txt"), "no photo");
    let scene = open(root.path()).unwrap();
    // In byte order "10" precedes "9", so it belongs to the first row.
    assert_eq!(scene.views.iter().map(|v| v.name.as_str()).collect::<Vec<_>>(), ["10.png", "9.png"]);
    assert_eq!(scene.views[1].camera.centre().x, 7.0);
    let k = scene.views[0].camera.intrinsics();
    assert_eq!((k.fx, k.fy, k.cx, k.cy), (20.0, 20.0, 8.0, 6.0));
    let options = SceneOptions { images: Some("images".to_owned()), ..SceneOptions::default() };
    assert_eq!(Scene::open(root.path(), &options).unwrap().views[0].camera.width(), 64);
}

#[test]
fn invalid_poses_bounds_are_errors() {
    let root = tempdir().unwrap();
    let poses = root.path().join("poses_bounds.npy");
    poses_bounds(&poses, &[LLFF_ROW, LLFF_ROW]);
    assert_says(&refusal(root.path()), &["no photo folder", "images_8, images_4, images_2, images"]);
    picture(&root.path().join("images/a.png"), 64, 48);
    assert_says(&refusal(root.path()), &["poses_bounds.npy: 2 poses", "images holds 1 images"]);
    picture(&root.path().join("images/a.png"), 64, 24);
    poses_bounds(&poses, &[LLFF_ROW]);
    assert_says(&refusal(root.path()), &["the image is 64x24", "declares 64x48"]);
    picture(&root.path().join("images/a.png"), 64, 48);
    for (index, value, parts) in [
        (14, f64::NAN, ["camera of a.png", "fx is NaN"]),
        (2, 0.5, ["camera of a.png", "not orthonormal"]),
        (4, f64::INFINITY, ["row 0: height is inf", "a number of pixels"]),
        (9, -64.0, ["row 0: width is -64", "a number of pixels"]),
    ] {
        let mut row = LLFF_ROW;
        row[index] = value;
        poses_bounds(&poses, &[row]);
        assert_says(&refusal(root.path()), &parts);
    }
    write(&poses, npy::bytes(&ndarray::Array2::<f64>::zeros((1, 15))));
    assert_says(&refusal(root.path()), &["poses_bounds.npy", "shape [1, 15]", "17 numbers"]);
    write(&poses, npy::bytes(&ndarray::Array2::<u8>::zeros((1, 17))));
    assert_says(&refusal(root.path()), &["poses_bounds.npy", "float64"]);
}

#[test]
fn invalid_depth_range_is_ignored_with_a_note() {
    let root = tempdir().unwrap();
    let mut row = LLFF_ROW;
    row[15] = f64::NAN;
    poses_bounds(&root.path().join("poses_bounds.npy"), &[row]);
    picture(&root.path().join("images/a.png"), 64, 48);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.views[0].depth_range, None);
    assert_says(&notes(&scene), &["depth range ignored", "a.png (NaN to 20.0)"]);
}

#[test]
fn array_shape_larger_than_the_file_is_an_error() {
    let root = tempdir().unwrap();
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (4000000000000, 17), }";
    let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    bytes.extend(format!("{header:<117}\n").as_bytes());
    bytes.extend([0; 64]);
    write(&root.path().join("poses_bounds.npy"), bytes);
    assert_says(
        &refusal(root.path()),
        &["poses_bounds.npy: 64 bytes for shape [4000000000000, 17]", "expected an array, float64"],
    );
}

/// A header that the fuzzer found; another parser took exponential time for it.
#[test]
fn array_header_with_nested_braces_is_an_error() {
    let root = tempdir().unwrap();
    write(
        &root.path().join("poses_bounds.npy"),
        include_bytes!("../../../../tests/fixtures/damaged/nested_braces.npy"),
    );
    assert_says(&refusal(root.path()), &["poses_bounds.npy: elements of type unknown"]);
}
