//! Failures outside the program: a full disk, a killed process, photos that disappear, several runs
//! at once. No file is ever written in part.
#![cfg(target_os = "linux")]

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Command, Output, Stdio};

use liveview::image;
use liveview_files::atomic::TEMPORARY;

use crate::common::{Folders, HEIGHT, WIDTH, fixture, photo, wait_until};

/// A command that cannot write files larger than `blocks`: with `trap` the write fails, otherwise
/// the process is killed.
fn limited(folders: &Folders, blocks: usize, trap: bool, command: &str, arguments: &[&str]) -> assert_cmd::Command {
    let trap = if trap { "trap '' XFSZ; " } else { "" };
    let mut limited = assert_cmd::Command::new("/bin/sh");
    limited.args(["-c", &format!("ulimit -c 0; {trap}ulimit -f {blocks}; exec \"$0\" \"$@\"")]);
    limited.args([env!("CARGO_BIN_EXE_liveview"), command]).arg(folders.scene()).args(arguments);
    // ONNX Runtime writes a database of several megabytes, even if the program disables its
    // telemetry.
    limited.args(["--model", &fixture("tiny_v4")]).env("ORT_DISABLE_TELEMETRY", "1");
    limited
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// All written files by name, with their contents.
fn contents(folders: &Folders) -> BTreeMap<String, Vec<u8>> {
    let read = |name: String| {
        let bytes = fs::read(folders.out(&name)).unwrap();
        (name, bytes)
    };
    folders.written().into_iter().map(read).collect()
}

/// Whether a name of [`contents`] is that of a temporary file.
fn is_temporary(name: &str) -> bool {
    name.rsplit('/').next().unwrap().starts_with(TEMPORARY)
}

/// A scene with seven photos.
fn seven_photos() -> Folders {
    let folders = Folders::new();
    (5..7).for_each(|view| photo(&folders.photo(view), 0.1 * view as f64, WIDTH, HEIGHT));
    folders.write_scene(7, "", "");
    folders
}

#[test]
fn full_disk_is_an_error_that_leaves_no_file() {
    let folders = Folders::new();
    let [picture, jpeg, depth, report] = ["a.png", "a.jpg", "depth.png", "r"].map(|name| folders.out(name));
    for (command, arguments, file) in [
        ("render", vec!["--target", "2", "-o", &picture], "a.png"),
        ("render", vec!["--target", "2", "-o", &jpeg], "a.jpg"),
        ("render", vec!["--path", "line:2", "-o", &folders.out("frames")], "frame_0000.png"),
        ("render", vec!["--heldout", "5", "--depth", &depth], "depth.png"),
        ("render", vec!["--heldout", "5", "--compare", &picture], "a.png"),
        ("render", vec!["--target", "2", "-o", &jpeg, "--explain", &picture], "a.png"),
        ("sweep", vec!["--target", "2", "--layers", "guided:1", "-o", &report], "sweep.json"),
    ] {
        let mut command = limited(&folders, 1, true, command, &arguments);
        folders.assert_refused(&mut command, &[file, "cannot be written: File too large"]);
    }
    let copies = "for last; do :; done; /bin/cat > \"$last\" 2>/dev/null || { echo no space >&2; exit 1; }";
    let mut video = limited(&folders, 1, true, "render", &["--path", "line:3", "-o", &folders.out("a.mp4")]);
    folders.assert_refused(video.env("PATH", folders.ffmpeg(copies)), &["a.mp4", "ffmpeg failed", "no space"]);
}

#[test]
fn full_stdout_is_an_error_and_a_closed_pipe_is_not() {
    let folders = Folders::new();
    let report = |stdout: Stdio| {
        let mut inspect = Command::new(env!("CARGO_BIN_EXE_liveview"));
        inspect.arg("inspect").arg(folders.scene()).stdout(stdout).stderr(Stdio::piped()).output().unwrap()
    };
    let output = report(fs::File::create("/dev/full").unwrap().into());
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("standard output: cannot be written: No space left on device"),
        "{}",
        stderr(&output)
    );
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    assert!(report(writer.into()).status.success(), "a closed pipe is not an error");
}

