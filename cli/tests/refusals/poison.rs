//! Replaces one number of an input at a time by an extreme one. The result must be a finite
//! picture, or exit code 2 and a message that names the file and the field; never a panic, a
//! signal, a hang or an incomplete file.

use std::fs;
use std::ops::Range;
use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use crate::common::{Folders, fixture};
use crate::scene_common::{Colmap, LLFF_ROW, poses_bounds, write};

/// Values for text: NaN, infinity, squares that overflow in f32 and in f64, a denormal, a negative
/// zero.
const TEXTS: [&str; 7] = ["nan", "-inf", "1e38", "1e308", "-1e308", "1e-310", "-0"];
/// Values for JSON, which has no infinity.
const JSON: [&str; 6] = ["NaN", "1e38", "1e308", "-1e308", "1e-310", "-0.0"];
/// Values for binary files.
const NUMBERS: [f64; 7] = [f64::NAN, f64::INFINITY, 1e38, 1e308, -1e308, 1e-310, -0.0];

/// Time limit, far longer than any of these renders takes.
const LIMIT: Duration = Duration::from_secs(60);

/// Numbers of renders that were refused, and that succeeded.
#[derive(Default)]
struct Tally {
    refused: usize,
    rendered: usize,
}

impl Tally {
    /// Renders, and checks the result: an error must name `file` and one of `fields`, or contain
    /// one of the [`CONSEQUENCES`] in `fields`.
    fn render(&mut self, folders: &Folders, arguments: &[&str], what: &str, file: &str, fields: &[&str]) {
        let [picture, depth] = ["a.png", "d.png"].map(|name| folders.out(name));
        let out = Path::new(&picture).parent().unwrap();
        fs::remove_dir_all(out).and_then(|()| fs::create_dir(out)).unwrap();
        let mut render = folders.render(&["-o", &picture, "--depth", &depth, "--threads", "2", "--json"]);
        let output = render.args(arguments).timeout(LIMIT).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        match output.status.code() {
            Some(0) => {
                self.rendered += 1;
                let assert_finite = |stdout: &[u8]| {
                    let report: Value = serde_json::from_slice(stdout).unwrap();
                    let target = &report["targets"][0];
                    // A non-finite number would be null; a picture one pixel wide is not scored.
                    let scored = arguments.contains(&"--target") && !arguments.contains(&"--width=1");
                    for number in ["disparity_max", "uncovered_share"].into_iter().chain(scored.then_some("psnr")) {
                        assert!(target[number].is_number(), "{what}: {number} of {report:#}\n{stderr}");
                    }
                    for file in [&picture, &depth] {
                        image::open(file).unwrap_or_else(|error| panic!("{what}: {file}: {error}"));
                    }
                };
                assert_finite(&output.stdout);
                if !arguments.contains(&"--target") || arguments.iter().any(|argument| argument.starts_with("--fps")) {
                    return;
                }
                let model = fixture("tiny_v4");
                // By turns, unless the case has layers.
                let turns =
                    [["--model", &model, "--layers", "guided:2"], ["--network", "none", "--layers", "surface:1"]];
                let chosen = arguments.iter().any(|argument| argument.starts_with("--layers"));
                let layers = if chosen { &turns[0][..2] } else { &turns[self.rendered % 2] };
                let mut render = folders.liveview("render", arguments);
                render.args(["-o", &picture, "--depth", &depth, "--threads", "2", "--json"]).args(layers);
                let output = render.timeout(LIMIT).output().unwrap();
                let stderr = String::from_utf8(output.stderr).unwrap();
                // The depth of the photos uses more photos, one of which may have the changed number.
                if layers.contains(&"surface:1") && output.status.code() == Some(2) {
                    assert!(stderr.contains("error: ") && !stderr.contains("panicked"), "{what}: {stderr}");
                    return;
                }
                assert!(output.status.success(), "{what}, {layers:?}: {stderr}");
                assert_finite(&output.stdout);
            }
            Some(2) => {
                self.refused += 1;
                assert!(!stderr.contains("panicked"), "{what}: {stderr}");
                let error = stderr.split("error: ").nth(1).unwrap_or_else(|| panic!("{what}: {stderr}"));
                let contains = |words: &[&str]| words.iter().any(|word| error.contains(word));
                let consequence = CONSEQUENCES.iter().any(|words| fields.contains(words) && error.contains(words));
                // Any extreme number may result in a picture that no view covers.
                let blank = contains(&["no view covers any of the targets"]);
                let too_few = contains(&LEFT_OUT);
                assert!(
                    consequence || blank || too_few || contains(&[file]) && contains(fields),
                    "{what}: {fields:?} in: {error}"
                );
                assert_eq!(folders.written(), Vec::<String>::new(), "{what}");
            }
            other => panic!("{what}: exit code {other:?}: {stderr}"),
        }
    }

