//! COLMAP sparse models, text and binary.

use std::fs;
use std::path::Path;

use liveview_scene::Format;
use tempfile::tempdir;

use crate::scene_common::{
    Bytes, Colmap, ONE_PHOTO, TWO_PHOTOS, assert_close, assert_says, notes, open, picture, project, refusal, write,
};

#[test]
fn text_and_binary_models_give_equal_views() {
    let (text, binary) = (tempdir().unwrap(), tempdir().unwrap());
    TWO_PHOTOS.write_text(&text.path().join("sparse/0"));
    TWO_PHOTOS.write_binary(&binary.path().join("sparse"));
    colmap_photos(text.path(), TWO_PHOTOS.names);
    colmap_photos(binary.path(), TWO_PHOTOS.names);
    let (text, binary) = (open(text.path()).unwrap(), open(binary.path()).unwrap());
    assert_eq!((text.format, binary.format), (Format::Colmap, Format::Colmap));
    assert_eq!(text.views.len(), 2);
    assert_eq!(text.notes, binary.notes);
    for (a, b) in text.views.iter().zip(&binary.views) {
        assert_eq!((&a.name, &a.camera, a.depth_range), (&b.name, &b.camera, b.depth_range));
    }
}

#[test]
fn views_have_poses_and_depth_ranges_of_the_model() {
    let root = tempdir().unwrap();
    TWO_PHOTOS.write_binary(&root.path().join("sparse/0"));
    colmap_photos(root.path(), TWO_PHOTOS.names);
    let scene = open(root.path()).unwrap();
    let view = &scene.views[scene.view_index("b").unwrap()];
    // Photo 0 is not rotated: X_cam = X + (0, 0.1, 0).
    assert_close(project(&view.camera, 1.0, 0.9, 4.0), [30.0 + 50.0 / 4.0, 25.0 + 60.0 / 4.0, 4.0]);
    // Depths 2, 3, … 11: percentiles 1 and 99 lie at ranks 0.09 and 8.91.
    let (near, far) = view.depth_range.unwrap();
    assert!((near - 0.9 * 2.09).abs() < 1e-12 && (far - 1.1 * 10.91).abs() < 1e-12, "{near} {far}");
    assert!(scene.reprojection_error.unwrap() < 1e-6, "{:?}", scene.reprojection_error);
    assert!(!notes(&scene).contains("may not belong"));
}

#[test]
fn unregistered_photos_are_skipped_with_a_note() {
    let root = tempdir().unwrap();
    TWO_PHOTOS.write_binary(&root.path().join("sparse/0"));
    colmap_photos(root.path(), &["b.png", "sub/a.png", "c.png", "sub/d.jpg"]);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.views.len(), 2);
    assert_says(&notes(&scene), &["2 photos were not registered by COLMAP, skipped: c.png, sub/d.jpg"]);
}

#[test]
fn downscaled_photos_may_have_another_extension() {
    let root = tempdir().unwrap();
    TWO_PHOTOS.write_text(root.path());
    picture(&root.path().join("images_2/b.jpg"), 32, 24);
    picture(&root.path().join("images_2/sub/a.jpg"), 32, 24);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.views[0].name, "b.jpg");
    assert_eq!(scene.views[0].camera.intrinsics().fx, 25.0);
    assert_says(&notes(&scene), &["photos are read from images_2", "b.jpg 64x48 → 32x24"]);
}

