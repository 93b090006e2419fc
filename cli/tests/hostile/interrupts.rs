//! Interrupted commands leave no temporary file.

use std::fs;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::common::{Folders, fixture, wait_until};
use crate::program;

fn send(signal: &str, to: &Child) {
    assert!(Command::new("/bin/kill").args([signal, &to.id().to_string()]).status().unwrap().success());
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
fn interrupted_sweep_leaves_no_file_and_no_worker() {
    let folders = Folders::new();
    let mut sweep = Command::new(program());
    sweep.arg("sweep").arg(folders.scene()).args(["--target", "2", "--model", &fixture("tiny_v4")]);
    sweep.args(["--layers", "planes:64", "--repetitions", "1000", "-o", &folders.out("report")]);
    let mut running = sweep.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let children = format!("/proc/{0}/task/{0}/children", running.id());
    let worker = || fs::read_to_string(&children).unwrap_or_default().split_whitespace().next().map(str::to_owned);
    // Empty once the process has ended, and until it is another program than that which started it.
    let command = |worker: &str| fs::read_to_string(format!("/proc/{worker}/cmdline")).unwrap_or_default();
    wait_until(&mut running, || worker().is_some_and(|worker| command(&worker).contains("--worker")));
    let worker = worker().unwrap();
    send("-INT", &running);
    running.wait().unwrap();
    let ended = (0..600).any(|_| {
        command(&worker).is_empty() || {
            sleep(Duration::from_millis(100));
            false
        }
    });
    assert_eq!((ended, folders.written()), (true, Vec::new()));
}