    /// Asserts that some renders were refused and some succeeded: otherwise the changed numbers had
    /// no effect.
    fn assert_both(&self) {
        assert!(self.refused > 0 && self.rendered > 0, "{} refused, {} rendered", self.refused, self.rendered);
    }
}

/// Positions of the numbers in a text that are not inside quotes.
fn numbers(text: &str) -> Vec<Range<usize>> {
    let quoted = |at: usize| text[..at].matches('"').count() % 2 == 1;
    let is_end = |c: char| c.is_whitespace() || "[]{}:,".contains(c);
    let mut found = Vec::new();
    let mut start = 0;
    for (at, c) in text.char_indices().filter(|&(_, c)| is_end(c)) {
        if text[start..at].parse::<f64>().is_ok() && !quoted(start) {
            found.push(start..at);
        }
        start = at + c.len_utf8();
    }
    found
}

/// Replaces, one at a time, the numbers of a text file given by `fields`: indices of the numbers,
/// and words of which an error must contain one.
fn poison_text(
    folders: &Folders,
    file: &str,
    values: &[&str],
    arguments: &[&str],
    fields: &[(Range<usize>, &[&str])],
) -> Tally {
    let path = folders.scene().join(file);
    let text = fs::read_to_string(&path).unwrap();
    let numbers = numbers(&text);
    let mut tally = Tally::default();
    for (indices, words) in fields {
        for index in indices.clone() {
            for value in values {
                let mut poisoned = text.clone();
                poisoned.replace_range(numbers[index].clone(), value);
                fs::write(&path, poisoned).unwrap();
                let what = format!("{file}, number {index} ({}) is {value}", &text[numbers[index].clone()]);
                let name = Path::new(file).file_stem().unwrap().to_str().unwrap();
                tally.render(folders, arguments, &what, name, words);
            }
        }
    }
    fs::write(&path, text).unwrap();
    tally
}

/// The tiny scene's photos in another format.
fn photos(folder: &str) -> Folders {
    let folders = Folders::new();
    fs::remove_file(folders.scene().join("transforms.json")).unwrap();
    fs::rename(folders.scene().join("images"), folders.scene().join(folder)).unwrap();
    folders
}

const NAMES: [&str; 5] = ["0.png", "1.png", "2.png", "3.png", "4.png"];
/// Options that take a number, up to the number.
const NUMERIC_OPTIONS: [&str; 16] = [
    "--near=",
    "--far=",
    "--layers=list:",
    "--layers=list:1e3,",
    "--layers=guided:",
    "--layers=guided:2/",
    "--layers=surface:",
    "--layers=planes:",
    "--layers=select:",
    "--layers=select:1/",
    "--width=",
    "--views=",
    "--batch=",
    "--threads=",
    "--rig-position=",
    "--fps=",
];
const K: &[&str] = &["fl_x", "fl_y", "fx", "fy", "cx", "cy"];
const POSE: &[&str] = &["rotation", "translation", "centre", "transform_matrix", CONSEQUENCES[0], CONSEQUENCES[1]];
const RANGE: &[&str] = &["near", "far", CONSEQUENCES[1]];
const POINTS: &[&str] = &["near", CONSEQUENCES[1]];
/// Errors that follow from a valid but extreme pose, point or depth, and do not name the file.
/// A photo whose camera is not usable is left out: too few may be left, or the target is missing.
const LEFT_OUT: [&str; 2] = ["views are needed, but only", "no view is named"];
const CONSEQUENCES: [&str; 2] = ["face the target's direction", "expected near"];

