//! Interrupted videos, and stalls that could keep the program from ending: the file is complete, or
//! there is none.
#![cfg(target_os = "linux")]

use std::fs;
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

use assert_cmd::Command;
use liveview_files::atomic::TEMPORARY;
use serde_json::Value;

use crate::common::rig::{Rig, ffmpeg, report, stderr};
use crate::common::{HEIGHT, WIDTH, fixture, wait_until};

/// Bytes of a frame written to ffmpeg.
const FRAME: u64 = 3 * WIDTH as u64 * HEIGHT as u64;

/// Starts the program.
fn start(rig: &Rig, command: &str, model: &str, path: &str, arguments: &[&str]) -> Child {
    let mut started = std::process::Command::new(env!("CARGO_BIN_EXE_liveview"));
    started.arg(command).arg(rig.path()).args(arguments).args(["--json", "--model", &fixture(model)]).env("PATH", path);
    started.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Sends a signal once `is_ready`, and waits for the end.
fn signalled(mut child: Child, signal: &str, is_ready: impl Fn() -> bool) -> Output {
    wait_until(&mut child, is_ready);
    Command::new("/bin/kill").args([signal, &child.id().to_string()]).assert().success();
    child.wait_with_output().unwrap()
}

/// Processor time of a process, hundredths of a second.
fn ticks(process: u32) -> u64 {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
    stat.rsplit_once(") ").unwrap().1.split(' ').nth(11).unwrap().parse().unwrap()
}

/// Whether ffmpeg has written a frame: before that an interrupt leaves nothing to finish.
fn is_begun(rig: &Rig) -> bool {
    let written = rig.folders.written();
    written.iter().any(|name| fs::metadata(rig.folders.out(name)).is_ok_and(|file| file.len() >= FRAME))
}

/// Asserts that the video has the reported number of frames, and that no other file is written.
fn assert_complete(rig: &Rig, output: &Output) {
    assert_eq!(output.status.code(), Some(130), "{}", stderr(output));
    assert!(stderr(output).contains("error: interrupted: ") && stderr(output).contains("a.mp4 is short, it has "));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(report["stopped"] == true, "{report}");
    assert_eq!(rig.folders.written(), ["a.mp4"]);
    assert_eq!(fs::metadata(rig.folders.out("a.mp4")).unwrap().len(), report["frames"].as_u64().unwrap() * FRAME);
}

#[test]
fn terminating_signals_leave_a_complete_video() {
    let rig = Rig::new(100);
    let (film, path) = (rig.folders.out("a.mp4"), ffmpeg(&rig.folders, ""));
    // Under `nohup` SIGHUP stays ignored.
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap();
    let nohup = u64::from_str_radix(ignored.trim(), 16).unwrap() & 1 == 1;
    for signal in ["-TERM", "-HUP", "-INT"].into_iter().filter(|&signal| signal != "-HUP" || !nohup) {
        let live = ["--camera", "cam2", "--fps", "5", "--latency", "1s", "-o", &film];
        let video = start(&rig, "video", "tiny_v4", &path, &live);
        assert_complete(&rig, &signalled(video, signal, || is_begun(&rig)));
        fs::remove_file(&film).unwrap();
    }
}

#[test]
fn stalled_camera_does_not_keep_the_program_running() {
    let rig = Rig::new(8);
    fs::remove_file(rig.frame(1, 5)).unwrap();
    Command::new("mkfifo").arg(rig.frame(1, 5)).assert().success();
    let (film, path) = (rig.folders.out("a.mp4"), ffmpeg(&rig.folders, ""));
    let mut live = rig.video(&["--camera", "cam2", "--fps", "10", "--latency", "1s", "-o", &film]);
    let (report, _) = report(live.env("PATH", &path).timeout(Duration::from_secs(60)));
    let fault = &report["faults"][0];
    assert!(fault["camera"] == "cam1" && fault["not_delivered"] == 3, "{report}");
    fs::remove_file(&film).unwrap();
    // Without --latency the program waits for it, until Ctrl-C.
    let video = start(&rig, "video", "tiny_v4", &path, &["--camera", "cam2", "-o", &film]);
    assert_complete(&rig, &signalled(video, "-INT", || is_begun(&rig)));
}

#[test]
fn hanging_encoder_and_network_end_after_one_interrupt() {
    let rig = Rig::new(30);
    let (film, frames) = (rig.folders.out("a.mp4"), rig.folders.out("frames"));
    let script = format!("[ \"$last\" = - ] || {{ /usr/bin/head -c {FRAME} > \"$last\"; exec /bin/sleep 600; }}");
    let hanging = ffmpeg(&rig.folders, &script);
    let started = Instant::now();
    let video = ["--camera", "cam2", "-o"];
    let encoder = start(&rig, "video", "tiny_v4", &hanging, &[&video[..], &[&film]].concat());
    let model = start(&rig, "video", "endless_v4", "", &[&video[..], &[&frames]].concat());
    // All work before the network takes far less.
    let process = model.id();
    let model = std::thread::spawn(move || signalled(model, "-TERM", || ticks(process) > 300));
    let encoder = signalled(encoder, "-INT", || is_begun(&rig));
    let model = model.join().unwrap();
    assert!(started.elapsed() < Duration::from_secs(120));
    assert_eq!(
        (encoder.status.code(), model.status.code()),
        (Some(2), Some(130)),
        "{}",
        stderr(&encoder) + &stderr(&model)
    );
    assert!(stderr(&encoder).contains("a.mp4: ffmpeg was idle for too long and was killed"), "{}", stderr(&encoder));
    assert!(
        stderr(&model).contains("note: frame 0 was given up") && stderr(&model).ends_with("error: interrupted\n"),
        "{}",
        stderr(&model)
    );
    assert!(!stderr(&model).contains("onnxruntime"), "its own log: {}", stderr(&model));
    assert!(!rig.folders.written().iter().any(|name| name.contains(TEMPORARY)), "{:?}", rig.folders.written());
}