#[test]
fn interrupted_render_leaves_only_complete_files() {
    let folders = Folders::new();
    let (frames, film) = (folders.out("frames"), folders.out("a.mp4"));
    let interrupted = |output: &str, is_started: &dyn Fn() -> bool| {
        let mut render = Command::new(env!("CARGO_BIN_EXE_liveview"));
        render.arg("render").arg(folders.scene()).args(["--path", "line:2000", "--model", &fixture("tiny_v4")]);
        render
            .args(["-o", output])
            .env("PATH", folders.ffmpeg("for last; do :; done; echo started > \"$last\"; exec /bin/cat > /dev/null"));
        // As in a terminal, the signal goes to the whole process group.
        let mut render = render.process_group(0).stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        wait_until(&mut render, is_started);
        let kill = Command::new("/bin/kill").args(["-INT", "--", &format!("-{}", render.id())]).status().unwrap();
        let output = render.wait_with_output().unwrap();
        assert!(kill.success() && output.status.code() == Some(130), "{}", stderr(&output));
        assert!(stderr(&output).ends_with("error: interrupted\n"), "{}", stderr(&output));
        stderr(&output)
    };
    let report = interrupted(&frames, &|| Path::new(&folders.out("frames/frame_0009.png")).exists());
    assert!(report.contains("of 2000 pictures are in"), "{report}");
    // A file may vanish between its name and its size.
    let is_film = |name: String| {
        !name.starts_with("frames/") && fs::metadata(folders.out(&name)).is_ok_and(|about| about.len() > 0)
    };
    interrupted(&film, &|| folders.written().into_iter().any(is_film));
    let left = contents(&folders);
    assert!(left.keys().all(|name| name.starts_with("frames/") && !is_temporary(name)), "{:?}", left.keys());
    for name in left.keys().filter(|name| name.ends_with(".png")) {
        image::load(folders.out(name).as_ref()).unwrap();
    }
}

#[test]
fn photo_that_disappears_during_the_run_is_an_error() {
    let folders = Folders::new();
    let video = folders.out("a.mp4");
    let bytes = fs::read(folders.photo(4)).unwrap();
    // The last photo is needed in the second half of the path only; the first frame starts the
    // encoder.
    let photo = folders.photo(4).display().to_string();
    let refused = |script: &str, words: &[&str]| {
        let encoder = folders.ffmpeg(&format!("{script}; for last; do :; done; /bin/cat > \"$last\""));
        let mut render = folders.render(&["--path", "line:400", "--layers", "guided:1", "-o", &video]);
        folders.assert_refused(render.env("PATH", encoder), &[&["images/4.png"], words].concat());
        fs::write(&photo, &bytes).unwrap();
    };
    refused(&format!("/bin/rm {photo}"), &["cannot be read: No such file"]);
    refused(&format!("echo > {photo}"), &["not a complete picture"]);
    crate::common::photo(&folders.scene().join("larger.png"), 0.4, 2 * WIDTH, HEIGHT);
    refused(
        &format!("/bin/mv {} {photo}", folders.scene().join("larger.png").display()),
        &["expected equal sizes", "128x48"],
    );

    // Finished frames are kept.
    let frames = folders.out("frames");
    let arguments = ["--path", "line:400", "--layers", "guided:1", "-o", &frames];
    let mut render = Command::new(env!("CARGO_BIN_EXE_liveview"));
    render.arg("render").arg(folders.scene()).args(arguments).args(["--model", &fixture("tiny_v4")]);
    let mut running = render.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    wait_until(&mut running, || fs::exists(folders.out("frames/frame_0000.png")).unwrap());
    fs::remove_file(&photo).unwrap();
    let output = running.wait_with_output().unwrap();
    let report = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{report}");
    for words in ["images/4.png: cannot be read", "of 400 pictures are in", " renders the rest"] {
        assert!(report.contains(words), "\"{words}\" is missing in: {report}");
    }
    let written = folders.written();
    assert!(written.len() > 100 && !written.iter().any(|name| is_temporary(name)), "{} files", written.len());
}