#[test]
fn extreme_numbers_in_transforms_json_give_a_picture_or_an_error() {
    let folders = Folders::new();
    // fl_x, fl_y, cx, cy, w, h, near, far; then 16 numbers for each of five poses. Pose 1 is a
    // source, pose 2 the target.
    let fields: &[(Range<usize>, &[&str])] =
        &[(0..4, K), (4..6, &["w is", "h is", "\"w\"", "size"]), (6..8, RANGE), (24..40, POSE)];
    poison_text(&folders, "transforms.json", &JSON, &["--target", "2"], fields).assert_both();
    poison_text(&folders, "transforms.json", &["1e308", "1e-310"], &["--target", "2"], &[(40..52, POSE)]);
    let optional = "\"camera_angle_x\": 0.5, \"camera_angle_y\": 0.5, \"k1\": 0, \"k2\": 0, \"k3\": 0, \"k4\": 0, \"p1\": 0, \"p2\": 0";
    folders.write_scene(5, "\"fl_x\": 60, \"fl_y\": 60", optional);
    let fields: &[(Range<usize>, &[&str])] =
        &[(0..2, &["camera_angle", "fx", "fy"]), (2..8, &["k1", "k2", "k3", "k4", "p1", "p2"])];
    poison_text(&folders, "transforms.json", &JSON, &["--target", "2"], fields).assert_both();
}

#[test]
fn extreme_numbers_in_models_json_give_a_picture_or_an_error() {
    let folders = photos("images");
    let camera = |view: usize| {
        format!(
            r#"{{"principal_point": [32, 24], "pixel_aspect_ratio": 1, "position": [{}, 0, 0], "focal_length": 60,
            "width": 64, "height": 48, "relative_path": "images/{view}.png", "orientation": [0, 0, 0]}}"#,
            0.1 * view as f64
        )
    };
    write(&folders.scene().join("models.json"), format!("[[{}]]", (0..5).map(camera).collect::<Vec<_>>().join(",\n")));
    // The 12 numbers of view 1, after those of view 0.
    let fields: &[(Range<usize>, &[&str])] = &[
        (12..15, &["principal_point", "pixel_aspect_ratio", "cx", "cy", "fy"]),
        (15..18, &["position", "translation", "centre", CONSEQUENCES[0], CONSEQUENCES[1]]),
        (18..19, &["focal_length", "fx", "fy"]),
        (19..21, &["width", "height", "size"]),
        (21..24, &["orientation", "rotation", CONSEQUENCES[0]]),
    ];
    let arguments = ["--target", "2", "--near", "2", "--far", "8"];
    poison_text(&folders, "models.json", &JSON, &arguments, fields).assert_both();
}

#[test]
fn extreme_numbers_in_realestate10k_give_a_picture_or_an_error() {
    let folders = photos("frames");
    let line = |view: usize| format!("{view} 0.9375 1.25 0.5 0.5 0 0 1 0 0 {} 0 1 0 0 0 0 1 0\n", -0.1 * view as f64);
    let text = format!("https://example.org\n{}", (0..5).map(line).collect::<String>());
    write(&folders.scene().join("cameras.txt"), text);
    // A timestamp and 18 numbers per line.
    let fields: &[(Range<usize>, &[&str])] = &[(20..24, K), (24..26, &["columns 6 and 7"]), (26..38, POSE)];
    let arguments = ["--target", "2", "--near", "2", "--far", "8"];
    poison_text(&folders, "cameras.txt", &TEXTS, &arguments, fields).assert_both();
}

