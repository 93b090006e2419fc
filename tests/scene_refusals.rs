//! Bad input: every refusal names the file, the field and what was expected, and nothing panics.

mod scene_common;

use std::fs;

use liveview::geometry::MAX_SIDE;
use liveview::image;
use proptest::prelude::*;
use scene_common::{
    Bytes, Colmap, LLFF_ROW, assert_says, crc32, open, picture, poses_bounds, refusal, transforms, write,
};
use tempfile::tempdir;

#[test]
fn no_scene() {
    let root = tempdir().unwrap();
    assert_says(&refusal(root.path()), &["no scene found", "transforms.json", "poses_bounds.npy", "sparse/0"]);
    assert_says(&refusal(&root.path().join("nowhere")), &["nowhere: does not exist"]);
    let file = root.path().join("transforms.json");
    write(&file, "{}");
    assert_says(&refusal(&file), &["is not a folder"]);
}

/// Refusals of `transforms.json`: a piece of the text, what replaces it, and what the message must say.
const TRANSFORMS: &[(&str, &str, &[&str])] = &[
    ("images/a.png", "images/b.png", &["images/b.png: missing image, listed in", "transforms.json"]),
    ("images/a.png", "../a.png", &["the path \"../a.png\" leaves the scene folder"]),
    ("images/a.png", "images/../../a.png", &["leaves the scene folder"]),
    ("images/a.png", "/etc/a.png", &["the path \"/etc/a.png\" leaves the scene folder"]),
    ("images/a.png", "", &["the path \"\" leaves the scene folder"]),
    ("\"w\": 64", "\"w\": 65.5", &["w is 65.5", "a whole number of pixels"]),
    ("\"w\": 64, ", "", &["w is missing", "both w and h"]),
    ("\"w\": 64", "\"w\": 80", &["image of another size than declared: it is 64x48", "says 80x48"]),
    ("50.0", "NaN", &["transforms.json", "line 2", "\"fl_x\": NaN", "finite"]),
    ("50.0", "1e999", &["line 2", "\"fl_x\": 1e999", "finite"]),
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
    ("\"w\"", "\"camera_model\": \"OPENCV_FISHEYE\", \"w\"", &["camera_model OPENCV_FISHEYE is not supported"]),
    ("\"w\"", "\"is_fisheye\": true, \"w\"", &["is_fisheye is not supported"]),
    ("\"w\"", "\"k4\": 0.1, \"w\"", &["distortion k4 = 0.1 is not supported"]),
    ("}\n  ]", "},\n 7\n  ]", &["frames[1] is no object"]),
    ("{", "[", &["transforms.json", "line"]),
];

#[test]
fn transforms_json_refusals() {
    for (from, to, parts) in TRANSFORMS {
        let root = tempdir().unwrap();
        transforms(root.path(), from, to);
        assert_says(&refusal(root.path()), parts);
    }
}

#[test]
fn a_photo_listed_twice() {
    let root = tempdir().unwrap();
    let frame = "{\"file_path\": \"./images/a.png\", \"transform_matrix\": \
                 [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},";
    transforms(root.path(), "\"frames\": [", &format!("\"frames\": [{frame}"));
    assert_says(&refusal(root.path()), &["\"images/a.png\" is listed twice"]);
}

