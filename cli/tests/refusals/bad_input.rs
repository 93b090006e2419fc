//! Invalid input: exit code 2 and one message that names the file, the field and what was expected.

use std::fs;

use liveview::network::ExecutionProvider;

use crate::common::{Folders, fixture, photo};

/// Asserts that a render of view 2 of the scene is refused.
fn assert_render_refused(folders: &Folders, arguments: &[&str], words: &[&str]) {
    let picture = folders.out("a.png");
    let arguments = [&["--target", "2", "-o", &picture], arguments].concat();
    folders.assert_refused(&mut folders.render(&arguments), words);
}

#[test]
fn missing_images_are_an_error_if_too_few_or_none_are_left() {
    let folders = Folders::new();
    fs::remove_file(folders.photo(3)).unwrap();
    let words = ["1 of the listed photos are missing, skipped: images/3.png", "4 views are needed", "only 3 of 3"];
    assert_render_refused(&folders, &[], &words);
    fs::remove_dir_all(folders.scene().join("images")).unwrap();
    assert_render_refused(&folders, &[], &["images/0.png", "missing image", "transforms.json"]);
}

#[test]
fn truncated_image_is_an_error() {
    // View 3 is a source, view 2 the truth; 100 bytes include the header, 20 do not.
    for (view, kept) in [(3, 100), (3, 20), (2, 100), (3, 0)] {
        let folders = Folders::new();
        let bytes = fs::read(folders.photo(view)).unwrap();
        fs::write(folders.photo(view), &bytes[..kept]).unwrap();
        let name = format!("images/{view}.png");
        assert_render_refused(&folders, &[], &[&name, "not a complete picture"]);
    }
}

#[test]
fn image_of_another_size_is_an_error() {
    let folders = Folders::new();
    photo(&folders.photo(3), 0.3, 60, 48);
    assert_render_refused(&folders, &[], &["images/3.png", "the image is 60x48", "declares 64x48"]);
}

#[test]
fn non_finite_intrinsics_are_an_error() {
    let folders = Folders::new();
    folders.write_scene(5, "\"fl_x\": 60", "\"fl_x\": NaN");
    assert_render_refused(&folders, &[], &["transforms.json"]);
    folders.write_scene(5, "\"fl_x\": 60", "\"fl_x\": 1e999");
    assert_render_refused(&folders, &[], &["transforms.json"]);

    let folders = Folders::new();
    fs::remove_file(folders.scene().join("transforms.json")).unwrap();
    let names = &["0.png", "1.png", "2.png", "3.png", "4.png"];
    let colmap = crate::scene_common::Colmap { camera: "PINHOLE 64 48 nan 60 30 25", names };
    colmap.write_text(&folders.scene().join("sparse/0"));
    assert_render_refused(&folders, &[], &["sparse/0/cameras.txt", "PINHOLE", "fx is NaN", "finite"]);
}

#[test]
fn singular_intrinsics_are_an_error() {
    let folders = Folders::new();
    folders.write_scene(5, "\"fl_y\": 60", "\"fl_y\": 0");
    assert_render_refused(&folders, &[], &["transforms.json", "K is singular", "fy is 0"]);
}

#[test]
fn rotation_that_is_not_orthonormal_is_an_error() {
    let folders = Folders::new();
    folders.write_scene(5, "[[1, 0, 0, 0.2]", "[[1.1, 0, 0, 0.2]");
    assert_render_refused(&folders, &[], &["transforms.json", "2.png", "not orthonormal"]);
}

#[test]
fn fewer_views_than_the_model_needs_are_an_error() {
    let folders = Folders::new();
    folders.write_scene(3, "", "");
    assert_render_refused(&folders, &[], &["2.png", "4 views are needed", "only 2 of 2"]);
}