#[test]
fn extreme_numbers_in_colmap_text_give_a_picture_or_an_error() {
    let folders = photos("images");
    Colmap { camera: Colmap::PINHOLE, names: &NAMES }.write_text(&folders.scene().join("sparse/0"));
    let arguments = ["--target", "2"];
    let line = "line";
    // CAMERA_ID, WIDTH, HEIGHT, PARAMS.
    let fields: &[(Range<usize>, &[&str])] =
        &[(0..1, &["which is not listed", line]), (1..3, &["expected equal sizes", line])];
    poison_text(&folders, "sparse/0/cameras.txt", &TEXTS, &arguments, fields);
    poison_text(&folders, "sparse/0/cameras.txt", &TEXTS, &arguments, &[(3..7, K)]).assert_both();
    // The second photo's IMAGE_ID, pose, CAMERA_ID and first two keypoints; the first photo has 9
    // numbers and 11 keypoints of 3 numbers.
    let fields: &[(Range<usize>, &[&str])] =
        &[(42..43, &[line]), (43..50, POSE), (50..51, &["camera", line]), (51..57, &[line])];
    poison_text(&folders, "sparse/0/images.txt", &TEXTS, &arguments, fields).assert_both();
    // POINT3D_ID X Y Z, from which depth ranges are computed; without them if they are damaged.
    let fields: &[(Range<usize>, &[&str])] = &[(0..1, &[line]), (1..4, POINTS)];
    poison_text(&folders, "sparse/0/points3D.txt", &TEXTS, &arguments, fields);
    for (camera, last) in [("OPENCV 64 48 50 60 30 25 0.01 0 0 0", 11), ("SIMPLE_RADIAL 64 48 50 30 25 0.01", 7)] {
        Colmap { camera, names: &NAMES }.write_text(&folders.scene().join("sparse/0"));
        let first = if last == 11 { 7 } else { 6 };
        let fields: &[(Range<usize>, &[&str])] = &[(first..last, &["k1", "k2", "p1", "p2"])];
        poison_text(&folders, "sparse/0/cameras.txt", &TEXTS, &arguments, fields).assert_both();
    }
}

#[test]
fn extreme_numbers_in_colmap_binary_give_a_picture_or_an_error() {
    let folders = photos("images");
    let model = folders.scene().join("sparse/0");
    Colmap { camera: Colmap::PINHOLE, names: &NAMES }.write_binary(&model);
    let mut tally = Tally::default();
    // Cameras: after the count, id, model, width and height; parameters. First photo: id;
    // quaternion and translation; camera, name, number of keypoints; two keypoints. First point:
    // id; position.
    let numbers: [(&str, usize, usize, &[&str]); 4] = [
        ("cameras.bin", 32, 4, K),
        ("images.bin", 12, 7, POSE),
        ("images.bin", 86, 6, &["keypoint"]),
        ("points3D.bin", 16, 3, POINTS),
    ];
    for (file, start, count, words) in numbers {
        let original = fs::read(model.join(file)).unwrap();
        for (index, value) in (0..count).flat_map(|index| NUMBERS.map(|value| (index, value))) {
            let mut bytes = original.clone();
            bytes[start + 8 * index..][..8].copy_from_slice(&value.to_le_bytes());
            fs::write(model.join(file), bytes).unwrap();
            let what = format!("{file}, byte {} is {value}", start + 8 * index);
            tally.render(&folders, &["--target", "2"], &what, file, words);
        }
        fs::write(model.join(file), original).unwrap();
    }
    let integers: [(&str, usize, usize, &[&str]); 6] = [
        ("cameras.bin", 8, 8, &["camera"]),
        ("cameras.bin", 16, 8, &["expected equal sizes"]),
        ("cameras.bin", 24, 8, &["expected equal sizes"]),
        ("images.bin", 68, 4, &["camera"]),
        ("images.bin", 78, 8, &["keypoints"]),
        ("points3D.bin", 8, 8, &["point"]),
    ];
    for (file, start, size, words) in integers {
        let original = fs::read(model.join(file)).unwrap();
        for value in [0, 1, u64::MAX, 1 << 63, i64::MAX as u64] {
            let mut bytes = original.clone();
            bytes[start..start + size].copy_from_slice(&value.to_le_bytes()[..size]);
            fs::write(model.join(file), bytes).unwrap();
            // A wrong size is found when a photo is read, which `images.bin` lists.
            let name = if words == ["expected equal sizes"] || words == ["camera"] { "s.bin" } else { file };
            tally.render(&folders, &["--target", "2"], &format!("{file}, byte {start} is {value}"), name, words);
        }
        fs::write(model.join(file), original).unwrap();
    }
    tally.assert_both();
}

