//! The five input formats, each against poses worked out by hand.

mod scene_common;

use std::fs;
use std::path::Path;

use image::ImageEncoder;
use liveview::scene::{Format, Scene, SceneOptions};
use scene_common::{
    Colmap, LLFF_ROW, assert_close, assert_says, open, picture, poses_bounds, project, transforms, write,
};
use tempfile::tempdir;

fn notes(scene: &Scene) -> String {
    scene.notes.join("\n")
}

#[test]
fn transforms_json_has_opengl_axes() {
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
fn transforms_json_pose_is_world_from_camera() {
    let root = tempdir().unwrap();
    // The camera's axes (right, up, backwards) are the world's (0,0,−1), (0,1,0), (1,0,0): it stands at (4,5,6), looks along −x.
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
fn transforms_json_frames_override_the_file_and_angles_stand_in_for_focal_lengths() {
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
fn transforms_json_without_extension_or_size() {
    let root = tempdir().unwrap();
    transforms(root.path(), "images/a.png", "./images/a");
    assert_eq!(open(root.path()).unwrap().views[0].name, "a.png");
    transforms(root.path(), "\"w\": 64, \"h\": 48,", "");
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.views[0].camera.intrinsics().fx, 50.0);
    assert_says(&notes(&scene), &["w and h are not given"]);
}

#[test]
fn transforms_json_for_another_resolution_scales_the_intrinsics() {
    let root = tempdir().unwrap();
    transforms(root.path(), "\"w\": 64, \"h\": 48", "\"w\": 640, \"h\": 478");
    let scene = open(root.path()).unwrap();
    let k = scene.views[0].camera.intrinsics();
    assert!((k.fx - 5.0).abs() < 1e-12 && (k.cy - 25.0 * 48.0 / 478.0).abs() < 1e-12, "{k:?}");
    assert_says(&notes(&scene), &["intrinsics scaled", "a.png 640x478 → 64x48"]);
}

#[test]
fn transforms_json_lens_is_undone_and_told() {
    let root = tempdir().unwrap();
    transforms(root.path(), "\"w\"", "\"camera_model\": \"OPENCV\", \"w\"");
    let straight = open(root.path()).unwrap().load_image(0).unwrap();
    transforms(root.path(), "\"w\"", "\"k1\": 0.3, \"w\"");
    let scene = open(root.path()).unwrap();
    assert_says(&notes(&scene), &["lens distortion undone", "a.png"]);
    let image = scene.load_image(0).unwrap();
    assert_eq!((image.width(), image.height()), (64, 48));
    assert_ne!(image, straight);
    // The principal point stays where it is: compare there.
    let (a, b) = (image.pixel(30, 25), straight.pixel(30, 25));
    assert!((0..2).all(|c| (a[c] - b[c]).abs() < 0.01), "{a:?} {b:?}");
}

#[test]
fn unknown_camera_models_are_read_with_a_note() {
    let root = tempdir().unwrap();
    transforms(root.path(), "\"w\"", "\"camera_model\": \"NEW_PINHOLE\", \"w\"");
    assert_says(&notes(&open(root.path()).unwrap()), &["camera_model NEW_PINHOLE is unknown"]);
}

#[test]
fn llff_columns_are_down_right_backwards() {
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
fn llff_prefers_reduced_photos_scales_to_them_and_sorts_as_text() {
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
    // As text "10" comes before "9", and so belongs to the first row.
    assert_eq!(scene.views.iter().map(|v| v.name.as_str()).collect::<Vec<_>>(), ["10.png", "9.png"]);
    assert_eq!(scene.views[1].camera.centre().x, 7.0);
    let k = scene.views[0].camera.intrinsics();
    assert_eq!((k.fx, k.fy, k.cx, k.cy), (20.0, 20.0, 8.0, 6.0));
    let mut options = SceneOptions::default();
    options.images = Some("images".to_owned());
    assert_eq!(Scene::open(root.path(), &options).unwrap().views[0].camera.width(), 64);
}

fn colmap_photos(root: &Path, names: &[&str]) {
    for name in names {
        picture(&root.join("images").join(name), 64, 48);
    }
}

const TWO: Colmap<'_> = Colmap { camera: Colmap::PINHOLE, names: &["b.png", "sub/a.png"] };

#[test]
fn colmap_text_equals_binary() {
    let (text, binary) = (tempdir().unwrap(), tempdir().unwrap());
    TWO.write_text(&text.path().join("sparse/0"));
    TWO.write_binary(&binary.path().join("sparse"));
    colmap_photos(text.path(), TWO.names);
    colmap_photos(binary.path(), TWO.names);
    let (text, binary) = (open(text.path()).unwrap(), open(binary.path()).unwrap());
    assert_eq!((text.format, binary.format), (Format::Colmap, Format::Colmap));
    assert_eq!(text.views.len(), 2);
    assert_eq!(text.notes, binary.notes);
    for (a, b) in text.views.iter().zip(&binary.views) {
        assert_eq!((&a.name, &a.camera, a.depth_range), (&b.name, &b.camera, b.depth_range));
    }
}

#[test]
fn colmap_poses_points_and_depths() {
    let root = tempdir().unwrap();
    TWO.write_binary(&root.path().join("sparse/0"));
    colmap_photos(root.path(), TWO.names);
    let scene = open(root.path()).unwrap();
    let view = &scene.views[scene.view_index("b").unwrap()];
    // Photo 0 is not turned: X_cam = X + (0, 0.1, 0).
    assert_close(project(&view.camera, 1.0, 0.9, 4.0), [30.0 + 50.0 / 4.0, 25.0 + 60.0 / 4.0, 4.0]);
    // Depths 2, 3, … 11: percentiles 1 and 99 lie at ranks 0.09 and 8.91.
    let (near, far) = view.depth_range.unwrap();
    assert!((near - 0.9 * 2.09).abs() < 1e-12 && (far - 1.1 * 10.91).abs() < 1e-12, "{near} {far}");
    assert_says(&notes(&scene), &["median reprojection error of 20 tracked points: 0.00 px"]);
    assert!(!notes(&scene).contains("may not belong"));
}

#[test]
fn colmap_loads_what_is_registered_and_names_the_rest() {
    let root = tempdir().unwrap();
    TWO.write_binary(&root.path().join("sparse/0"));
    colmap_photos(root.path(), &["b.png", "sub/a.png", "c.png", "sub/d.jpg"]);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.views.len(), 2);
    assert_says(&notes(&scene), &["2 photos were not registered by COLMAP, skipped: c.png, sub/d.jpg"]);
}

#[test]
fn colmap_reduced_photos_may_have_another_extension() {
    let root = tempdir().unwrap();
    TWO.write_text(root.path());
    picture(&root.path().join("images_2/b.jpg"), 32, 24);
    picture(&root.path().join("images_2/sub/a.jpg"), 32, 24);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.views[0].name, "b.jpg");
    assert_eq!(scene.views[0].camera.intrinsics().fx, 25.0);
    assert_says(&notes(&scene), &["photos are those of images_2", "b.jpg 64x48 → 32x24"]);
}

#[test]
fn a_folder_of_nerfstudio_or_gsplat_opens_as_it_is_at_each_size() {
    let root = tempdir().unwrap();
    TWO.write_binary(&root.path().join("sparse/0"));
    for (folder, width, height) in [("images", 64, 48), ("images_2", 32, 24), ("images_4", 16, 12), ("masks", 64, 48)] {
        TWO.names.iter().for_each(|name| picture(&root.path().join(folder).join(name), width, height));
    }
    for (images, width, fx) in [(None, 64, 50.0), (Some("images_2"), 32, 25.0), (Some("images_4"), 16, 12.5)] {
        let mut options = SceneOptions::default();
        options.images = images.map(str::to_owned);
        let scene = Scene::open(root.path(), &options).unwrap();
        let camera = &scene.views[0].camera;
        assert_eq!((camera.width(), camera.intrinsics().fx, scene.views.len()), (width, fx, 2));
        assert_eq!(scene.load_image(0).unwrap().width(), width);
        assert_says(&notes(&scene), &["masks: not read"]);
    }
    // nerfstudio names a mask in each frame.
    let frame = r#"{"file_path": "images/b.png", "mask_path": "masks/b.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}"#;
    write(&root.path().join("transforms.json"), format!(r#"{{"fl_x": 50, "w": 64, "h": 48, "frames": [{frame}]}}"#));
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.format, Format::Transforms);
    assert_says(&notes(&scene), &["mask_path: not read", "masks: not read"]);
}

#[test]
fn colmap_lens_models() {
    let models = [
        ("SIMPLE_PINHOLE 64 48 50 30 25", false),
        ("SIMPLE_RADIAL 64 48 50 30 25 0.1", true),
        ("SIMPLE_RADIAL 64 48 50 30 25 0", false),
        ("RADIAL 64 48 50 30 25 0.1 -0.01", true),
        ("OPENCV 64 48 50 50 30 25 0.1 -0.01 0.001 0.002", true),
    ];
    for (camera, distorted) in models {
        let root = tempdir().unwrap();
        Colmap { camera, names: &["b.png"] }.write_text(&root.path().join("sparse/0"));
        colmap_photos(root.path(), &["b.png"]);
        let scene = open(root.path()).unwrap();
        let k = scene.views[0].camera.intrinsics();
        assert_eq!((k.fx, k.fy, k.cx, k.cy), (50.0, 50.0, 30.0, 25.0), "{camera}");
        assert_eq!(notes(&scene).contains("lens distortion undone"), distorted, "{camera}");
    }
}

#[test]
fn colmap_text_allows_photos_without_keypoints() {
    let root = tempdir().unwrap();
    let folder = root.path().join("sparse/0");
    write(&folder.join("cameras.txt"), format!("1 {}\n", Colmap::PINHOLE));
    write(&folder.join("images.txt"), "#\n1 1 0 0 0 0 0 0 1 a.png\n\n2 2 0 0 0 1 0 0 1 b.png\n");
    colmap_photos(root.path(), &["a.png", "b.png"]);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.views.len(), 2);
    // A quaternion of length 2 is still no rotation at all.
    assert_eq!(scene.views[1].camera.centre().to_array(), [-1.0, 0.0, 0.0]);
    assert_eq!(scene.views[0].depth_range, None);
    assert_says(&notes(&scene), &["no points3D"]);
}

const RE10K: &str = "https://example.org/video\n\
    1000 0.5 0.8 0.45 0.55 0 0 1 0 0 0.5 0 1 0 0 0 0 1 0\n\
    2000 0.5 0.8 0.45 0.55 0 0 1 0 0 0.6 0 1 0 0 0 0 1 0\n";

#[test]
fn realestate10k_intrinsics_are_fractions_of_the_image() {
    let root = tempdir().unwrap();
    write(&root.path().join("cameras.txt"), RE10K);
    picture(&root.path().join("frames/1000.jpg"), 64, 40);
    let scene = open(root.path()).unwrap();
    assert_eq!((scene.format, scene.views.len()), (Format::RealEstate10k, 1));
    let camera = &scene.views[0].camera;
    let k = camera.intrinsics();
    assert_close([k.fx, k.fy, k.cx], [32.0, 32.0, 28.8]);
    assert!((k.cy - 22.0).abs() < 1e-12, "{k:?}");
    assert_eq!(camera.translation().to_array(), [0.5, 0.0, 0.0]);
    assert_says(&notes(&scene), &["1 of the listed timestamps have no picture, skipped: 2000"]);
}

#[test]
fn realestate10k_without_its_first_line_keeps_its_first_pose() {
    let root = tempdir().unwrap();
    write(&root.path().join("cameras.txt"), RE10K.split_once('\n').unwrap().1);
    picture(&root.path().join("frames/1000.jpg"), 64, 40);
    picture(&root.path().join("frames/2000.jpg"), 64, 40);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.views.len(), 2);
    assert_says(&notes(&scene), &["the first line is a pose"]);
}