#[test]
fn truncated_images_are_named_on_load() {
    for name in ["a.png", "a.jpg"] {
        let root = tempdir().unwrap();
        transforms(root.path(), "images/a.png", &format!("images/{name}"));
        let path = root.path().join("images").join(name);
        picture(&path, 64, 48);
        let whole = fs::read(&path).unwrap();
        assert!(open(root.path()).unwrap().load_image(0).is_ok(), "{name}");
        for keep in [whole.len() * 3 / 4, whole.len() * 95 / 100, whole.len() - 3] {
            fs::write(&path, &whole[..keep]).unwrap();
            // The header survives, so the scene opens.
            let scene = open(root.path()).unwrap();
            let message = match scene.load_image(0) {
                // A PNG's last bytes are a checksum of nothing.
                Ok(_) if name == "a.png" && keep == whole.len() - 3 => continue,
                Ok(_) => panic!("{name} cut to {keep} of {} bytes was read", whole.len()),
                Err(error) => error.to_string(),
            };
            assert_says(&message, &[name, "not a complete PNG or JPEG image"]);
        }
        fs::write(&path, &whole[..10]).unwrap();
        assert_says(&refusal(root.path()), &[name, "not a complete PNG or JPEG image"]);
        fs::write(&path, "no picture").unwrap();
        assert_says(&refusal(root.path()), &[name, "unknown kind of file"]);
    }
}

#[test]
fn oversized_images_are_refused_before_decoding() {
    let root = tempdir().unwrap();
    let path = root.path().join("wide.png");
    // A PNG's header with its width overwritten; nothing else of such a picture exists.
    picture(&path, 8, 8);
    let mut bytes = fs::read(&path).unwrap();
    bytes[16..20].copy_from_slice(&20_000_u32.to_be_bytes());
    let checksum = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
    fs::write(&path, bytes).unwrap();
    for result in [image::load(&path).map(|_| ()), image::read_size(&path).map(|_| ())] {
        let message = result.unwrap_err().to_string();
        assert_says(&message, &["wide.png", "20000x8", &MAX_SIDE.to_string()]);
    }
}

#[test]
fn llff_refusals() {
    let root = tempdir().unwrap();
    let poses = root.path().join("poses_bounds.npy");
    poses_bounds(&poses, &[LLFF_ROW, LLFF_ROW]);
    assert_says(&refusal(root.path()), &["no folder of photos", "images_8, images_4, images_2, images"]);
    picture(&root.path().join("images/a.png"), 64, 48);
    assert_says(&refusal(root.path()), &["poses_bounds.npy: 2 poses", "images holds 1 images"]);
    picture(&root.path().join("images/a.png"), 64, 24);
    poses_bounds(&poses, &[LLFF_ROW]);
    assert_says(&refusal(root.path()), &["it is 64x24", "says 64x48"]);
    picture(&root.path().join("images/a.png"), 64, 48);
    for (index, value, parts) in [
        (14, f64::NAN, ["camera of a.png", "fx is NaN"]),
        (2, 0.5, ["camera of a.png", "not orthonormal"]),
        (4, f64::INFINITY, ["row 0: height is inf", "a whole number of pixels"]),
        (9, -64.0, ["row 0: width is -64", "a whole number of pixels"]),
    ] {
        let mut row = LLFF_ROW;
        row[index] = value;
        poses_bounds(&poses, &[row]);
        assert_says(&refusal(root.path()), &parts);
    }
    ndarray_npy::write_npy(&poses, &ndarray::Array2::<f64>::zeros((1, 15))).unwrap();
    assert_says(&refusal(root.path()), &["poses_bounds.npy", "shape [1, 15]", "17 numbers"]);
    ndarray_npy::write_npy(&poses, &ndarray::Array2::<f32>::zeros((1, 17))).unwrap();
    assert_says(&refusal(root.path()), &["poses_bounds.npy", "float64"]);
}

#[test]
fn llff_bounds_that_are_no_range_are_left_out_and_named() {
    let root = tempdir().unwrap();
    let mut row = LLFF_ROW;
    row[15] = f64::NAN;
    poses_bounds(&root.path().join("poses_bounds.npy"), &[row]);
    picture(&root.path().join("images/a.png"), 64, 48);
    let scene = open(root.path()).unwrap();
    assert_eq!(scene.views[0].depth_range, None);
    assert_says(&scene.notes.join("\n"), &["depth range left out", "a.png (NaN to 20.0)"]);
}

