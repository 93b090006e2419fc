//! The ways in which programs write a scene: each opens, or is refused in words.

use std::fs;
use std::path::Path;

use liveview_scene::{Scene, SceneOptions};
use tempfile::tempdir;

use crate::scene_common::{Colmap, LLFF_ROW, assert_says, notes, open, picture, poses_bounds, write};

/// What becomes of a scene: the number of its views, the focal length of the first in pixels, and
/// parts of its notes; or parts of the error.
type Expected = Result<(usize, f64, &'static [&'static str]), &'static [&'static str]>;

const OPENS: Expected = Ok((3, 50.0, &[]));
const FOUND: Expected = Ok((3, 50.0, &["3 photos are found under another name than the listed one, such as"]));
const UNDISTORTED: Expected = Ok((3, 50.0, &["undistorted on load"]));

/// A `transforms.json` of three views 1 apart that look along −z, with photos of 64×48.
const FRAMES: &str = r#"{
  "fl_x": 50, "fl_y": 50, "cx": 32, "cy": 24, "w": 64, "h": 48,
  "frames": [
    {"file_path": "images/a.png", "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
    {"file_path": "images/b.png", "transform_matrix": [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
    {"file_path": "images/c.png", "transform_matrix": [[1, 0, 0, 2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
  ]
}"#;

/// Where the photos are: a pattern of which `?` is a, b and c.
const IMAGES: &str = "images/?.png";

/// Paths of photos: the path in place of `images/` and `.png`, where the photos are.
const PATHS: &[(&str, [&str; 2], &str, Expected)] = &[
    ("plain", ["images/", ".png"], IMAGES, OPENS),
    ("leading ./", ["./images/", ".png"], IMAGES, OPENS),
    ("backslashes", [r"images\\", ".png"], IMAGES, OPENS),
    ("absolute", ["/home/me/scan/images/", ".png"], IMAGES, FOUND),
    ("absolute, of Windows", [r"C:\\scans\\toy\\images\\", ".png"], IMAGES, FOUND),
    ("from another folder", ["./data/toy/images/", ".png"], IMAGES, FOUND),
    ("beside the file", ["", ".png"], "?.png", OPENS),
    ("beside the file, listed in images", ["images/", ".png"], "?.png", FOUND),
    ("png for jpg", ["images/", ".jpg"], IMAGES, FOUND),
    ("capital extension", ["images/", ".png"], "images/?.PNG", FOUND),
    ("no extension", ["images/", ""], IMAGES, OPENS),
    ("only reduced photos", ["images/", ".png"], "images_4/?.png", Ok((3, 12.5, &["intrinsics scaled"]))),
    ("from above the folder", ["../images/", ".png"], IMAGES, FOUND),
    (
        "one missing",
        ["images/", ".png"],
        "images/b.png",
        Ok((1, 50.0, &["2 of the listed photos are missing, skipped: "])),
    ),
    ("all missing", ["images/", ".png"], "photo.png", Err(&["images/a.png: missing image", "in the scene folder"])),
    ("all elsewhere", ["/mnt/scan/", ".png"], IMAGES, FOUND),
    ("percent-encoded", ["my%20images/", ".png"], "my images/?.png", FOUND),
    ("in other case", ["Images/", ".PNG"], IMAGES, FOUND),
    ("composed, decomposed on disk", ["K\u{fc}che_", ".png"], "images/Ku\u{308}che_?.png", FOUND),
    ("one folder deeper", ["", ".png"], "images/cam0/?.png", FOUND),
    ("in another folder than images", ["images/", ".png"], "input/?.png", FOUND),
    ("masks alone", ["images/", ".png"], "masks/?.png", Err(&["images/a.png: missing image"])),
];

/// Other parts of the file: a text and its replacement.
const FIELDS: &[(&str, &str, Expected)] = &[
    ("{\n  \"fl_x\"", "\u{feff}{\n  \"fl_x\"", OPENS),
    (r#""w": 64, "h": 48,"#, "", Ok((3, 50.0, &["w and h are missing"]))),
    (r#", "h": 48,"#, ",", Err(&["h is missing", "both w and h"])),
    (r#""w": 64, "h": 48"#, r#""w": 64.0, "h": 48.0"#, OPENS),
    (r#""w": 64, "h": 48"#, r#""w": 640, "h": 480"#, Ok((3, 5.0, &["intrinsics scaled"]))),
    (r#""w": 64"#, r#""w": 80"#, Err(&["the image is 64x48", "declares 80x48"])),
    (r#""fl_x": 50, "fl_y": 50"#, r#""camera_angle_x": 1.5707963267948966"#, Ok((3, 32.0, &[]))),
    (r#""fl_x": 50, "fl_y": 50,"#, "", Err(&["fl_x is missing", "camera_angle_x"])),
    (r#"{"file_path""#, r#"{"fl_x": 70, "w": 64, "h": 48, "file_path""#, Ok((3, 70.0, &[]))),
    (r#"{"file_path""#, r#"{"mask_path": "masks/a.png", "file_path""#, Ok((3, 50.0, &["masks are not supported"]))),
    (r#"{"file_path""#, r#"{"rotation": 0.01, "sharpness": 40.5, "file_path""#, OPENS),
    (", [0, 0, 0, 1]]}", "]}", OPENS),
    ("[1, 0, 0, 1]", "[NaN, 0, 0, 1]", Ok((2, 50.0, &["images/b.png is left out: ", "transform_matrix is [[null"]))),
    ("[1, 0, 0, 1]", "[1.5, 0, 0, 1]", Ok((2, 50.0, &["images/b.png is left out: ", "not orthonormal"]))),
    (
        "[[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0]",
        "[[2, 0, 0, 1], [0, 2, 0, 0], [0, 0, 2, 0]",
        Ok((3, 50.0, &["scaled axes"])),
    ),
    ("[[1, 0,", "[[-1, 0,", Err(&["camera of a.png", "it mirrors"])),
    (
        "[[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
        "[1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]",
        OPENS,
    ),
    (
        "[[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
        "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 1]]",
        Ok((2, 50.0, &["not transposed"])),
    ),
    (
        "images/c.png\", \"transform_matrix\": [[1, 0, 0, 2]",
        "images/b.png\", \"transform_matrix\": [[1, 0, 0, 1]",
        Ok((2, 50.0, &["listed twice with the same pose, read once: images/b.png"])),
    ),
    ("images/c.png", "images/b.png", Err(&["\"images/b.png\" is listed twice"])),
    ("\"frames\": [", "// of this scan\n/* all */ \"frames\": [", OPENS),
    (r#""w": 64, "h": 48"#, r#""w": "64", "h": "48""#, OPENS),
    (r#""fl_x": 50, "fl_y": 50"#, r#""x_fov": 90.0"#, Ok((3, 32.0, &[]))),
    (r#""w""#, r#""is_fisheye": 0, "w""#, OPENS),
    (r#""w""#, r#""is_latlong": true, "w""#, Err(&["is_latlong: a panorama is not supported"])),
    (r#""w""#, r#""ftheta_p0": 0.0, "w""#, Err(&["f-theta lens is not supported"])),
    ("{\"file_path\": \"images/b.png\"", "{\"time\": 1, \"file_path\": \"images/b.png\"", OPENS),
    ("\"frames\"", "\"pictures\"", Err(&["frames is missing; expected a list"])),
    ("\"w\"", r#""camera_model": "SIMPLE_RADIAL", "k1": 0.1, "w""#, UNDISTORTED),
    ("\"w\"", r#""camera_model": "OPENCV", "k1": 0.1, "k2": 0, "p1": 0.01, "w""#, UNDISTORTED),
    ("\"w\"", r#""camera_model": "OPENCV_FISHEYE", "k4": 0.01, "w""#, UNDISTORTED),
    ("\"w\"", r#""is_fisheye": true, "k1": 0.01, "w""#, UNDISTORTED),
    ("\"w\"", r#""camera_model": "FULL_OPENCV", "k6": 0.01, "w""#, UNDISTORTED),
    ("\"w\"", r#""k4": 0.01, "w""#, Err(&["distortion k4 = 0.01 is not supported"])),
    ("\"w\"", r#""is_fisheye": true, "p1": 0.01, "w""#, Err(&["distortion p1 = 0.01 of a fisheye is not supported"])),
    ("\"w\"", r#""camera_model": "EQUIRECTANGULAR", "w""#, Err(&["camera_model EQUIRECTANGULAR is not supported"])),
    ("\"w\"", r#""camera_model": "NEW", "w""#, Ok((3, 50.0, &["camera_model NEW is unknown"]))),
];

/// COLMAP models: the folder, the camera, where the photos are.
const COLMAP: &[(&str, &str, &str, Expected)] = &[
    ("sparse/0", Colmap::PINHOLE, IMAGES, OPENS),
    ("sparse", Colmap::PINHOLE, IMAGES, OPENS),
    ("", Colmap::PINHOLE, IMAGES, OPENS),
    ("colmap/sparse/0", Colmap::PINHOLE, IMAGES, OPENS),
    ("sparse/0", Colmap::PINHOLE, "images_4/?.png", Ok((3, 12.5, &["photos are read from images_4"]))),
    ("sparse/0", Colmap::PINHOLE, "images/?.jpg", FOUND),
    (
        "sparse/0",
        Colmap::PINHOLE,
        "images/b.png",
        Ok((1, 50.0, &["2 of the listed photos are missing, skipped: images/a.png, images/c.png"])),
    ),
    ("sparse/0", Colmap::PINHOLE, "?.png", OPENS),
    ("sparse/0", Colmap::PINHOLE, "input/?.png", Ok((3, 50.0, &["photos are read from input"]))),
    ("sparse/0", Colmap::PINHOLE, "images/cam0/?.png", FOUND),
    ("sparse/3", Colmap::PINHOLE, IMAGES, OPENS),
    ("distorted/sparse/0", Colmap::PINHOLE, IMAGES, OPENS),
    ("sparse/0", Colmap::PINHOLE, "elsewhere.png", Err(&["a.png: missing image"])),
    ("sparse/0", "SIMPLE_RADIAL 64 48 50 32 24 0.1", IMAGES, UNDISTORTED),
    ("sparse/0", "FULL_OPENCV 64 48 50 50 32 24 0.1 0 0 0 0 0.01 0 0", IMAGES, UNDISTORTED),
    ("sparse/0", "OPENCV_FISHEYE 64 48 50 50 32 24 0 0 0 0", IMAGES, UNDISTORTED),
    ("sparse/0", "RADIAL_FISHEYE 64 48 50 32 24 0.1 0.01", IMAGES, UNDISTORTED),
    ("sparse/0", "SIMPLE_DIVISION 64 48 50 32 24 -0.1", IMAGES, UNDISTORTED),
    ("sparse/0", "FISHEYE 64 48 50 50 32 24", IMAGES, UNDISTORTED),
    ("sparse/0", "EUCM 64 48 50 50 32 24 0.5 1", IMAGES, Err(&["camera model EUCM is not supported"])),
    ("sparse/0", "FOV 64 48 50 50 32 24 0.1", IMAGES, Err(&["camera model FOV is not supported", "image_undistorter"])),
];

/// Writes the photos of a pattern; those in `images_4` have a quarter of the size.
fn photos(root: &Path, pattern: &str) {
    let side = if pattern.starts_with("images_4") { 4 } else { 1 };
    for name in ["a", "b", "c"] {
        picture(&root.join(pattern.replace('?', name)), 64 / side, 48 / side);
    }
}

fn check(variant: &str, scene: &Path, expected: Expected) {
    match (open(scene), expected) {
        (Ok(scene), Ok((count, fx, says))) => {
            let found = scene.views[0].camera.intrinsics().fx;
            assert!(scene.views.len() == count && (found - fx).abs() < 1e-12, "{variant}: {count} views, fx {found}");
            assert_says(&notes(&scene), says);
            for view in 0..count {
                assert_eq!(scene.load_image(view).unwrap().size(), scene.views[view].camera.size(), "{variant}");
            }
        }
        (Err(error), Err(says)) => assert_says(&error.to_string(), says),
        (found, expected) => panic!("{variant}: {:?}, expected {expected:?}", found.map(|scene| scene.notes)),
    }
}

#[test]
fn photos_of_transforms_json_are_found_or_missed_in_words() {
    for (variant, [before, after], pattern, expected) in PATHS {
        let root = tempdir().unwrap();
        let text = FRAMES.replace("images/", before).replace(".png", after);
        write(&root.path().join("transforms.json"), text);
        photos(root.path(), pattern);
        check(variant, root.path(), *expected);
    }
}

#[test]
fn fields_of_transforms_json_are_read_or_refused_in_words() {
    for (from, to, expected) in FIELDS {
        let root = tempdir().unwrap();
        assert!(FRAMES.contains(from), "{from}");
        write(&root.path().join("transforms.json"), FRAMES.replace(from, to));
        photos(root.path(), IMAGES);
        check(to, root.path(), *expected);
    }
}

#[test]
fn colmap_models_are_read_or_refused_in_words() {
    for (folder, camera, pattern, expected) in COLMAP {
        let root = tempdir().unwrap();
        Colmap { camera, names: &["a.png", "b.png", "c.png"] }.write_text(&root.path().join(folder));
        photos(root.path(), pattern);
        check(&format!("{folder} {camera} {pattern}"), root.path(), *expected);
    }
}

#[test]
fn file_of_any_name_is_a_scene() {
    let root = tempdir().unwrap();
    let blender = FRAMES.replace(r#""fl_x": 50, "fl_y": 50"#, r#""camera_angle_x": 1.5707963267948966"#);
    let blender = blender.replace(r#""cx": 32, "cy": 24, "w": 64, "h": 48,"#, "").replace(".png", "");
    for part in ["train", "test"] {
        let text = blender.replace("images/", &format!("./{part}/"));
        write(&root.path().join(format!("transforms_{part}.json")), text);
    }
    photos(root.path(), "train/?.png");
    photos(root.path(), "test/?.png");
    check("Blender's folder", root.path(), Ok((6, 32.0, &["the 3 photos of transforms_test.json are targets only"])));
    let scene = open(root.path()).unwrap();
    let targets: Vec<&str> = scene.held_out().into_iter().map(|view| scene.views[view].name.as_str()).collect();
    assert_eq!(targets, ["test/a.png", "test/b.png", "test/c.png"]);
    assert_eq!(scene.view_index("./test/b").unwrap(), scene.held_out()[1]);
    check("Blender's test photos", &root.path().join("transforms_test.json"), Ok((6, 32.0, &["targets only"])));
    fs::remove_file(root.path().join("transforms_train.json")).unwrap();
    check("Blender's test photos alone", &root.path().join("transforms_test.json"), Ok((3, 32.0, &[])));
    write(&root.path().join("poses.txt"), "1 0 0 0");
    check("another file", &root.path().join("poses.txt"), Err(&["poses.txt: is not a folder", "a transforms.json"]));
    write(&root.path().join("transforms.json"), FRAMES);
    photos(root.path(), IMAGES);
    check("transforms.json first", root.path(), OPENS);
    check("the file", &root.path().join("transforms.json"), OPENS);
}

#[test]
fn portrait_photos_among_others_keep_their_size() {
    let root = tempdir().unwrap();
    let text = FRAMES.replacen(r#"{"file_path""#, r#"{"w": 48, "h": 64, "cx": 24, "cy": 32, "file_path""#, 1);
    write(&root.path().join("transforms.json"), text);
    photos(root.path(), IMAGES);
    picture(&root.path().join("images/a.png"), 48, 64);
    check("portrait", root.path(), OPENS);
    let sizes: Vec<String> =
        open(root.path()).unwrap().views.iter().map(|view| view.camera.size().to_string()).collect();
    assert_eq!(sizes, ["48x64", "64x48", "64x48"]);
}

#[test]
fn images_option_takes_reduced_photos_of_transforms_json() {
    let root = tempdir().unwrap();
    write(&root.path().join("transforms.json"), FRAMES);
    photos(root.path(), IMAGES);
    photos(root.path(), "images_4/?.png");
    let options = SceneOptions { images: Some("images_4".to_owned()), ..SceneOptions::default() };
    let scene = Scene::open(root.path(), &options).unwrap();
    assert_eq!((scene.views.len(), scene.views[0].camera.width()), (3, 16));
    write(&root.path().join("transforms.json"), FRAMES.replace("images/", "photos/"));
    let message = Scene::open(root.path(), &options).unwrap_err().to_string();
    assert_says(&message, &["frames[0]: file_path is \"photos/a.png\"", "a photo in images/"]);
}

#[test]
fn other_formats_are_read_or_refused_in_words() {
    let root = tempdir().unwrap();
    check("empty folder", root.path(), Err(&["no scene found", "transforms.json", "sparse/0"]));
    check("no folder", &root.path().join("nowhere"), Err(&["nowhere: does not exist"]));
    poses_bounds(&root.path().join("poses_bounds.npy"), &[LLFF_ROW; 3]);
    check("LLFF without photos", root.path(), Err(&["no photo folder; expected one of: images_8"]));
    photos(root.path(), "images_4/?.png");
    check("LLFF, reduced", root.path(), Ok((3, 20.0, &["photos are read from images_4"])));
    picture(&root.path().join("images_4/d.png"), 16, 12);
    check("LLFF, one photo more", root.path(), Err(&["3 poses, but", "holds 4 images"]));
}
