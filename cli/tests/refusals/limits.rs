//! Files that declare, or have, more data than fits in memory: refused by name before memory is
//! allocated. The tests run in 1 GiB of address space, where an allocation of the declared size
//! would end the process.

#![cfg(unix)]

use std::fs::{self, File};
use std::path::Path;
use std::time::Duration;

use assert_cmd::Command;
use image::ImageEncoder;

use crate::common::{Folders, fixture};
use crate::scene_common::{Bytes, Colmap, LLFF_ROW, poses_bounds, write};

const NAMES: [&str; 5] = ["0.png", "1.png", "2.png", "3.png", "4.png"];

/// `liveview COMMAND scene ARGUMENTS` in 1 GiB of address space.
fn in_one_gibibyte(folders: &Folders, command: &str, arguments: &[&str]) -> Command {
    let mut shell = Command::new("sh");
    shell.args(["-c", "ulimit -v 1048576 && exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_liveview"), command]);
    // Each thread would reserve address space.
    shell.arg(folders.scene()).args(arguments).env("RAYON_NUM_THREADS", "1").env("MALLOC_ARENA_MAX", "1");
    shell
}

fn assert_inspect_refused(folders: &Folders, words: &[&str]) {
    folders.assert_refused(&mut in_one_gibibyte(folders, "inspect", &[]), words);
}

/// Asserts that a render with the tiny model is refused.
fn assert_render_refused(folders: &Folders, arguments: &[&str], words: &[&str]) {
    let (picture, model) = (folders.out("a.png"), fixture("tiny_v4"));
    let arguments = [&["-o", &picture, "--model", &model, "--threads", "1"], arguments].concat();
    folders.assert_refused(&mut in_one_gibibyte(folders, "render", &arguments), words);
}

/// The tiny scene without its `transforms.json`.
fn photos_only() -> Folders {
    let folders = Folders::new();
    fs::remove_file(folders.scene().join("transforms.json")).unwrap();
    folders
}

/// Writes a sparse file of 4 GiB that begins with these bytes.
fn write_huge(path: &Path, start: &[u8]) {
    write(path, start);
    File::options().write(true).open(path).unwrap().set_len(4 << 30).unwrap();
}

fn spaces(width: usize, height: usize, path: &str) -> String {
    format!(
        r#"[[{{"principal_point": [32, 24], "pixel_aspect_ratio": 1, "position": [0, 0, 0], "focal_length": 60,
        "width": {width}, "height": {height}, "relative_path": "{path}", "orientation": [0, 0, 0]}}]]"#
    )
}

#[test]
fn tiny_scene_fits() {
    let folders = Folders::new();
    in_one_gibibyte(&folders, "inspect", &[]).assert().success();
}

#[test]
fn photo_that_declares_60000_pixels_is_an_error() {
    let folders = Folders::new();
    let side = 60_000_u32.to_be_bytes();
    let mut png = fs::read(folders.photo(3)).unwrap();
    png[16..20].copy_from_slice(&side);
    png[20..24].copy_from_slice(&side);
    let checksum = crate::scene_common::crc32(&png[12..29]);
    png[29..33].copy_from_slice(&checksum.to_be_bytes());

    let photo = folders.scene().join("photo.jpg");
    crate::scene_common::picture(&photo, 64, 48);
    let mut jpeg = fs::read(&photo).unwrap();
    let frame = jpeg.windows(2).position(|marker| marker == [0xFF, 0xC0]).unwrap();
    jpeg[frame + 5..frame + 7].copy_from_slice(&side[2..]);
    jpeg[frame + 7..frame + 9].copy_from_slice(&side[2..]);

    for bytes in [png, jpeg] {
        fs::write(folders.photo(3), bytes).unwrap();
        let output = folders.liveview("inspect", &[]).output().unwrap();
        let notes = [&output.stdout[..], &output.stderr].concat();
        let notes = String::from_utf8_lossy(&notes).into_owned();
        for words in ["images/3.png is left out", "the image is 60000x60000", "at most 16384"] {
            assert!(output.status.success() && notes.contains(words), "{words}: {notes}");
        }
    }
}