#[test]
fn invalid_or_unknown_depth_range_is_an_error() {
    let folders = Folders::new();
    assert_render_refused(&folders, &["--near", "5", "--far", "2"], &["near is 5", "far is 2", "0 < near < far"]);
    assert_render_refused(&folders, &["--near", "3", "--far", "3"], &["0 < near < far"]);
    assert_render_refused(&folders, &["--near", "0"], &["near is 0"]);
    assert_render_refused(&folders, &["--near", "-1"], &["near is -1"]);
    assert_render_refused(&folders, &["--far", "nan"], &["far is NaN"]);
    folders.write_scene_in_one_place(5);
    let unknown = "the scene has no depth range, and its cameras are in one place; expected";
    assert_render_refused(&folders, &[], &[&format!("{unknown} near and far, in scene units. Give --near and --far ")]);
    assert_render_refused(&folders, &["--near", "2"], &[&format!("{unknown} far, in scene units. Give --far ")]);
}

#[test]
fn invalid_list_of_disparities_is_an_error() {
    let folders = Folders::new();
    let refused = |list: &str, words: &[&str]| {
        let layers = format!("list:{list}");
        assert_render_refused(&folders, &["--layers", &layers], &[&["--layers", layers.as_str()], words].concat());
    };
    refused("", &["empty", "at least one"]);
    refused("0.1,0.3", &["disparity 1 (0.3)", "descending"]);
    refused("0.3,x", &["\"x\" is not a number"]);
    refused("0.3,,0.1", &["\"\" is not a number"]);
    refused("0.3,nan", &["disparity 1 is NaN"]);
    refused("-0.3", &["disparity 0 is -0.3"]);
}

#[test]
fn invalid_layers_are_an_error() {
    let folders = Folders::new();
    let refused = |layers: &str, words: &[&str]| {
        assert_render_refused(&folders, &["--layers", layers], &[&["--layers", layers], words].concat());
    };
    for kind in ["planes", "guided", "surface", "select"] {
        for count in ["0", "-3", "1e9", "1000000000", ""] {
            refused(&format!("{kind}:{count}"), &["a whole number from 1 to 4096"]);
        }
    }
    for layers in ["guided:2/1", "guided:2/4097"] {
        refused(layers, &["a whole number from 2 to 4096"]);
    }
    refused("select:9/8", &["9 planes", "from 8"]);
    for layers in ["", "64", "planes", "planes 64", "tiles:64"] {
        refused(layers, &["expected planes:D, guided:L, surface:L, select:K/D or list:DISPARITIES"]);
    }
    assert_render_refused(&folders, &["--layers", "planes:4", "--quality", "fast"], &["cannot be used with"]);
}

#[test]
fn invalid_alpha_is_an_error() {
    let folders = Folders::new();
    assert_render_refused(&folders, &["--alpha", "both"], &["--alpha", "independent", "competing"]);
    assert_render_refused(&folders, &["--alpha", "competing", "--network", "none"], &["cannot be used with"]);
}

#[test]
fn invalid_models_are_an_error() {
    let folders = Folders::new();
    let refused = |arguments: &[&str], words: &[&str]| {
        let picture = folders.out("a.png");
        let arguments = [&["--target", "2", "-o", &picture], arguments].concat();
        folders.assert_refused(&mut folders.liveview("render", &arguments), words);
    };
    let other = fixture("other_channels");
    refused(&["--model", &other], &[&other, "the input is hwv", "9", "expected hwv f32 [n, 12, h, w]"]);
    refused(&["--model", &fixture("fixed_size")], &["fixed_size.onnx", "n, h and w free"]);
    refused(&["--model", &fixture("other_stride")], &["metadata `stride` is 16", "expected 8"]);
    refused(&["--model", &fixture("no_card")], &["metadata `views`, `stride`, `recommended_layers` is missing"]);
    refused(
        &["--model", &fixture("odd_advice")],
        &["`recommended_layers`", "many", "such as \"guided:2\"", "--layers"],
    );
    refused(&["--model", &fixture("tiny_v4"), "--views", "5"], &["metadata `views` is 4", "expected 5"]);
    refused(&["--model", &fixture("absent")], &["absent.onnx", "no such file"]);
    refused(&["--model", &format!("{}/Cargo.toml", env!("CARGO_MANIFEST_DIR"))], &["Cargo.toml", "ONNX Runtime"]);
    refused(&["--network", "model", "--views", "63"], &["liveview_v63.onnx", "models"]);
}