#[test]
fn supported_camera_models_are_undistorted_if_distorted() {
    let models = [
        ("SIMPLE_PINHOLE 64 48 50 30 25", false),
        ("SIMPLE_RADIAL 64 48 50 30 25 0.1", true),
        ("SIMPLE_RADIAL 64 48 50 30 25 0", false),
        ("RADIAL 64 48 50 30 25 0.1 -0.01", true),
        ("OPENCV 64 48 50 50 30 25 0.1 -0.01 0.001 0.002", true),
        ("FULL_OPENCV 64 48 50 50 30 25 0 0 0 0 0 0 0 0.1", true),
        ("OPENCV_FISHEYE 64 48 50 50 30 25 0 0 0 0", true),
        ("SIMPLE_RADIAL_FISHEYE 64 48 50 30 25 0.1", true),
        ("RADIAL_FISHEYE 64 48 50 30 25 0.1 -0.01", true),
    ];
    for (camera, distorted) in models {
        let root = tempdir().unwrap();
        Colmap { camera, names: &["b.png"] }.write_text(&root.path().join("sparse/0"));
        colmap_photos(root.path(), &["b.png"]);
        let scene = open(root.path()).unwrap();
        let k = scene.views[0].camera.intrinsics();
        assert_eq!((k.fx, k.fy, k.cx, k.cy), (50.0, 50.0, 30.0, 25.0), "{camera}");
        assert_eq!(notes(&scene).contains("undistorted on load"), distorted, "{camera}");
    }
}

#[test]
fn photos_without_keypoints_have_no_depth_range() {
    let root = tempdir().unwrap();
    let folder = root.path().join("sparse/0");
    write(&folder.join("cameras.txt"), format!("1 {}\n", Colmap::PINHOLE));
    write(&folder.join("images.txt"), "#\n1 1 0 0 0 0 0 0 1 a.png\n\n2 2 0 0 0 1 0 0 1 b.png\n");
    colmap_photos(root.path(), &["a.png", "b.png"]);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.views.len(), 2);
    // A quaternion of length 2 along w is the identity.
    assert_eq!(scene.views[1].camera.centre().to_array(), [-1.0, 0.0, 0.0]);
    assert_eq!(scene.views[0].depth_range, None);
    assert_says(&notes(&scene), &["no points3D"]);
}

#[test]
fn count_larger_than_the_file_is_an_error() {
    for (file, what) in [("cameras.bin", "cameras"), ("images.bin", "images")] {
        for count in [u64::MAX, 1 << 40, 100_000] {
            let root = tempdir().unwrap();
            ONE_PHOTO.write_binary(&root.path().join("sparse/0"));
            let path = root.path().join("sparse/0").join(file);
            let mut bytes = fs::read(&path).unwrap();
            bytes[..8].copy_from_slice(&count.to_le_bytes());
            fs::write(&path, bytes).unwrap();
            assert_says(
                &refusal(root.path()),
                &[file, &format!("{count} {what} are declared"), "that fit in the file"],
            );
        }
    }
    let root = tempdir().unwrap();
    ONE_PHOTO.write_binary(&root.path().join("sparse/0"));
    let images = Bytes::default().u64(1).u32(1).f64(1.0).f64(0.0).f64(0.0).f64(0.0).f64(0.0).f64(0.0).f64(0.0);
    write(&root.path().join("sparse/0/images.bin"), images.u32(1).text("a.png").u64(1 << 60).0);
    assert_says(&refusal(root.path()), &["images.bin", "keypoints are declared"]);
}

#[test]
fn truncated_binary_file_is_an_error() {
    let root = tempdir().unwrap();
    picture(&root.path().join("images/a.png"), 64, 48);
    for file in ["cameras.bin", "images.bin"] {
        let folder = root.path().join("sparse/0");
        ONE_PHOTO.write_binary(&folder);
        let whole = fs::read(folder.join(file)).unwrap();
        for keep in 0..whole.len() {
            fs::write(folder.join(file), &whole[..keep]).unwrap();
            assert_says(&refusal(root.path()), &[file, "expected"]);
        }
    }
}

