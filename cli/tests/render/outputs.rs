//! Output files never overwrite an input, another output, or a file of a scene that the program did
//! not write; without a picture, the exit code is not 0.
#![cfg(unix)]

use std::ffi::OsStr;
use std::fs;
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use serde_json::Value;

use crate::common::{COPIES, Folders, HEIGHT, WIDTH, fixture, photo};

/// A rig of six cameras, each a folder of frames.
fn rig(frames: usize) -> Folders {
    let folders = Folders::new();
    for camera in 0..6 {
        fs::create_dir(folders.scene().join(format!("cam{camera}"))).unwrap();
        for frame in 0..frames {
            let file = folders.scene().join(format!("cam{camera}/{frame:03}.png"));
            photo(&file, 0.1 * f64::from(camera), WIDTH, HEIGHT);
        }
    }
    fs::remove_dir_all(folders.scene().join("images")).unwrap();
    let poses = fs::read_to_string(folders.scene().join("transforms.json")).unwrap();
    let poses = (0..5).fold(poses, |text, k| text.replace(&format!("images/{k}.png"), &format!("cam{k}/000.png")));
    fs::write(folders.scene().join("transforms.json"), poses).unwrap();
    folders
}

fn video(folders: &Folders, arguments: &[&str]) -> assert_cmd::Command {
    let mut video = folders.liveview("video", &[&["--path", "line:3", "--layers", "guided:1"], arguments].concat());
    video.args(["--model", &fixture("tiny_v4"), "--threads", "2"]);
    video
}

/// An LLFF scene: full-size photos in `images`, read from `images_4`.
fn llff() -> (Folders, PathBuf) {
    let folders = Folders::new();
    let root = PathBuf::from(folders.out("llff"));
    let row = |x: f64| {
        let pose = [0.0, 1.0, 0.0, x, 192.0, 1.0, 0.0, 0.0, 0.0, 256.0, 0.0, 0.0, -1.0, 0.0, 240.0];
        let mut row = [0.0; 17];
        row[..15].copy_from_slice(&pose);
        (row[15], row[16]) = (2.0, 8.0);
        row
    };
    fs::create_dir_all(root.join("images")).unwrap();
    fs::create_dir_all(root.join("images_4")).unwrap();
    for view in 0..5 {
        photo(&root.join(format!("images/{view}.png")), 0.1 * f64::from(view), 4 * WIDTH, 4 * HEIGHT);
        photo(&root.join(format!("images_4/{view}.png")), 0.1 * f64::from(view), WIDTH, HEIGHT);
    }
    crate::scene_common::poses_bounds(&root.join("poses_bounds.npy"), &[0.0, 0.1, 0.2, 0.3, 0.4].map(row));
    (folders, root)
}

/// All files in a folder and its subfolders, with their contents.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        match path.is_dir() {
            true => found.extend(contents(&path)),
            false => found.push((path.clone(), fs::read(&path).unwrap())),
        }
    }
    found.sort();
    found
}

/// Asserts exit code 2, one error with these words, and that no file in `folder` is changed or
/// added.
fn assert_refused(command: &mut assert_cmd::Command, folder: &Path, words: &[&str]) {
    let before = contents(folder);
    let output = command.timeout(Duration::from_secs(60)).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    let after = contents(folder);
    let changed: Vec<_> = after.iter().filter(|file| !before.contains(file)).map(|(path, _)| path).collect();
    assert!(before == after, "{} files before, {} after, changed: {changed:?}; {stderr}", before.len(), after.len());
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert_eq!(stderr.lines().filter(|line| line.starts_with("error: ")).count(), 1, "{stderr}");
    words.iter().for_each(|word| assert!(stderr.contains(word), "\"{word}\" is missing in: {stderr}"));
}

fn succeeds(command: &mut assert_cmd::Command) -> String {
    let output = command.timeout(Duration::from_secs(60)).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{stderr}");
    stderr
}