#[test]
fn llff_shape_beyond_the_file_is_refused_unallocated() {
    let root = tempdir().unwrap();
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (4000000000000, 17), }";
    let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    bytes.extend(format!("{header:<117}\n").as_bytes());
    bytes.extend([0; 64]);
    write(&root.path().join("poses_bounds.npy"), bytes);
    assert_says(&refusal(root.path()), &["poses_bounds.npy", "expected a float64 array"]);
}

/// What fuzzing found (`make fuzz`): a header that took for ever to parse, a photo that the decoder panics at.
#[test]
fn what_fuzzing_found() {
    let root = tempdir().unwrap();
    write(&root.path().join("poses_bounds.npy"), include_bytes!("fixtures/damaged/nested_braces.npy"));
    assert_says(&refusal(root.path()), &["poses_bounds.npy: a header of 116 bytes with", "brackets open"]);
    let photo = root.path().join("photo.jpg");
    write(&photo, include_bytes!("fixtures/damaged/fine_chroma.jpg"));
    let message = image::load(&photo).unwrap_err().to_string();
    assert_says(&message, &["photo.jpg: not a complete PNG or JPEG", "sampled more finely than the first"]);
}

const ONE: Colmap<'_> = Colmap { camera: Colmap::PINHOLE, names: &["a.png"] };