#[test]
fn a_byte_order_mark_is_no_text() {
    let root = tempdir().unwrap();
    transforms(root.path(), "{\n", "\u{feff}{\n");
    assert_eq!(open(root.path()).unwrap().views.len(), 1);
}

#[test]
fn what_of_a_photo_is_not_used_is_told() {
    let root = tempdir().unwrap();
    transforms(root.path(), "", "");
    let path = root.path().join("images/a.png");
    let orientation =
        |value| [b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0", &[value][..], b"\0\0\0\0\0\0"].concat();
    let write_photo = |exif: Vec<u8>| {
        let mut encoder = image::codecs::png::PngEncoder::new(fs::File::create(&path).unwrap());
        encoder.set_exif_metadata(exif).unwrap();
        encoder.write_image(&[128; 4 * 64 * 48], 64, 48, image::ExtendedColorType::Rgba8).unwrap();
    };
    write_photo(orientation(6));
    let told = notes(&open(root.path()).unwrap());
    assert_says(&told, &["EXIF orientation ignored", "alpha channel dropped", "pixels as stored: images/a.png"]);
    write_photo(orientation(1));
    assert!(!notes(&open(root.path()).unwrap()).contains("EXIF"));
}

/// Two cameras at one rig position: declared 2048 wide, photos 64 wide, heights different.
const SPACES: &str = r#"[[
  {"principal_point": [1024, 608], "pixel_aspect_ratio": 1.01, "position": [0, 0, 0], "focal_length": 640,
   "width": 2048, "height": 1216, "relative_path": "cam_00/image_000.png", "orientation": [0, 0, 0]},
  {"principal_point": [1000, 640], "pixel_aspect_ratio": 1.0, "position": [1, 2, 3], "focal_length": 640,
   "width": 2048, "height": 1280.0, "relative_path": "cam_01/image_000.png", "orientation": [0, 1.5707963267948966, 0]}
], []]"#;