#[test]
fn video_never_overwrites_files_of_its_rig() {
    let folders = rig(2);
    let scene = folders.scene();
    let copies = folders.ffmpeg(COPIES);
    let at = |name: &str| scene.join(name).to_str().unwrap().to_owned();
    fs::write(at("cam6.mp4"), "a camera without pose").unwrap();
    fs::write(at("notes.txt"), "the user's").unwrap();
    let frames = folders.out("frames");
    for arguments in [
        ["-o", &at("cam6.mp4")],
        // A new camera, when the rig is next read.
        ["-o", &at("cam7.mp4")],
        ["--log", &at("transforms.json")],
        ["--log", &at("cam0/000.png")],
        ["--log", &at("notes.txt")],
        ["--log", &at("models.json")],
    ] {
        let mut arguments = arguments.to_vec();
        if arguments[0] == "--log" {
            arguments.extend(["-o", &frames]);
        }
        let mut command = video(&folders, &arguments);
        assert_refused(command.env("PATH", &copies), &scene, &[arguments[0], arguments[1]]);
        assert_eq!(folders.written(), Vec::<String>::new(), "{arguments:?}");
    }
    // Through links to the rig and to the file.
    symlink(&scene, folders.out("link")).unwrap();
    symlink(at("cam6.mp4"), folders.out("a.mp4")).unwrap();
    for name in ["link/cam6.mp4", "link/cam0/../cam6.mp4", "a.mp4"] {
        assert_refused(video(&folders, &["-o", &folders.out(name)]).env("PATH", &copies), &scene, &["-o", name]);
    }
    // Poses and models are inputs as well.
    let poses = folders.out("poses.json");
    fs::write(&poses, r#"[{"cam_from_world": [[1, 0, 0, -0.25], [0, -1, 0, 0], [0, 0, -1, 0]]}]"#).unwrap();
    let model = folders.out("model.onnx");
    fs::copy(fixture("tiny_v4"), &model).unwrap();
    let out = Path::new(&poses).parent().unwrap();
    fs::remove_file(folders.out("link")).unwrap();
    let mut command =
        folders.liveview("video", &["--poses", &poses, "--model", &model, "-o", &frames, "--log", &poses]);
    assert_refused(&mut command, out, &["--log", "--poses", "poses.json"]);
    let mut command =
        folders.liveview("video", &["--poses", &poses, "--model", &model, "-o", &frames, "--log", &model]);
    assert_refused(&mut command, out, &["--log", "--model", "model.onnx"]);
    let mut inside = video(&folders, &["-o", &frames, "--log", &folders.out("frames/frame_000001.png")]);
    assert_refused(&mut inside, out, &["--log", "-o"]);
}

#[test]
fn log_can_be_a_pipe_or_a_device() {
    let folders = rig(2);
    let (frames, fifo, null) = (folders.out("frames"), folders.out("fifo"), folders.out("null"));
    assert!(Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    symlink("/dev/null", &null).unwrap();
    succeeds(&mut video(&folders, &["-o", &frames, "--log", &null]));
    assert!(fs::symlink_metadata(&null).unwrap().is_symlink(), "not replaced by a file");
    let (path, (sender, lines)) = (fifo.clone(), std::sync::mpsc::channel());
    std::thread::spawn(move || {
        let mut text = String::new();
        fs::File::open(path).unwrap().read_to_string(&mut text).unwrap();
        sender.send(text).unwrap();
    });
    succeeds(&mut video(&folders, &["-o", &frames, "--log", &fifo]));
    let lines = lines.recv_timeout(Duration::from_secs(60)).expect("the log went into the pipe");
    assert_eq!(lines.lines().count(), 2, "{lines}");
}

#[test]
fn photos_that_the_scene_does_not_use_are_not_overwritten() {
    let (folders, root) = llff();
    let at = |name: &str| root.join(name).to_str().unwrap().to_owned();
    let render = |arguments: &[&str]| {
        let mut render = assert_cmd::Command::new(env!("CARGO_BIN_EXE_liveview"));
        render.arg("render").arg(&root).args(["--model", &fixture("tiny_v4"), "--layers", "guided:1"]).args(arguments);
        render
    };
    let target = |option: &'static str, name: &str| render(&["--target", "2", option, &at(name)]);
    assert_refused(&mut target("-o", "images/1.png"), &root, &["-o", "images/1.png", "llff"]);
    assert_refused(&mut target("-o", "images_4/../images/1.png"), &root, &["-o", "images/1.png"]);
    // New files that would be read as photos, or make the scene invalid.
    for folder in ["images", "images_4", "images_8", "images_8/below"] {
        assert_refused(&mut render(&["--path", "line:3", "-o", &at(folder)]), &root, &["-o", folder]);
    }
    // New files between the inputs.
    let heldout = ["--heldout", "9", "--depth"];
    assert_refused(
        &mut render(&["--path", "line:3", "-o", &at("images/..")]),
        &root,
        &["-o", "is a folder of the scene"],
    );
    assert_refused(&mut render(&[&heldout[..], &[&at("")]].concat()), &root, &["--depth", "is a folder of the scene"]);
    // The same with a relative path of the scene.
    let mut relative = assert_cmd::Command::new(env!("CARGO_BIN_EXE_liveview"));
    relative.current_dir(root.parent().unwrap()).args(["render", "llff", "--path", "line:3", "-o", "llff/images_8"]);
    relative.args(["--model", &fixture("tiny_v4"), "--layers", "guided:1"]);
    assert_refused(&mut relative, &root, &["-o", "llff/images_8"]);
    // Photos in a linked folder.
    let elsewhere = folders.scene().join("full");
    fs::rename(root.join("images"), &elsewhere).unwrap();
    symlink(&elsewhere, root.join("images")).unwrap();
    let linked = elsewhere.join("1.png");
    assert_refused(&mut render(&["--target", "2", "-o", linked.to_str().unwrap()]), &elsewhere, &["full/1.png"]);
    // New files, and again: the program may overwrite its own files.
    for _ in 0..2 {
        succeeds(&mut render(&["--target", "2", "-o", &at("new.png"), "--depth", &at("made/depth.png")]));
        succeeds(&mut render(&["--path", "line:3", "-o", &at("made/flight")]));
        let mut depth = assert_cmd::Command::new(env!("CARGO_BIN_EXE_liveview"));
        succeeds(depth.arg("depth").arg(&root).args(["--photo", "1.png", "-o", &at("depth")]));
    }
    // But no others.
    fs::copy(elsewhere.join("0.png"), at("made/flight/frame_0001.png")).unwrap();
    assert_refused(&mut render(&["--path", "line:3", "-o", &at("made/flight")]), &root, &["frame_0001.png"]);

    let folders = Folders::new();
    folders.write_scene(4, "", "");
    let mut command = folders.render(&["--path", "line:1", "-o", folders.photo(4).to_str().unwrap()]);
    assert_refused(&mut command, &folders.scene(), &["-o", "images/4.png"]);
}

#[test]
fn outputs_never_overwrite_each_other() {
    let folders = Folders::new();
    fs::create_dir(folders.out("real")).unwrap();
    symlink(folders.out("real"), folders.out("link")).unwrap();
    let out = PathBuf::from(folders.out(""));
    let at = |name: &str| folders.out(name);
    for (first, option, second) in [
        ("a.png", "--explain", "a.png"),
        ("a.png", "--explain", "real/../a.png"),
        ("real/a.png", "--explain", "link/a.png"),
        ("real/a.png", "--compare", "link/../link/a.png"),
        ("new/a.png", "--compare", "new/b/../a.png"),
        ("real/a_colour.png", "--depth", "link/a.png"),
    ] {
        let arguments = ["--target", "2", "-o", &at(first), option, &at(second)];
        assert_refused(&mut folders.render(&arguments), &out, &["expected different files", first, "-o", option]);
    }
    assert!(!Path::new(&at("new")).exists(), "refused before any folder is created");
    let both = ["--explain", &at("link/b.png"), "--depth", &at("real/b.png"), "-o", &at("a.png")];
    assert_refused(&mut folders.render(&[&["--target", "2"], &both[..]].concat()), &out, &["--explain", "--depth"]);
    let folders = rig(2);
    fs::create_dir(folders.out("real")).unwrap();
    symlink(folders.out("real"), folders.out("link")).unwrap();
    let (out, at) = (PathBuf::from(folders.out("")), |name: &str| folders.out(name));
    let copies = folders.ffmpeg(COPIES);
    let mut log = video(&folders, &["-o", &at("real/a.mp4"), "--log", &at("link/a.mp4")]);
    assert_refused(log.env("PATH", copies), &out, &["-o", "--log", "expected different files"]);
}

#[test]
fn no_frame_and_no_coverage_are_errors() {
    let folders = rig(6);
    let (frames, picture) = (folders.out("frames"), folders.out("a.png"));
    folders.assert_refused(&mut video(&folders, &["--frames", "100:", "-o", &frames]), &["--frames 100:", "6"]);
    // Far from everything that the cameras cover.
    let pose = folders.scene().join("pose.json");
    let away = r#"{"cam_from_world": [[1, 0, 0, -50], [0, -1, 0, 0], [0, 0, -1, 0]]}"#;
    fs::write(&pose, away).unwrap();
    for layers in ["planes:2", "guided:1", "surface:1", "surface:3"] {
        let arguments = ["--pose", pose.to_str().unwrap(), "--layers", layers, "-o", &picture];
        folders.assert_refused(&mut folders.render(&arguments), &["pose.json", "no view covers"]);
    }
    fs::write(&pose, format!("[{away}]")).unwrap();
    let poses = ["--poses", pose.to_str().unwrap(), "--layers", "planes:2", "--frames", ":2"];
    let mut video = folders.liveview("video", &[&poses[..], &["--model", &fixture("tiny_v4")]].concat());
    let copies = folders.ffmpeg(COPIES);
    let video = video.args(["-o", &folders.out("a.mp4")]).env("PATH", copies);
    folders.assert_refused(video, &["no camera sees"]);
}

#[test]
fn target_names_may_contain_commas_and_folders() {
    let folders = Folders::new();
    let comma = folders.scene().join("images/a,b.png");
    fs::rename(folders.photo(2), &comma).unwrap();
    folders.write_scene(5, "images/2.png", "images/a,b.png");
    let named = |target: &str| {
        let mut render = folders.liveview("render", &["--target", target, "-o", &folders.out("made"), "--json"]);
        let output = render.args(["--network", "none", "--views", "2"]).output().unwrap();
        assert!(output.status.success(), "{target}: {}", String::from_utf8_lossy(&output.stderr));
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        let targets = report["targets"].as_array().unwrap().iter();
        targets.map(|one| one["name"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(named("a,b.png"), ["a,b.png"]);
    assert_eq!(named("0,a,b.png,1.png"), ["0.png", "a,b.png", "1.png"]);
    assert_eq!(named("images/3.png"), ["3.png"]);
    assert_eq!(named("images/a,b.png,images/3.png"), ["a,b.png", "3.png"]);
    fs::remove_dir_all(folders.out("made")).unwrap();
    for option in ["-o", "--depth", "--compare", "--explain"] {
        let mut render = folders.render(&["--target", "1", option, "-"]);
        if option != "-o" {
            render.args(["-o", &folders.out("a.png")]);
        }
        folders.assert_refused(&mut render, &[&format!("{option} -"), "standard output"]);
    }
}

#[test]
fn scene_names_may_start_with_a_dash_or_be_invalid_utf8() {
    let folders = Folders::new();
    for name in [OsStr::new("-s"), OsStr::from_bytes(b"sc\xffne")] {
        let scene = folders.scene().parent().unwrap().join(name);
        symlink(folders.scene(), &scene).unwrap();
        let mut sweep = assert_cmd::Command::new(env!("CARGO_BIN_EXE_liveview"));
        sweep.current_dir(scene.parent().unwrap()).args(["sweep", "--target", "2.png", "--layers", "guided:1"]);
        sweep
            .args(["--repetitions", "1", "--model", &fixture("tiny_v4"), "-o", &folders.out("report"), "--"])
            .arg(name);
        succeeds(&mut sweep);
    }
    assert_eq!(folders.written().len(), 3);
}

#[test]
fn scene_with_photos_in_two_folders_accepts_outputs_in_a_third() {
    let folders = Folders::new();
    let scene = folders.scene();
    let mut poses = fs::read_to_string(scene.join("transforms.json")).unwrap();
    for (view, folder) in ["train", "train", "train", "test", "test"].into_iter().enumerate() {
        fs::create_dir_all(scene.join(folder)).unwrap();
        fs::rename(folders.photo(view), scene.join(format!("{folder}/{view}.png"))).unwrap();
        poses = poses.replace(&format!("images/{view}.png"), &format!("{folder}/{view}.png"));
    }
    fs::write(scene.join("transforms.json"), poses).unwrap();
    let at = |name: &str| scene.join(name).to_str().unwrap().to_owned();
    let render = |output: &str| folders.liveview("render", &["--target", "2", "--network", "none", "-o", output]);
    render(&at("out/a.png")).assert().success();
    assert_refused(&mut render(&at("test/a.png")), &scene, &["-o", "a photo or a camera"]);
}