#[test]
fn colmap_huge_counts_are_refused_unallocated() {
    for (file, what) in [("cameras.bin", "cameras"), ("images.bin", "images"), ("points3D.bin", "points")] {
        for count in [u64::MAX, 1 << 40, 100_000] {
            let root = tempdir().unwrap();
            ONE.write_binary(&root.path().join("sparse/0"));
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
    ONE.write_binary(&root.path().join("sparse/0"));
    let images = Bytes::default().u64(1).u32(1).f64(1.0).f64(0.0).f64(0.0).f64(0.0).f64(0.0).f64(0.0).f64(0.0);
    write(&root.path().join("sparse/0/images.bin"), images.u32(1).text("a.png").u64(1 << 60).0);
    assert_says(&refusal(root.path()), &["images.bin", "keypoints are declared"]);
}

#[test]
fn colmap_cut_anywhere_is_refused_or_read() {
    let root = tempdir().unwrap();
    picture(&root.path().join("images/a.png"), 64, 48);
    for file in ["cameras.bin", "images.bin", "points3D.bin"] {
        let folder = root.path().join("sparse/0");
        ONE.write_binary(&folder);
        let whole = fs::read(folder.join(file)).unwrap();
        for keep in 0..whole.len() {
            fs::write(folder.join(file), &whole[..keep]).unwrap();
            assert_says(&refusal(root.path()), &[file, "expected"]);
        }
    }
}

/// Refusals of COLMAP text: the camera line, the photo's name, and what the message must say.
const COLMAP: &[(&str, &str, &[&str])] = &[
    (
        "OPENCV_FISHEYE 64 48 50 50 30 25 0 0 0 0",
        "a.png",
        &["cameras.txt: camera model OPENCV_FISHEYE is not supported"],
    ),
    ("FULL_OPENCV 64 48 50 50 30 25 0 0 0 0 0 0 0 0", "a.png", &["camera model FULL_OPENCV is not supported"]),
    ("PINHOLE 64 48 50 30 25", "a.png", &["cameras.txt", "PINHOLE camera with 3 parameters"]),
    ("PINHOLE 64 48 50 sixty 30 25", "a.png", &["cameras.txt: line 2: word 6 is \"sixty\"", "PARAMS"]),
    ("PINHOLE 64 48 nan 50 30 25", "a.png", &["cameras.txt: camera of model PINHOLE: fx is NaN"]),
    ("RADIAL 64 48 50 30 25 inf 0", "a.png", &["cameras.txt: camera of model RADIAL: k1 is inf"]),
    ("PINHOLE 80 60 50 50 30 25", "a.png", &["a.png: image of another size than declared: it is 64x48", "80x60"]),
    ("PINHOLE 18446744073709551615 48 50 50 30 25", "a.png", &["a.png: image of another size"]),
    ("PINHOLE 64 48 50 50 30 25", "b.png", &["images/b.png: missing image, listed in", "images.txt"]),
    ("PINHOLE 64 48 50 50 30 25", "../a.png", &["the path \"../a.png\" leaves the scene folder"]),
];

#[test]
fn colmap_refusals() {
    for (camera, name, parts) in COLMAP {
        let root = tempdir().unwrap();
        picture(&root.path().join("images/a.png"), 64, 48);
        let folder = root.path().join("sparse/0");
        Colmap { camera, names: &[name] }.write_text(&folder);
        assert_says(&refusal(root.path()), parts);
    }
    let root = tempdir().unwrap();
    picture(&root.path().join("images/a.png"), 64, 48);
    let folder = root.path().join("sparse/0");
    ONE.write_text(&folder);
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
fn colmap_records_that_are_there_twice_or_beyond_the_last() {
    let root = tempdir().unwrap();
    picture(&root.path().join("images/a.png"), 64, 48);
    let folder = root.path().join("sparse/0");
    ONE.write_text(&folder);
    for file in ["cameras.txt", "points3D.txt"] {
        let path = folder.join(file);
        let text = fs::read_to_string(&path).unwrap();
        write(&path, format!("{text}{text}"));
        let what = if file == "cameras.txt" { "camera 1 a second time" } else { "point 1 a second time" };
        assert_says(&refusal(root.path()), &[file, what]);
        write(&path, text);
    }
    ONE.write_binary(&folder);
    open(root.path()).unwrap();
    for file in ["cameras.bin", "images.bin", "points3D.bin"] {
        let path = folder.join(file);
        let bytes = fs::read(&path).unwrap();
        write(&path, [&bytes[..], b"more"].concat());
        assert_says(&refusal(root.path()), &[file, "4 bytes after the last", "expected the end of the file"]);
        let twice = [&2_u64.to_le_bytes(), &bytes[8..], &bytes[8..]].concat();
        if file == "cameras.bin" {
            write(&path, twice);
            assert_says(&refusal(root.path()), &[file, "camera 1 a second time"]);
        }
        write(&path, bytes);
    }
}

#[test]
fn realestate10k_refusals() {
    let root = tempdir().unwrap();
    picture(&root.path().join("frames/1000.png"), 64, 40);
    let pose = "1 0 0 0 0 1 0 0 0 0 1 0";
    for (line, parts) in [
        (format!("1000 .5 .8 .5 .5 0 0 {pose} 4"), ["line 2: 20 words", "timestamp fx fy cx cy 0 0"]),
        (format!("1000 .5 .8 .5 x 0 0 {pose}"), ["line 2: \"x\" is no number", "timestamp"]),
        (format!("1000 .5 .8 .5 .5 0.1 0 {pose}"), ["line 2: columns 6 and 7 are 0.1 and 0", "timestamp"]),
        (format!("1000 nan .8 .5 .5 0 0 {pose}"), ["cameras.txt: camera of 1000.png", "fx is NaN"]),
        ("1000 .5 .8 .5 .5 0 0 1 0 0 0 0 1 0 0 0 0 2 0".to_owned(), ["camera of 1000.png", "not orthonormal"]),
        (format!("2000 .5 .8 .5 .5 0 0 {pose}"), ["none of its 1 timestamps has a picture", "frames"]),
        (format!("1000 .5 .8 .5 .5 0 0 {pose}\n1000 .5 .8 .5 .5 0 0 {pose}"), ["frames/1000.png", "is listed twice"]),
        ("1000".to_owned(), ["line 2: one word", "timestamp"]),
    ] {
        write(&root.path().join("cameras.txt"), format!("https://example.org\n{line}\n"));
        assert_says(&refusal(root.path()), &parts);
    }
}

#[test]
fn spaces_refusals() {
    let camera = r#"{"principal_point": [32, 24], "pixel_aspect_ratio": 1, "position": [0, 0, 0], "focal_length": 50,
        "width": 64, "height": 48, "relative_path": "a.png", "orientation": [0, 0, 0]}"#;
    let root = tempdir().unwrap();
    picture(&root.path().join("a.png"), 64, 48);
    for (from, to, parts) in [
        ("[32, 24]", "[32]", ["[0][0]: principal_point is [32]", "2 numbers"]),
        ("\"focal_length\"", "\"focal\"", ["[0][0]: focal_length is missing", "a number"]),
        ("\"height\": 48", "\"height\": 20", ["a.png: image of another size than declared", "64x20"]),
        ("a.png", "../../a.png", ["models.json", "leaves the scene folder"]),
        ("a.png", "b.png", ["b.png: missing image", "models.json"]),
        ("\"focal_length\": 50", "\"focal_length\": -1", ["camera of a.png", "K is singular: fx is -1"]),
    ] {
        write(&root.path().join("models.json"), format!("[[{}]]", camera.replace(from, to)));
        assert_says(&refusal(root.path()), &parts);
    }
    write(&root.path().join("models.json"), "[]");
    assert_says(&refusal(root.path()), &["rig position 0 of 0", "a list of cameras"]);
    write(&root.path().join("models.json"), "[[]]");
    assert_says(&refusal(root.path()), &["no views"]);
}

#[test]
fn saved_pictures_come_back() {
    let root = tempdir().unwrap();
    let values: Vec<f32> = (0..5 * 3 * 3).map(|i| i as f32 / 44.0).collect();
    let picture = image::ImageRgb::new(5, 3, values).unwrap();
    let path = root.path().join("out.png");
    picture.save(&path).unwrap();
    let back = image::load(&path).unwrap();
    let worst = picture.data().iter().zip(back.data()).fold(0.0_f32, |worst, (a, b)| worst.max((a - b).abs()));
    assert!(worst <= 0.5 / 255.0 + 1e-6, "{worst}");
    let depth: Vec<u16> = (0..15).map(|i| i * 4000).collect();
    let grey = image::encode_gray16_png(5, 3, &depth).unwrap();
    assert_eq!(::image::load_from_memory(&grey).unwrap().into_luma16().into_raw(), depth);
    // Only the file is left, none under a temporary name.
    assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1);
    let odd = image::ImageRgb::new(1, 1, vec![f32::NAN, -1.0, 7.0]).unwrap();
    odd.save(&path).unwrap();
    assert_eq!(image::load(&path).unwrap().pixel(0, 0), [0.0, 0.0, 1.0]);
}

#[test]
fn unwritable_outputs_and_wrong_buffers_are_named() {
    let root = tempdir().unwrap();
    let picture = image::ImageRgb::new(1, 1, vec![0.0; 3]).unwrap();
    let message = picture.save(root.path().join("no/where.png")).unwrap_err().to_string();
    assert_says(&message, &["where.png: cannot be written"]);
    fs::create_dir(root.path().join("folder.png")).unwrap();
    let message = picture.save(root.path().join("folder.png")).unwrap_err().to_string();
    assert_says(&message, &["folder.png: cannot be written"]);
    assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1, "the temporary file is gone");
    let message = image::ImageRgb::new(2, 2, vec![0.0; 11]).unwrap_err().to_string();
    assert_eq!(message, "11 values given for a 2x2 image with 3 channels");
    let message = image::encode_gray16_png(usize::MAX, 2, &[]).unwrap_err().to_string();
    assert_says(&message, &["0 values given"]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Any change of a few bytes in any file of a scene: read or refused, never a panic.
    #[test]
    fn damaged_files_never_panic(file in 0..5_usize, at in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let root = tempdir().unwrap();
        let path = match file {
            0..3 => {
                ONE.write_binary(&root.path().join("sparse/0"));
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