#[test]
fn colour_profile_that_expands_to_gigabytes_is_ignored() {
    let folders = Folders::new();
    let mut png = Vec::new();
    let mut encoder = image::codecs::png::PngEncoder::new(&mut png);
    encoder.set_icc_profile(vec![0; 1 << 30]).unwrap();
    encoder.write_image(&[0; 64 * 48 * 3], 64, 48, image::ExtendedColorType::Rgb8).unwrap();
    assert!(png.len() < 8 << 20, "{} bytes", png.len());
    fs::write(folders.photo(3), png).unwrap();
    let (picture, model) = (folders.out("a.png"), fixture("tiny_v4"));
    let arguments = ["--target", "2", "-o", &picture, "--model", &model, "--threads", "1"];
    // The decoder drops the profile and reads the picture without it.
    in_one_gibibyte(&folders, "render", &arguments).assert().success();
}

#[test]
fn camera_that_declares_60000_pixels_is_an_error() {
    let folders = Folders::new();
    folders.write_scene(5, r#""w": 64, "h": 48"#, r#""w": 60000, "h": 45000"#);
    assert_inspect_refused(&folders, &["transforms.json", "image size is 60000x45000", "1 to 16384"]);
    folders.write_scene(5, r#""w": 64, "h": 48"#, r#""w": 60000, "h": 60000"#);
    assert_inspect_refused(&folders, &["images/0.png", "the image is 64x48", "transforms.json declares 60000x60000"]);

    let folders = photos_only();
    let model = folders.scene().join("sparse/0");
    Colmap { camera: Colmap::PINHOLE, names: &NAMES }.write_binary(&model);
    let cameras = Bytes::default().u64(1).u32(1).u32(1).u64(60_000).u64(45_000);
    write(&model.join("cameras.bin"), cameras.f64(50.0).f64(60.0).f64(30.0).f64(25.0).0);
    assert_inspect_refused(&folders, &["images.bin", "camera of 0.png", "image size is 60000x45000", "1 to 16384"]);

    let folders = photos_only();
    let mut row = LLFF_ROW;
    (row[4], row[9]) = (45_000.0, 60_000.0);
    poses_bounds(&folders.scene().join("poses_bounds.npy"), &[row; 5]);
    assert_inspect_refused(&folders, &["poses_bounds.npy", "image size is 60000x45000", "1 to 16384"]);

    let folders = photos_only();
    write(&folders.scene().join("models.json"), spaces(60_000, 45_000, "images/0.png"));
    assert_inspect_refused(&folders, &["models.json", "image size is 60000x45000", "1 to 16384"]);
}

#[test]
fn colmap_count_of_2_to_the_63_is_an_error() {
    let count = 1_u64 << 63;
    let pose = Bytes::default().u64(1).u32(1).f64(1.0).f64(0.0).f64(0.0).f64(0.0).f64(0.0).f64(0.0).f64(0.0);
    let keypoints = pose.u32(1).text("0.png").u64(count).0;
    for (file, what, bytes) in [
        ("cameras.bin", "cameras", Bytes::default().u64(count).0),
        ("images.bin", "images", Bytes::default().u64(count).0),
        ("images.bin", "keypoints", keypoints),
    ] {
        let folders = photos_only();
        Colmap { camera: Colmap::PINHOLE, names: &NAMES }.write_binary(&folders.scene().join("sparse/0"));
        write(&folders.scene().join("sparse/0").join(file), bytes);
        assert_inspect_refused(&folders, &[file, &format!("{count} {what} are declared"), "at most the 0 that fit"]);
    }
}

/// An array file with this header.
fn npy(header: &str) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x02\x00".to_vec();
    bytes.extend((header.len() as u32).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes
}

#[test]
fn array_with_an_excessive_header_is_an_error() {
    let folders = photos_only();
    let path = folders.scene().join("poses_bounds.npy");
    let nested = |depth: usize| format!("{{'shape': {}{}}}\n", "(".repeat(depth), ")".repeat(depth));
    for header in [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (9223372036854775808, 17), }\n".to_owned(),
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1099511627776, 17), }\n".to_owned(),
        "{'descr': '<f8', 'fortran_order': False, 'shape': (0, 99999999999999999999999999), }\n".to_owned(),
        nested(400),
        nested(10_000),
        nested(1_000_000),
    ] {
        write(&path, npy(&header));
        assert_inspect_refused(&folders, &["poses_bounds.npy", "of N rows with 17 numbers"]);
    }
    write(&path, b"\x93NUMPY\x02\x00\xff\xff\xff\xff{");
    assert_inspect_refused(&folders, &["poses_bounds.npy", "of N rows with 17 numbers"]);
}