/// Invalid text models: the camera line, the photo's name, and parts of the expected message.
const INVALID: &[(&str, &str, &[&str])] = &[
    ("FOV 64 48 50 50 30 25 0.1", "a.png", &["cameras.txt: camera model FOV is not supported"]),
    ("FULL_OPENCV 64 48 50 50 30 25 0 0 0 0", "a.png", &["a FULL_OPENCV camera with 8 parameters"]),
    ("PINHOLE 64 48 50 30 25", "a.png", &["cameras.txt", "PINHOLE camera with 3 parameters"]),
    ("PINHOLE 64 48 50 sixty 30 25", "a.png", &["cameras.txt: line 2: word 6 is \"sixty\"", "PARAMS"]),
    ("PINHOLE 64 48 nan 50 30 25", "a.png", &["cameras.txt: camera of model PINHOLE: fx is NaN"]),
    ("RADIAL 64 48 50 30 25 inf 0", "a.png", &["cameras.txt: camera of model RADIAL: k1 is inf"]),
    ("PINHOLE 80 50 50 50 30 25", "a.png", &["a.png: the image is 64x48", "declares 80x50"]),
    ("PINHOLE 18446744073709551615 48 50 50 30 25", "a.png", &["a.png: the image is 64x48"]),
    ("PINHOLE 64 48 50 50 30 25", "b.png", &["images/b.png: missing image, listed in", "images.txt"]),
    ("PINHOLE 64 48 50 50 30 25", "../a.png", &["the path \"../a.png\" leaves the scene folder"]),
];

#[test]
fn invalid_text_models_are_errors() {
    for (camera, name, parts) in INVALID {
        let root = tempdir().unwrap();
        picture(&root.path().join("images/a.png"), 64, 48);
        let folder = root.path().join("sparse/0");
        Colmap { camera, names: &[name] }.write_text(&folder);
        assert_says(&refusal(root.path()), parts);
    }
    let root = tempdir().unwrap();
    picture(&root.path().join("images/a.png"), 64, 48);
    let folder = root.path().join("sparse/0");
    ONE_PHOTO.write_text(&folder);
    for (images, parts) in [
        ("1 0 0 0 0 0 0 0 1 a.png\n\n", ["camera of a.png", "rotation[0][0] is NaN"]),
        ("1 1 0 0 0 0 0 0 7 a.png\n\n", ["image a.png has camera 7", "not listed"]),
        ("1 1 0 0 0 0 0\n\n", ["images.txt: line 1: 7 words", "CAMERA_ID NAME"]),
        ("1 1 0 0 0 0 0 0 1 a.png\n1 2 3 4\n", ["images.txt: line 2: 4 words", "POINT3D_ID"]),
    ] {
        write(&folder.join("images.txt"), images);
        assert_says(&refusal(root.path()), &parts);
    }
}

#[test]
fn duplicate_and_trailing_records_are_errors() {
    let root = tempdir().unwrap();
    picture(&root.path().join("images/a.png"), 64, 48);
    let folder = root.path().join("sparse/0");
    ONE_PHOTO.write_text(&folder);
    let file = "cameras.txt";
    let path = folder.join(file);
    let text = fs::read_to_string(&path).unwrap();
    write(&path, format!("{text}{text}"));
    assert_says(&refusal(root.path()), &[file, "camera 1 is listed twice"]);
    write(&path, text);
    ONE_PHOTO.write_binary(&folder);
    open(root.path()).unwrap();
    for file in ["cameras.bin", "images.bin"] {
        let path = folder.join(file);
        let bytes = fs::read(&path).unwrap();
        write(&path, [&bytes[..], b"more"].concat());
        assert_says(&refusal(root.path()), &[file, "4 bytes after the last", "expected the end of the file"]);
        let twice = [&2_u64.to_le_bytes(), &bytes[8..], &bytes[8..]].concat();
        if file == "cameras.bin" {
            write(&path, twice);
            assert_says(&refusal(root.path()), &[file, "camera 1 is listed twice"]);
        }
        write(&path, bytes);
    }
}

fn colmap_photos(root: &Path, names: &[&str]) {
    for name in names {
        picture(&root.join("images").join(name), 64, 48);
    }
}
