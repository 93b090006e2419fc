//! Failures outside the program: a full disk, a killed process, photos that disappear, several runs
//! at once. No file is ever written in part, and `--resume` continues.
#![cfg(target_os = "linux")]

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::{MetadataExt, symlink};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Command, Output, Stdio};

use liveview::image;
use liveview_files::atomic::TEMPORARY;
use serde_json::Value;

use crate::common::{Folders, HEIGHT, WIDTH, fixture, photo, wait_until};

/// Frames of a path whose record exceeds the file size [`MAX_BLOCKS`], while each frame does not.
const FRAMES: usize = 300;
/// Limit of the file size for `ulimit -f`, in blocks of 512 or 1024 bytes.
const MAX_BLOCKS: usize = 32;

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

fn json(command: &mut assert_cmd::Command) -> Value {
    let output = command.arg("--json").output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).unwrap()
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
fn failed_run_is_continued_by_resume() {
    let folders = Folders::new();
    // All frames use the planes that the first frame selects: they must be selected again.
    let path = format!("line:{FRAMES}");
    let arguments = |name| {
        let frames = folders.out(name);
        ["--path", &path, "--layers", "select:2/8", "--width", "16", "-o", &frames].map(str::to_owned)
    };
    let (whole, parts) = (arguments("whole"), arguments("parts"));
    let [whole, parts] = [&whole, &parts].map(|list| list.iter().map(String::as_str).collect::<Vec<_>>());
    json(&mut folders.render(&whole));

    let output = limited(&folders, MAX_BLOCKS, false, "render", &parts).output().unwrap();
    assert_eq!(output.status.signal(), Some(25), "SIGXFSZ during a write: {}", stderr(&output));
    // Another process may be writing such a file.
    fs::write(folders.out(&format!("parts/{TEMPORARY}other.png")), "").unwrap();
    let killed = contents(&folders);
    let left: Vec<_> = killed.keys().filter(|name| name.starts_with("parts/")).collect();
    let (temporary, frames): (Vec<_>, Vec<_>) = left.into_iter().partition(|name| is_temporary(name));
    assert_eq!(temporary.len(), 1, "the other process's; this one was writing a line of the record");
    assert!(frames.len() > 3 && frames.len() < FRAMES, "{frames:?}");
    for frame in frames.iter().filter(|name| name.ends_with(".png")) {
        image::load(folders.out(frame).as_ref()).unwrap();
    }

    // The disk is still full.
    let more = [&parts[..], &["--resume"]].concat();
    let output = limited(&folders, MAX_BLOCKS, true, "render", &more).output().unwrap();
    let report = stderr(&output);
    // Without the record, and the frame whose line was being written.
    let kept = frames.len() - 2;
    assert_eq!(output.status.code(), Some(2), "{report}");
    for words in [
        format!("note: {kept} of {FRAMES} pictures are kept"),
        format!("note: {kept} of {FRAMES} pictures are in {}; add --resume", folders.out("parts")),
        "parts/liveview.jsonl: cannot be written: File too large".to_owned(),
    ] {
        assert!(report.contains(&words), "\"{words}\" is missing in: {report}");
    }
    assert_eq!(contents(&folders).len(), killed.len(), "no second temporary file");

    let first = || fs::metadata(folders.out("parts/frame_0000.png")).unwrap().ino();
    let before = first();
    assert_eq!(json(&mut folders.render(&more))["kept"], kept);
    assert_eq!(first(), before, "kept, not written again");
    let after = contents(&folders);
    for (name, frame) in after.iter().filter(|(name, _)| name.starts_with("whole/") && name.ends_with(".png")) {
        assert!(frame == &after[&name.replace("whole", "parts")], "{name}");
    }
    assert_eq!(after.keys().filter(|name| is_temporary(name)).count(), 1, "--resume does not delete it");
    let again = folders.render(&more).output().unwrap();
    assert!(again.status.success() && stderr(&again).contains(&format!("{FRAMES} of {FRAMES} pictures are kept\n")));
    let record = fs::read_to_string(folders.out("parts/liveview.jsonl")).unwrap();
    let cut = record.lines().filter(|line| serde_json::from_str::<Value>(line).is_err()).count();
    assert!(cut > 0 && record.lines().count() == FRAMES + cut, "{cut} lines that were cut spoil no other");
    folders.render(&parts).assert().success();
    assert_ne!(first(), before, "without --resume, written again");
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
fn resume_renders_pictures_with_missing_or_changed_files_again() {
    let folders = seven_photos();
    let [pictures, depth, compare] = ["pictures", "depth", "compare"].map(|name| folders.out(name));
    let arguments = ["--heldout", "4", "-o", &pictures, "--depth", &depth, "--compare", &compare];
    let untimed = |mut report: Value| {
        report["targets"].as_array_mut().unwrap().iter_mut().for_each(|target| drop(target["seconds"].take()));
        (report["targets"].take(), report["mean"].take())
    };
    let first = json(&mut folders.render(&arguments));
    assert_eq!(first["kept"], 0);
    let (first, written, mut lines) = (untimed(first), contents(&folders), 2);
    for (file, how) in [
        ("pictures/0.png", "missing"),
        ("compare/4.png", "missing"),
        ("pictures/4.png", "truncated"),
        ("depth/0_scale.json", "truncated"),
        ("depth/0_colour.png", "another"),
    ] {
        let file = folders.out(file);
        match how {
            "missing" => fs::remove_file(&file).unwrap(),
            "truncated" => fs::write(&file, &fs::read(&file).unwrap()[..40]).unwrap(),
            _ => drop(fs::copy(folders.out("depth/4_colour.png"), &file).unwrap()),
        }
        let report = json(folders.render(&arguments).arg("--resume"));
        assert_eq!(report["kept"], 1, "{file}");
        let mut again = contents(&folders);
        let record =
            again.insert("pictures/liveview.jsonl".into(), written["pictures/liveview.jsonl"].clone()).unwrap();
        assert!(untimed(report) == first && again == written, "{file}, {how}");
        lines += 1;
        assert_eq!(
            record.iter().filter(|&&byte| byte == b'\n').count(),
            lines,
            "a line for the picture that was rendered"
        );
    }
    let output = folders.render(&arguments).arg("--resume").output().unwrap();
    let report = String::from_utf8_lossy(&output.stdout);
    assert!(report.contains("kept") && report.contains("mean") && !report.contains("wrote"), "{report}");
}

#[test]
fn resume_tells_planes_of_a_given_range_from_those_of_a_refined_one() {
    let folders = Folders::new();
    let frames = folders.out("frames/");
    let planes = ["--target", "2", "--layers", "planes:2", "-o", &frames, "--resume"];
    assert_eq!(json(&mut folders.render(&planes))["kept"], 0);
    let given = [&planes[..], &["--near", "2", "--far", "8"]].concat();
    assert_eq!(json(&mut folders.render(&given))["kept"], 0);
    assert_eq!(json(&mut folders.render(&given))["kept"], 1);
}

#[test]
fn resume_keeps_pictures_of_the_same_job_only() {
    let folders = Folders::new();
    let frames = folders.out("frames");
    let render = |arguments: &[&str]| folders.render(&[&["-o", &frames], arguments].concat());
    let resumed = |arguments: &[&str]| {
        let output = render(arguments).arg("--resume").output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        stderr(&output)
    };
    let line = ["--path", "line:3"];
    // Bytes after the end of a picture are not read: this gives photos the same length.
    let pad = |file: &Path| fs::File::options().write(true).open(file).unwrap().set_len(8192).unwrap();
    pad(&folders.photo(3));
    assert_eq!(json(render(&line).arg("--resume"))["kept"], 0, "an empty folder");
    let written = contents(&folders);
    let mut lines = 3;
    // Renders another job, of so many frames, into the folder; then it is as before.
    let mut is_another = |arguments: &[&str], count: usize| {
        let words =
            format!("note: 0 of {count} pictures are kept; {lines} lines of {frames}/liveview.jsonl are of other jobs");
        let report = resumed(arguments);
        assert!(report.contains(&words), "{arguments:?}: {report}");
        lines += count;
        let pictures = written.iter().filter(|(name, _)| name.ends_with(".png"));
        pictures.for_each(|(name, bytes)| fs::write(folders.out(name), bytes).unwrap());
    };
    is_another(&["--path", "line:4"], 4);
    is_another(&["--path", "line:3", "--layers", "guided:3"], 3);
    is_another(&["--path", "line:3", "--layers", "list:0.3"], 3);
    is_another(&["--path", "line:3", "--width", "32"], 3);
    is_another(&["--path", "line:3", "--near", "1"], 3);
    folders.write_scene(5, "0, 0.2]", "0, 0.21]");
    is_another(&line, 3);
    folders.write_scene(5, "\"near\"", "\"k1\": 0.01, \"near\"");
    is_another(&line, 3);
    folders.write_scene(5, "", "");
    let bytes = fs::read(folders.photo(3)).unwrap();
    photo(&folders.photo(3), 7.0, WIDTH, HEIGHT);
    assert!(folders.photo(3).metadata().unwrap().len() < 8192);
    pad(&folders.photo(3));
    is_another(&line, 3);
    fs::write(folders.photo(3), bytes).unwrap();
    assert_eq!(
        json(render(&line).args(["--resume", "--threads", "1", "--batch", "2"]))["kept"],
        3,
        "threads and batch size do not affect the pictures"
    );
    let model = folders.scene().join("other.onnx");
    fs::copy(fixture("tiny_v4"), &model).unwrap();
    let mut moved = folders.liveview("render", &["--path", "line:3", "-o", &frames, "--resume"]);
    assert_eq!(json(moved.arg("--model").arg(&model))["kept"], 3, "nor do names of files");

    // A frame of another job with the same name. Only inner frames, between the views, depend on
    // the layers.
    let (guided, planes) = (["--path", "line:4", "--layers", "guided:2"], ["--path", "line:4", "--layers", "planes:3"]);
    json(&mut render(&guided));
    let guided_frames = contents(&folders);
    json(&mut render(&planes));
    let plane_frames = contents(&folders);
    let frame = "frames/frame_0001.png";
    fs::write(folders.out(frame), &guided_frames[frame]).unwrap();
    assert_eq!(json(render(&planes).arg("--resume"))["kept"], 3);
    assert!(guided_frames[frame] != plane_frames[frame] && contents(&folders)[frame] == plane_frames[frame]);
    // The lines of the first job are still there.
    for (name, bytes) in written.iter().filter(|(name, _)| name.ends_with(".png")) {
        fs::write(folders.out(name), bytes).unwrap();
    }
    assert_eq!(json(render(&line).arg("--resume"))["kept"], 3);

    for damaged in ["{", "[]", "1\n\"a\"\n{\"job\": 2}\n\n", ""] {
        fs::write(folders.out("frames/liveview.jsonl"), damaged).unwrap();
        assert_eq!(json(render(&line).arg("--resume"))["kept"], 0, "{damaged}");
        assert_eq!(json(render(&line).arg("--resume"))["kept"], 3, "{damaged}");
    }
    fs::remove_file(folders.out("frames/liveview.jsonl")).unwrap();
    assert!(resumed(&line).starts_with("note: 0 of 3 pictures are kept\n"), "no lines of other jobs");
}

#[test]
fn resume_of_a_single_file_is_an_error() {
    let folders = Folders::new();
    let picture = folders.out("a.png");
    let refused = |arguments: &[&str], words: &[&str]| {
        folders.assert_refused(folders.render(arguments).env("PATH", folders.ffmpeg("")).arg("--resume"), words);
    };
    refused(&["--target", "2", "-o", &picture], &["--resume, -o", "a.png", "expected a folder of pictures"]);
    refused(
        &["--path", "line:3", "-o", &folders.out("a.mp4")],
        &["--resume, -o", "a.mp4", "expected a folder of pictures"],
    );
    refused(&["--heldout", "5"], &["--output"]);
    refused(&["--target", "2", "-o", &folders.out("f"), "--explain", &picture], &["--explain", "cannot be used with"]);
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
    wait_until(&mut running, || fs::exists(folders.out("frames/liveview.jsonl")).unwrap());
    fs::remove_file(&photo).unwrap();
    let output = running.wait_with_output().unwrap();
    let report = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{report}");
    for words in ["images/4.png: cannot be read", "of 400 pictures are in", "add --resume to render the rest"] {
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
fn concurrent_runs_write_complete_files_and_a_record_of_each() {
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
    assert_eq!(written.len(), 3 * 21, "{:?}", written.keys());
    for frame in (0..20).map(|frame| format!("frame_{frame:04}.png")) {
        let [both, three, five] = ["both", "three", "five"].map(|folder| &written[&format!("{folder}/{frame}")]);
        assert!(both == three || both == five, "{frame}");
    }
    // Each job continues with the pictures that are its own.
    let record = String::from_utf8(written["both/liveview.jsonl"].clone()).unwrap();
    let lines: Vec<Value> = record.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 3 * 20);
    for (layers, alone) in [("planes:3", "three"), ("planes:5", "five")] {
        let own = |written: &BTreeMap<String, Vec<u8>>| {
            let same = |frame: &usize| {
                let [both, alone] = ["both", alone].map(|folder| &written[&format!("{folder}/frame_{frame:04}.png")]);
                both == alone
            };
            (0..20).filter(same).count()
        };
        let kept = own(&contents(&folders));
        let output = picture(layers, "both").arg("--resume").output().unwrap();
        assert!(stderr(&output).contains(&format!("{kept} of 20 pictures are kept; ")), "{}", stderr(&output));
        assert_eq!(own(&contents(&folders)), 20, "{layers}");
    }
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