#[test]
fn deeply_nested_json_is_an_error() {
    let deep = "[".repeat(1_000_000);
    let folders = Folders::new();
    fs::write(folders.scene().join("transforms.json"), format!("{{\"frames\": {deep}")).unwrap();
    assert_inspect_refused(&folders, &["transforms.json", "recursion limit exceeded", "line 1"]);
    let folders = photos_only();
    fs::write(folders.scene().join("models.json"), &deep).unwrap();
    assert_inspect_refused(&folders, &["models.json", "recursion limit exceeded", "line 1"]);
    let folders = Folders::new();
    let pose = folders.scene().join("pose.json");
    fs::write(&pose, &deep).unwrap();
    assert_render_refused(&folders, &["--pose", pose.to_str().unwrap()], &["pose.json", "recursion limit exceeded"]);
}

#[test]
fn path_that_leaves_the_scene_folder_is_an_error() {
    for name in ["../../etc/x.png", "/etc/x.png", "images/../../x.png", "..", ""] {
        let message = format!("the path \"{name}\" leaves the scene folder");
        for binary in [true, false] {
            let folders = photos_only();
            let colmap = Colmap { camera: Colmap::PINHOLE, names: &[name] };
            let model = folders.scene().join("sparse/0");
            if binary {
                colmap.write_binary(&model)
            } else {
                colmap.write_text(&model)
            }
            let words = [if binary { "images.bin" } else { "images.txt" }, &message];
            // In the text format, a line without a name lacks a word.
            assert_inspect_refused(
                &folders,
                if name.is_empty() && !binary { &["images.txt", "9 words"] } else { &words },
            );
        }

        // Other formats list no file names, but the photo folder is an option.
        let folders = photos_only();
        poses_bounds(&folders.scene().join("poses_bounds.npy"), &[LLFF_ROW; 5]);
        let mut inspect = in_one_gibibyte(&folders, "inspect", &["--images", name]);
        folders.assert_refused(&mut inspect, &[&message]);
    }
}

#[test]
fn photo_outside_the_scene_folder_is_not_read() {
    let folders = Folders::new();
    let outside = folders.out("outside.png");
    fs::rename(folders.photo(3), &outside).unwrap();
    folders.write_scene(5, "images/3.png", &outside);
    let output = folders.liveview("inspect", &["--json"]).output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["views"]["names"], serde_json::json!(["0.png", "1.png", "2.png", "4.png"]));
    let note = format!("1 of the listed photos are missing, skipped: {outside}");
    assert!(report["notes"].as_array().unwrap().iter().any(|found| *found == note.as_str()), "{report}");
}

#[test]
fn file_of_4_gigabytes_is_an_error() {
    let more_than = |bytes: u64| format!("more than {bytes} bytes");
    let (general, json) = (more_than(1 << 30), more_than(64 << 20));
    for (file, start, limit) in [
        ("transforms.json", "{", &json),
        ("models.json", "[", &json),
        ("poses_bounds.npy", "\u{93}NUMPY", &general),
        ("cameras.txt", "https://example.org\n", &general),
        ("sparse/0/cameras.bin", "", &general),
        ("sparse/0/images.bin", "", &general),
    ] {
        let folders = photos_only();
        if file.ends_with(".bin") {
            Colmap { camera: Colmap::PINHOLE, names: &NAMES }.write_binary(&folders.scene().join("sparse/0"));
        }
        write_huge(&folders.scene().join(file), start.as_bytes());
        assert_inspect_refused(&folders, &[file, "cannot be read", limit]);
    }

    let folders = Folders::new();
    let photo = fs::read(folders.photo(3)).unwrap();
    for start in [&photo[..], &[0xFF, 0xD8, 0xFF, 0xE0]] {
        write_huge(&folders.photo(3), start);
        let output = in_one_gibibyte(&folders, "inspect", &[]).output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        let words = ["images/3.png is left out: ", "cannot be read", "at most 1073741824"];
        assert!(output.status.success() && words.iter().all(|word| text.contains(word)), "{text}");
    }

    let folders = Folders::new();
    let pose = folders.scene().join("pose.json");
    write_huge(&pose, b"{");
    assert_render_refused(&folders, &["--pose", pose.to_str().unwrap()], &["pose.json", "cannot be read", &json]);
    // A device has no size.
    assert_render_refused(&folders, &["--pose", "/dev/zero"], &["/dev/zero", "cannot be read", &json]);
}