#[test]
fn extreme_numbers_in_poses_bounds_give_a_picture_or_an_error() {
    let folders = photos("images");
    let mut rows = [LLFF_ROW; 5];
    for (view, row) in rows.iter_mut().enumerate() {
        (row[3], row[14]) = (1.0 + 0.1 * view as f64, 60.0);
    }
    let path = folders.scene().join("poses_bounds.npy");
    let mut tally = Tally::default();
    for (index, value) in (0..17).flat_map(|index| NUMBERS.map(|value| (index, value))) {
        let mut poisoned = rows;
        poisoned[1][index] = value;
        poses_bounds(&path, &poisoned);
        let words: &[&str] = match index {
            4 | 9 => &["height", "width", "size"],
            14 => K,
            15 | 16 => RANGE,
            _ => POSE,
        };
        tally.render(&folders, &["--target", "2"], &format!("number {index} is {value:?}"), "poses_bounds", words);
    }
    tally.assert_both();
}

#[test]
fn extreme_numbers_in_pose_files_give_a_picture_or_an_error() {
    let folders = Folders::new();
    let intrinsics = "\"fl_x\": 60, \"fl_y\": 60, \"cx\": 32, \"cy\": 24, \"w\": 64, \"h\": 48";
    let pose = folders.scene().join("pose.json");
    for (key, y, x) in [("transform_matrix", 1, 0.2), ("cam_from_world", -1, -0.2)] {
        let rows = format!("[[1, 0, 0, {x}], [0, {y}, 0, 0], [0, 0, {y}, 0], [0, 0, 0, 1]]");
        fs::write(&pose, format!("{{\"{key}\": {rows}, {intrinsics}}}")).unwrap();
        let fields: &[(Range<usize>, &[&str])] = &[
            (0..16, &["rotation", "translation", "centre", key, "not JSON", CONSEQUENCES[0], CONSEQUENCES[1]]),
            (16..20, &["fl_x", "fl_y", "fx", "fy", "cx", "cy", "not JSON"]),
            (20..22, &["w is", "h is", "size", "not JSON"]),
        ];
        poison_text(&folders, "pose.json", &JSON, &["--pose", pose.to_str().unwrap()], fields).assert_both();
    }
}

#[test]
fn extreme_numbers_in_options_give_a_picture_or_an_error() {
    let folders = Folders::new();
    let mut tally = Tally::default();
    for option in NUMERIC_OPTIONS {
        for value in TEXTS.into_iter().chain(["3e-39", "3e38", "0", "1", "4097"]) {
            let given = format!("{option}{value}");
            let name = option.split('=').next().unwrap();
            let words = if name == "--layers" { &[name][..] } else { &[name, &name[2..]] };
            tally.render(&folders, &["--target", "2", &given], &given, "", words);
        }
    }
    for value in TEXTS.into_iter().chain(["3e-39", "3e38", "0", "1", "4097"]) {
        let given = format!("--heldout={value}");
        tally.render(&folders, &[&given], &given, "", &["--heldout"]);
    }
    for value in TEXTS.into_iter().chain(["3e-39", "3e38", "0", "1"]) {
        let given = format!("--path=line:{value}");
        tally.render(&folders, &[&given], &given, "", &["--path"]);
    }
    tally.assert_both();
}