#[test]
fn spaces_heights_differ_and_intrinsics_are_for_another_size() {
    let root = tempdir().unwrap();
    write(&root.path().join("models.json"), SPACES);
    picture(&root.path().join("cam_00/image_000.png"), 64, 38);
    picture(&root.path().join("cam_01/image_000.png"), 64, 40);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.format, Format::Spaces);
    let (first, second) = (&scene.views[0].camera, &scene.views[1].camera);
    assert_eq!((first.height(), second.height()), (38, 40));
    let k = first.intrinsics();
    assert_close([k.fx, k.fy, k.cx], [20.0, 20.2, 32.0]);
    assert!((k.cy - 19.0).abs() < 1e-12, "{k:?}");
    // A quarter turn about y: cam_from_world takes −x to forward. Ten ahead, five down.
    assert_close(project(second, 1.0 - 10.0, 2.0 + 5.0, 3.0), [31.25, 20.0 + 10.0, 10.0]);
    assert_says(&notes(&scene), &["2 rig positions", "2 views, such as cam_00/image_000.png 2048x1216 → 64x38"]);
    assert_eq!(scene.view_index("cam_01/image_000.png").unwrap(), 1);
}

#[test]
fn width_scales_photos_down_once_and_intrinsics_with_them() {
    let root = tempdir().unwrap();
    transforms(root.path(), "", "");
    let mut options = SceneOptions::default();
    options.width = Some(20);
    let scene = Scene::open(root.path(), &options).unwrap();
    let camera = &scene.views[0].camera;
    assert_eq!((camera.width(), camera.height()), (20, 15));
    assert!((camera.intrinsics().fx - 50.0 * 20.0 / 64.0).abs() < 1e-12);
    let image = scene.load_image(0).unwrap();
    assert_eq!((image.width(), image.height()), (20, 15));
    // The red gradient survives: column i of 20 averages x / 64 about its centre.
    assert!((image.pixel(10, 7)[0] - 10.5 / 20.0).abs() < 0.02, "{:?}", image.pixel(10, 7));
    let mut wide = SceneOptions::default();
    wide.width = Some(1000);
    assert_eq!(Scene::open(root.path(), &wide).unwrap().views[0].camera.width(), 64);
}