#[test]
fn network_with_nan_logits_is_an_error() {
    let folders = Folders::new();
    let picture = folders.out("a.png");
    let model = fixture("not_a_number");
    for layers in ["guided:2", "planes:2", "surface:1", "select:1/2"] {
        let arguments = ["--target", "2", "-o", &picture, "--model", &model, "--layers", layers];
        let mut render = folders.liveview("render", &arguments);
        folders.assert_refused(&mut render, &["not_a_number.onnx", " logits are NaN or infinite; expected finite"]);
    }
}

#[test]
fn names_are_printed_escaped() {
    let folders = Folders::new();
    let name = "a\u{1b}[31m\nb.png";
    fs::rename(folders.photo(3), folders.scene().join("images").join(name)).unwrap();
    folders.write_scene(5, "images/3.png", "images/a\\u001b[31m\\nb.png");
    let output = folders.liveview("inspect", &["--target", "2"]).output().unwrap();
    let stdout = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.success() && stdout.contains(r"a\u{1b}[31m\nb.png") && !stdout.contains('\u{1b}'),
        "{stdout}"
    );
    fs::remove_file(folders.scene().join("images").join(name)).unwrap();
    assert_render_refused(&folders, &[], &[r"missing, skipped: images/a\u{1b}[31m\nb.png"]);
}

#[test]
fn invalid_onnx_runtime_library_is_an_error() {
    let folders = Folders::new();
    assert_render_refused(
        &folders,
        &["--ort-lib", "/nonexistent/libonnxruntime.so"],
        &["/nonexistent/libonnxruntime.so", "no such file"],
    );
    let text = format!("{}/Cargo.toml", env!("CARGO_MANIFEST_DIR"));
    assert_render_refused(&folders, &["--ort-lib", &text], &[&text, "not a usable ONNX Runtime library"]);
    let library = crate::wheel::file(ExecutionProvider::Cpu).unwrap();
    let truncated = folders.scene().join("libonnxruntime.so");
    fs::write(&truncated, &fs::read(library).unwrap()[..1 << 20]).unwrap();
    let truncated = truncated.to_str().unwrap();
    assert_render_refused(
        &folders,
        &["--ort-lib", truncated],
        &[truncated, "the file is truncated: 1048576 bytes, expected "],
    );
}

#[test]
fn missing_engine_or_precision_is_an_error() {
    let folders = Folders::new();
    let refused = |arguments: &[&str], words: &[&str]| assert_render_refused(&folders, arguments, words);
    refused(&["--engine", "gpu"], &["'gpu'", "cpu, openvino, cuda, tensorrt"]);
    refused(&["--precision", "int4"], &["'int4'", "f32, bf16, int8"]);
    refused(&["--precision", "bf16"], &["--precision bf16", "--engine openvino"]);
    refused(&["--precision", "int8"], &["tiny_v4.onnx", "metadata `precision` is f32", "expected int8"]);
    let library = crate::wheel::file(ExecutionProvider::Cpu).unwrap().to_str().unwrap().to_owned();
    refused(
        &["--engine", "openvino", "--ort-lib", &library],
        &[&library, "has no execution provider openvino", "make setup WITH=openvino", "--ort-lib"],
    );
    if cfg!(not(feature = "cuda")) {
        refused(&["--engine", "cuda"], &["execution provider cuda", "cargo feature `cuda`"]);
    }
    if cfg!(not(feature = "tensorrt")) {
        refused(&["--engine", "tensorrt"], &["execution provider tensorrt", "cargo feature `tensorrt`"]);
    }
}

#[test]
fn output_that_cannot_be_written_is_an_error() {
    let folders = Folders::new();
    let below_a_file = folders.photo(0).join("a.png");
    for path in [below_a_file.to_str().unwrap(), "/proc/a.png", "/proc/nowhere/"] {
        folders.assert_refused(
            &mut folders.render(&["--target", "2", "-o", path]),
            &["-o", path.trim_end_matches('/'), "cannot be written"],
        );
        assert_render_refused(&folders, &["--depth", path], &["--depth", "cannot be written"]);
    }
    let photo = folders.photo(2);
    let before = fs::read(&photo).unwrap();
    let arguments = ["--target", "2", "-o", photo.to_str().unwrap()];
    folders.assert_refused(&mut folders.render(&arguments), &["would overwrite a photo of the scene"]);
    assert_eq!(fs::read(&photo).unwrap(), before);
}

