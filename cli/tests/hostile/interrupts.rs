//! Interrupted commands leave no temporary file, and a reader of standard output that leaves early
//! loses nothing.

use std::fs::{self, File};
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::Duration;

use serde_json::{Value, json};

use crate::common::{Folders, fixture, wait_until};
use crate::program;

/// Runs a command, and interrupts it as soon as it has begun to write a file.
fn interrupted(folders: &Folders, command: &mut Command) -> Output {
    let mut running = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_until(&mut running, || !folders.written().is_empty());
    send("-INT", &running);
    running.wait_with_output().unwrap()
}

fn send(signal: &str, to: &Child) {
    assert!(Command::new("/bin/kill").args([signal, &to.id().to_string()]).status().unwrap().success());
}

fn assert_nothing_is_left(folders: &Folders, output: &Output) {
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!((output.status.code(), folders.written()), (Some(130), Vec::new()), "{stderr}");
    assert!(stderr.ends_with("error: interrupted\n"), "{stderr}");
}

#[test]
fn interrupted_join_leaves_no_file() {
    let folders = Folders::new();
    let parts = folders.scene().join("parts");
    let render = ["--network", "none", "--threads", "1", "--path", "line:60", "--shard", "1/1", "-o"];
    folders.liveview("render", &render).arg(&parts).assert().success();
    // It reads its input too slowly for the program to be done before the interrupt.
    let slow = "for last; do :; done; /usr/bin/head -c 9216 > \"$last\"; /bin/sleep 1; exec /bin/cat >> \"$last\"";
    let mut join = Command::new(program());
    join.arg("join").arg(parts).args(["-o", &folders.out("a.mp4")]).env("PATH", folders.ffmpeg(slow));
    assert_nothing_is_left(&folders, &interrupted(&folders, &mut join));
}

#[test]
fn command_that_a_signal_ends_at_once_leaves_no_file() {
    let folders = Folders::new();
    // It does not read, so the program cannot finish the video.
    let idle = folders.ffmpeg("exec /bin/sleep 8");
    // Of one picture, the first signal ends the program; of two, the second Ctrl-C.
    for (path, signals, code) in [
        ("line:1", &["-INT"][..], None),
        ("line:1", &["-TERM"], None),
        ("line:2", &["-INT", "-INT"], Some(130)),
        ("line:2", &["-TERM", "-INT"], Some(130)),
    ] {
        let mut render = Command::new(program());
        render.arg("render").arg(folders.scene()).args(["--network", "none", "--threads", "1", "--path", path]);
        render.args(["-o", &folders.out("a.mp4")]).env("PATH", &idle).stdout(Stdio::null()).stderr(Stdio::null());
        let mut running = render.spawn().unwrap();
        wait_until(&mut running, || !folders.written().is_empty());
        for signal in signals {
            // Not so soon after another that both arrive as one, nor before the program waits for ffmpeg.
            sleep(Duration::from_millis(500));
            send(signal, &running);
        }
        let status = running.wait().unwrap();
        assert_eq!((status.code(), folders.written()), (code, Vec::new()), "{path} {signals:?}");
    }
}

#[test]
fn interrupted_sweep_leaves_no_folder() {
    let folders = Folders::new();
    let temporary = folders.scene().join("temporary");
    fs::create_dir(&temporary).unwrap();
    let mut sweep = Command::new(program());
    sweep.arg("sweep").arg(folders.scene()).args(["--target", "2", "--model", &fixture("tiny_v4")]);
    sweep.args(["--layers", "planes:64", "--repetitions", "1000", "-o", &folders.out("report")]);
    sweep.env("TMPDIR", &temporary).stdout(Stdio::null()).stderr(Stdio::null());
    let mut running = sweep.spawn().unwrap();
    // Folders alone: ONNX Runtime writes a file of its own there, `.ses`.
    let count = || fs::read_dir(&temporary).unwrap().filter(|entry| entry.as_ref().unwrap().path().is_dir()).count();
    wait_until(&mut running, || count() == 1);
    send("-INT", &running);
    running.wait().unwrap();
    assert_eq!((count(), folders.written()), (0, Vec::new()));
}

#[test]
fn batch_runs_and_records_all_commands_without_a_reader() {
    let folders = Folders::new();
    let (list, done) = (folders.scene().join("list"), folders.scene().join("done"));
    let command = |name: &str| {
        json!([folders.scene(), "--target", "2", "--network", "none", "--threads", "1", "-o", folders.out(name)])
    };
    fs::write(&list, ["a.png", "b.png"].map(|name| command(name).to_string()).join("\n")).unwrap();
    let entries = || fs::read_to_string(&done).unwrap().lines().count();
    let mut batch = Command::new(program());
    batch.arg("batch").arg(&list).arg("--done").arg(&done).stderr(Stdio::piped());

    let output = batch.stdout(File::options().write(true).open("/dev/full").unwrap()).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), entries()), (Some(2), 1), "{stderr}");
    assert!(stderr.contains("error: standard output: cannot be written: No space left on device"), "{stderr}");

    fs::remove_file(&done).unwrap();
    let mut running = batch.stdout(Stdio::piped()).spawn().unwrap();
    drop(running.stdout.take());
    let output = running.wait_with_output().unwrap();
    assert_eq!((output.status.code(), entries()), (Some(0), 2), "{}", String::from_utf8_lossy(&output.stderr));
    let first: Value = serde_json::from_str(fs::read_to_string(&done).unwrap().lines().next().unwrap()).unwrap();
    assert!(first["result"].is_object() && folders.written() == ["a.png", "b.png"], "{first}");
}