#[test]
fn where_several_formats_lie_in_a_folder_the_others_are_named() {
    let root = tempdir().unwrap();
    poses_bounds(&root.path().join("poses_bounds.npy"), &[LLFF_ROW]);
    TWO.write_binary(&root.path().join("sparse/0"));
    colmap_photos(root.path(), &["b.png"]);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.format, Format::Llff);
    assert_says(&notes(&scene), &["also holds COLMAP: not read"]);
}

#[test]
fn views_are_found_by_name_file_name_and_stem() {
    let root = tempdir().unwrap();
    let names: &[&str] = &["left/0001.png", "left/0002.png", "right/0001.png", "right/0003.png"];
    Colmap { camera: Colmap::PINHOLE, names }.write_text(&root.path().join("sparse/0"));
    colmap_photos(root.path(), names);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.view_index("right/0001.png").unwrap(), 2);
    assert_eq!(scene.view_index("0002.png").unwrap(), 1);
    assert_eq!(scene.view_index("0003").unwrap(), 3);
    let message = scene.view_index("0001").unwrap_err().to_string();
    assert_says(&message, &["several views are named \"0001\"", "left/0001.png, right/0001.png"]);
    let message = scene.view_index("left/0004.png").unwrap_err().to_string();
    assert_says(&message, &["no view is named \"left/0004.png\" among the 4 views", "closest: left/0001.png"]);
}