#[test]
fn failed_encoder_leaves_no_video() {
    let folders = Folders::new();
    let arguments = ["--path", "line:3", "-o", &folders.out("a.mp4")];
    let last = "for last; do :; done";
    let broken = |script: &str, words: &[&str]| {
        let path = folders.ffmpeg(&format!("{last}; {script}"));
        folders.assert_refused(
            folders.render(&arguments).env("PATH", path),
            &[&["a.mp4", "ffmpeg failed"], words].concat(),
        );
    };
    broken("/usr/bin/head -c 100 > \"$last\"; echo no more >&2; exit 3", &["exit status: 3", "no more"]);
    broken("/usr/bin/head -c 100 > \"$last\"; kill -9 $$", &["signal: 9"]);
    // The encoder deletes its file.
    let path = folders.ffmpeg(&format!("{last}; /bin/cat > /dev/null; /bin/rm \"$last\""));
    folders.assert_refused(
        folders.render(&arguments).env("PATH", path),
        &["a.mp4: the video that ffmpeg wrote cannot be read"],
    );

    let path = folders.ffmpeg(&format!("{last}; kill -9 $PPID; /bin/cat > \"$last\""));
    let output = folders.render(&arguments).env("PATH", path).output().unwrap();
    assert_eq!(output.status.signal(), Some(9));
    assert!(folders.written().iter().all(|name| is_temporary(name)), "{:?}", folders.written());
}

#[test]
fn output_over_a_folder_a_device_or_a_photo_is_an_error() {
    let folders = Folders::new();
    let refused = |arguments: &[&str], words: &[&str]| folders.assert_refused(&mut folders.render(arguments), words);
    let target = |option, path: &str, words: &[&str]| {
        refused(&["--target", "2", "-o", &folders.out("a.png"), option, path], words);
    };
    refused(&["--target", "2", "-o", "/dev/full"], &["-o /dev/full/2.png", "/dev/full is a file; expected a folder"]);
    let file = folders.scene().join("notes");
    fs::write(&file, "").unwrap();
    refused(&["--path", "line:3", "-o", file.to_str().unwrap()], &["notes is a file; expected a folder"]);
    fs::create_dir(folders.out("d_colour.png")).unwrap();
    target("--depth", &folders.out("d.png"), &["--depth", "d_colour.png", "it is a folder"]);
    // A photo of the scene: in the output folder, and through a link.
    let images = folders.scene().join("images");
    let overwrite = "would overwrite a photo of the scene";
    refused(&["--target", "2", "-o", images.to_str().unwrap()], &["images/2.png", overwrite]);
    symlink(&images, folders.scene().join("link")).unwrap();
    target("--compare", folders.scene().join("link/4.png").to_str().unwrap(), &["--compare", "link/4.png", overwrite]);
    let sweep = ["--target", "2", "--model", &fixture("tiny_v4"), "-o", "/dev/full"];
    folders.assert_refused(&mut folders.liveview("sweep", &sweep), &["-o /dev/full/sweep.json", "expected a folder"]);
}

#[test]
fn runs_at_once_write_complete_files() {
    let folders = seven_photos();
    let picture = |layers: &str, name: &str| {
        let mut render = Command::new(env!("CARGO_BIN_EXE_liveview"));
        render.arg("render").arg(folders.scene()).args(["--model", &fixture("tiny_v4"), "--layers", layers]);
        render.args(["--path", "line:20", "-o", &folders.out(name)]).stdout(Stdio::null());
        render
    };
    for (layers, name) in [("planes:3", "three"), ("planes:5", "five")] {
        assert!(picture(layers, name).status().unwrap().success());
    }
    let mut running = ["planes:3", "planes:5", "planes:3"].map(|layers| picture(layers, "both").spawn().unwrap());
    assert!(running.iter_mut().all(|run| run.wait().unwrap().success()));
    let written = contents(&folders);
    assert_eq!(written.len(), 3 * 20, "{:?}", written.keys());
    for frame in (0..20).map(|frame| format!("frame_{frame:04}.png")) {
        let [both, three, five] = ["both", "three", "five"].map(|folder| &written[&format!("{folder}/{frame}")]);
        assert!(both == three || both == five, "{frame}");
    }
}
