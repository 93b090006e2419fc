//! Scene folders of any format: recognising the format, view names, `--width`, masks.

use std::fs;

use liveview_scene::{Format, Scene, SceneOptions};
use proptest::prelude::*;
use tempfile::tempdir;

use crate::scene_common::{
    Colmap, LLFF_ROW, ONE_PHOTO, TWO_PHOTOS, assert_says, notes, open, picture, poses_bounds, refusal, transforms,
    write,
};

#[test]
fn folder_without_a_scene_is_an_error() {
    let root = tempdir().unwrap();
    assert_says(&refusal(root.path()), &["no scene found", "transforms.json", "poses_bounds.npy", "sparse/0"]);
    assert_says(&refusal(&root.path().join("nowhere")), &["nowhere: does not exist"]);
    let file = root.path().join("transforms.json");
    write(&file, "{}");
    assert_says(&refusal(&file), &["frames is missing"]);
}

#[test]
fn several_formats_are_listed_in_a_note() {
    let root = tempdir().unwrap();
    poses_bounds(&root.path().join("poses_bounds.npy"), &[LLFF_ROW]);
    TWO_PHOTOS.write_binary(&root.path().join("sparse/0"));
    picture(&root.path().join("images/b.png"), 64, 48);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.format, Format::Colmap);
    assert_says(&notes(&scene), &["also holds LLFF poses_bounds.npy: its poses are not read"]);
}

#[test]
fn nerfstudio_and_gsplat_folders_open_at_each_photo_size() {
    let root = tempdir().unwrap();
    TWO_PHOTOS.write_binary(&root.path().join("sparse/0"));
    for (folder, width, height) in [("images", 64, 48), ("images_2", 32, 24), ("images_4", 16, 12), ("masks", 64, 48)] {
        TWO_PHOTOS.names.iter().for_each(|name| picture(&root.path().join(folder).join(name), width, height));
    }
    for (images, width, fx) in [(None, 64, 50.0), (Some("images_2"), 32, 25.0), (Some("images_4"), 16, 12.5)] {
        let options = SceneOptions { images: images.map(str::to_owned), ..SceneOptions::default() };
        let scene = Scene::open(root.path(), &options).unwrap();
        let camera = &scene.views[0].camera;
        assert_eq!((camera.width(), camera.intrinsics().fx, scene.views.len()), (width, fx, 2));
        assert_eq!(scene.load_image(0).unwrap().width(), width);
        assert_says(&notes(&scene), &["masks: masks are not supported"]);
    }
    // nerfstudio lists a mask in each frame.
    let frame = r#"{"file_path": "images/b.png", "mask_path": "masks/b.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}"#;
    write(&root.path().join("transforms.json"), format!(r#"{{"fl_x": 50, "w": 64, "h": 48, "frames": [{frame}]}}"#));
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.format, Format::Transforms);
    assert_says(&notes(&scene), &["mask_path: masks are not supported", "masks: masks are not supported"]);
}

#[test]
fn width_option_scales_photos_and_intrinsics_down() {
    let root = tempdir().unwrap();
    transforms(root.path(), "", "");
    let options = SceneOptions { width: Some(20), ..SceneOptions::default() };
    let scene = Scene::open(root.path(), &options).unwrap();
    let camera = &scene.views[0].camera;
    assert_eq!((camera.width(), camera.height()), (20, 15));
    assert!((camera.intrinsics().fx - 50.0 * 20.0 / 64.0).abs() < 1e-12);
    let image = scene.load_image(0).unwrap();
    assert_eq!((image.width(), image.height()), (20, 15));
    // Red increases linearly from left to right: column i of 20 has x / 64 at its centre.
    assert!((image.pixel(10, 7)[0] - 10.5 / 20.0).abs() < 0.02, "{:?}", image.pixel(10, 7));
    let wide = SceneOptions { width: Some(1000), ..SceneOptions::default() };
    assert_eq!(Scene::open(root.path(), &wide).unwrap().views[0].camera.width(), 64);
}

#[test]
fn view_index_matches_name_file_name_or_stem() {
    let root = tempdir().unwrap();
    let names: &[&str] = &["left/0001.png", "left/0002.png", "right/0001.png", "right/0003.png"];
    Colmap { camera: Colmap::PINHOLE, names }.write_text(&root.path().join("sparse/0"));
    names.iter().for_each(|name| picture(&root.path().join("images").join(name), 64, 48));
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.view_index("right/0001.png").unwrap(), 2);
    assert_eq!(scene.view_index("0002.png").unwrap(), 1);
    assert_eq!(scene.view_index("0003").unwrap(), 3);
    let message = scene.view_index("0001").unwrap_err().to_string();
    assert_says(&message, &["several views are named \"0001\"", "left/0001.png, right/0001.png"]);
    let message = scene.view_index("left/0004.png").unwrap_err().to_string();
    assert_says(&message, &["no view is named \"left/0004.png\" among the 4 views", "closest: left/0001.png"]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Changes a few bytes of any file of a scene: opening it may fail but must not panic.
    #[test]
    fn damaged_files_never_panic(file in 0..5_usize, at in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let root = tempdir().unwrap();
        let path = match file {
            0..3 => {
                ONE_PHOTO.write_binary(&root.path().join("sparse/0"));
                picture(&root.path().join("images/a.png"), 64, 48);
                root.path().join("sparse/0").join(["cameras.bin", "images.bin", "points3D.bin"][file])
            }
            3 => {
                poses_bounds(&root.path().join("poses_bounds.npy"), &[LLFF_ROW]);
                picture(&root.path().join("images/a.png"), 64, 48);
                root.path().join("poses_bounds.npy")
            }
            _ => {
                transforms(root.path(), "images/a.png", "images/a.jpg");
                picture(&root.path().join("images/a.jpg"), 64, 48);
                root.path().join("images/a.jpg")
            }
        };
        let mut bytes = fs::read(&path).unwrap();
        for (index, value) in at {
            let index = index.index(bytes.len());
            bytes[index] = value;
        }
        fs::write(&path, bytes).unwrap();
        if let Ok(scene) = open(root.path()) {
            let _ = scene.load_image(0);
        }
    }
}