#[test]
fn model_of_4_gigabytes_is_an_error() {
    let folders = Folders::new();
    let model = folders.scene().join("huge.onnx");
    write_huge(&model, &fs::read(fixture("tiny_v4")).unwrap());
    let picture = folders.out("a.png");
    let arguments = ["--target", "2", "-o", &picture, "--model", model.to_str().unwrap(), "--threads", "1"];
    let mut render = in_one_gibibyte(&folders, "render", &arguments);
    folders.assert_refused(&mut render, &["huge.onnx", "the size is 4294967296 bytes, expected at most 268435456"]);
}

#[test]
fn model_with_external_weights_is_an_error() {
    let folders = Folders::new();
    let model = folders.scene().join("beside.onnx");
    fs::copy(fixture("weights_beside"), &model).unwrap();
    let picture = folders.out("a.png");
    let arguments = ["--target", "2", "-o", &picture, "--model", model.to_str().unwrap(), "--threads", "1"];
    // Also if their size is right: external files are never opened.
    for bytes in [4 << 30, 4 * 4 * 12] {
        File::create(folders.scene().join("weights")).unwrap().set_len(bytes).unwrap();
        let mut render = in_one_gibibyte(&folders, "render", &arguments);
        folders.assert_refused(&mut render, &["beside.onnx", "External data path", "beside.onnx/weights\""]);
    }
}

/// Each thread needs address space; ONNX Runtime would wait forever for threads that could not be
/// started.
#[test]
fn too_many_threads_for_the_address_space_are_an_error() {
    let folders = Folders::new();
    let (picture, model) = (folders.out("a.png"), fixture("tiny_v4"));
    let words = &["of 256 threads only ", " can be started", "ulimit -u", "ulimit -v", "--threads"];
    for network in [["--model", &model], ["--network", "none"]] {
        let arguments = [&["--target", "2", "-o", &picture, "--threads", "256"][..], &network].concat();
        let mut render = in_one_gibibyte(&folders, "render", &arguments);
        folders.assert_refused(render.timeout(Duration::from_secs(60)), words);
    }
}

#[test]
fn picture_larger_than_the_memory_is_an_error() {
    let folders = Folders::new();
    let pose = folders.scene().join("pose.json");
    let matrix = "[[1, 0, 0, -0.2], [0, -1, 0, 0], [0, 0, -1, 0]]";
    fs::write(&pose, format!("{{\"cam_from_world\": {matrix}, \"w\": 8192, \"h\": 6144}}")).unwrap();
    let words = ["a picture of 8192x6144", " MB of memory; ", "expected a smaller target"];
    for layers in ["guided:2", "planes:64", "surface:2"] {
        assert_render_refused(&folders, &["--pose", pose.to_str().unwrap(), "--layers", layers], &words);
    }

    // The truth is not a source: it is checked when it is decoded, not with the source photos.
    folders.write_scene(5, r#""fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24, "w": 64, "h": 48, "#, r#""fl_x": 60, "#);
    image::GrayImage::new(8192, 8192).save(folders.photo(2)).unwrap();
    let arguments = ["--target", "2", "--width", "64"];
    let words =
        ["images/2.png: the image is 8192x8192, which takes about 2147 MB of memory", "expected a smaller image"];
    assert_render_refused(&folders, &arguments, &words);
}

/// An allocation that fails would end the process by a signal; a back trace in an error would wait for ever.
#[test]
fn little_memory_is_an_error() {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/scenes");
    let folder = tempfile::tempdir().unwrap();
    for megabytes in [130, 200, 280, 360, 440] {
        for command in [
            "depth workshop -o $OUT/depth",
            "inspect workshop",
            "render workshop --target target_0 --quality fast -o $OUT/a.png",
            "video rig --camera target --frames 0:2 -o $OUT/frames",
        ] {
            let script = format!("ulimit -c 0; ulimit -v {}; exec $LIVEVIEW {command} --json", 1024 * megabytes);
            let mut shell = Command::new("sh");
            shell.current_dir(&scenes).args(["-c", &script]).env("LIVEVIEW", env!("CARGO_BIN_EXE_liveview"));
            shell.env("OUT", folder.path()).env("RAYON_NUM_THREADS", "1").env("RUST_BACKTRACE", "1");
            let output = shell.timeout(Duration::from_secs(60)).output().unwrap();
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert!(matches!(output.status.code(), Some(0 | 2)), "{megabytes} MB, {command}: {stderr}");
        }
    }
}