#[test]
fn unsuitable_outputs_are_an_error() {
    let folders = Folders::new();
    let refused = |arguments: &[&str], words: &[&str]| folders.assert_refused(&mut folders.render(arguments), words);
    refused(&["--target", "2"], &["--output"]);
    refused(&["--target", "2", "-o", &folders.out("a.bmp")], &["a.bmp", "expected", ".png"]);
    refused(
        &["--target", "2", "-o", &folders.out("a.png"), "--depth", &folders.out("d.jpg")],
        &["--depth", "d.jpg", "expected", ".png"],
    );
    refused(&["--path", "line:3", "-o", &folders.out("a.png")], &["a.png", "3 pictures", "a folder"]);
    refused(
        &["--path", "line:3", "-o", &folders.out("frames"), "--compare", &folders.out("c")],
        &["--compare", "no photo to compare with"],
    );
}

#[test]
fn outputs_in_the_same_file_are_an_error() {
    let folders = Folders::new();
    let refused = |arguments: [&str; 4]| {
        let arguments = [&["--target", "2"], &arguments[..]].concat();
        folders.assert_refused(&mut folders.render(&arguments), &["is the same file", "expected different files"]);
    };
    let [out, a, colour] = ["", "a.png", "a_colour.png"].map(|name| folders.out(name));
    refused(["-o", &out, "--compare", &out]);
    refused(["-o", &out, "--depth", &format!("{out}.")]);
    refused(["-o", &colour, "--depth", &a]);
}

#[test]
fn invalid_targets_are_an_error() {
    let folders = Folders::new();
    let picture = folders.out("a.png");
    let refused = |arguments: &[&str], words: &[&str]| {
        folders.assert_refused(&mut folders.render(&[arguments, &["-o", &picture]].concat()), words);
    };
    refused(&[], &["--target", "--heldout", "--pose", "--path"]);
    refused(&["--target", "2", "--path", "line:3"], &["cannot be used with"]);
    refused(&["--target", "7"], &["no view is named \"7\"", "0.png"]);
    refused(&["--target", "2,2.png"], &["twice"]);
    refused(&["--heldout", "1"], &["--heldout 1", "none to render from"]);
    refused(&["--path", "helix:9"], &["line:N, circle:N or spiral:N"]);
    refused(&["--path", "line:0"], &["whole number"]);
    for (pose, words) in [
        ("{", "not JSON"),
        ("{}", "expected either"),
        ("[]", "at least one"),
        (r#"{"cam_from_world": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}"#, "3 or 4 rows of 4 numbers"),
        (r#"{"cam_from_world": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}"#, "not orthonormal"),
        (r#"{"cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "w": -3, "h": 48}"#, "w is -3"),
        (r#"{"cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "w": 99999, "h": 48}"#, "image size"),
        (r#"{"cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "w": 64}"#, "one of w and h is given"),
        (r#"{"cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "fov": 60}"#, "unknown key \"fov\""),
        (r#"{"cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "fx": 60}"#, "unknown key \"fx\""),
        (r#"{"cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "fl_x": 0}"#, "K is singular"),
    ] {
        let file = folders.scene().join("pose.json");
        fs::write(&file, pose).unwrap();
        refused(&["--pose", file.to_str().unwrap()], &["pose.json", words]);
    }
    refused(&["--pose", "/nonexistent.json"], &["/nonexistent.json", "cannot be read"]);
}

#[test]
fn folder_without_a_scene_is_an_error() {
    let folders = Folders::new();
    fs::remove_file(folders.scene().join("transforms.json")).unwrap();
    assert_render_refused(&folders, &[], &["no scene found", "no camera poses", "liveview poses"]);
    for arguments in [&[][..], &["--planes"]] {
        folders.assert_refused(&mut folders.liveview("inspect", arguments), &["no scene found"]);
    }
}
