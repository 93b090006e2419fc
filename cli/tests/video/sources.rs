//! Cameras that run: what they deliver, and what fails and comes back, is in the report.
#![cfg(target_os = "linux")]

use std::fs;
use std::net::{TcpListener, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::Value;

use crate::common::rig::{Rig, ffmpeg, name_sources, report, running, stderr};
use crate::common::wait_until;

/// What the report says of a source.
fn source<'a>(report: &'a Value, camera: &str) -> &'a Value {
    let sources = report["sources"].as_array().unwrap();
    sources.iter().find(|source| source["camera"] == camera).unwrap_or_else(|| panic!("{camera}: {report}"))
}

#[test]
fn sources_that_end_or_fail_are_started_again() {
    let rig = Rig::new(1);
    let failed = rig.folders.out("failed");
    let script = format!(
        "case $camera in\n\
         1) /bin/cat {0}/1.ppm; exit;;\n\
         2) if [ ! -e {failed} ]; then : > {failed}; echo refused >&2; exit 1; fi;;\n\
         esac",
        rig.path().display()
    );
    let path = running(&rig, &script);
    name_sources(&rig);
    let (out, measured) = (rig.folders.out("frames"), rig.folders.out("measured"));
    let arguments = ["--path", "line:3", "--fps", "10", "--frames", ":30", "--latency", "1s", "--policy", "once"];
    let mut video = rig.video(&arguments);
    let (report, stderr) = report(video.args(["-o", &out, "--measure", &measured]).env("PATH", path));
    let count = |name: &str| report[name].as_u64().unwrap();
    assert_eq!((count("frames"), count("rendered") + count("repeated")), (30, 30), "{report} {stderr}");
    assert!(count("rendered") > 0 && fs::read_dir(&out).unwrap().count() == 30);
    assert_eq!(report["sources"].as_array().unwrap().len(), 6);
    let said = |camera: &str, what: &str| {
        let source = source(&report, camera);
        let failure = source["failure"].as_str().unwrap_or("");
        assert!(source["restarts"].as_u64() >= Some(1) && failure.contains(what), "{source}");
    };
    said("cam1", "test://1: ended");
    said("cam2", "test://2: ffmpeg failed (exit status: 1): refused");
    assert_eq!(source(&report, "cam0")["failure"], Value::Null);
    let file = |name: &str| fs::read_to_string(Path::new(&measured).join(name)).unwrap();
    assert!(file("measure.md").contains("| source | cam1: "), "{}", file("measure.md"));
    assert_eq!(serde_json::from_str::<Value>(&file("measure.json")).unwrap()["frames"], 30);
    let lines: Vec<Value> = file("frames.jsonl").lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(lines.iter().enumerate().all(|(index, line)| line["frame"] == index), "in order");
}

#[test]
fn sources_without_a_frame_and_wrong_ones_are_refused() {
    let rig = Rig::new(2);
    let out = rig.folders.out("frames");
    let refused = |arguments: &[&str], words: &[&str]| {
        let mut video = rig.video(&["--path", "line:3", "-o", &out]);
        rig.folders.assert_refused(video.args(arguments), words);
    };
    refused(&["--source", "cam0"], &["--source", "expected the name of a camera and what to open"]);
    refused(&["--clock", "wall"], &["--clock", "expected arrival, stream or frame"]);
    let file = rig.path().join("transforms.json");
    let poses = fs::read_to_string(&file).unwrap();
    fs::write(&file, poses.replacen("{\"file_path\"", "{\"source\": 7, \"file_path\"", 1)).unwrap();
    refused(&[], &["transforms.json: frames[0]: source: expected an address or a file"]);
    fs::write(&file, poses).unwrap();
    let path = running(&rig, "case $camera in 3) echo refused >&2; exit 1;; esac");
    name_sources(&rig);
    let mut video = rig.video(&["--path", "line:3", "-o", &out]);
    let words = ["camera cam3: test://3: no frame within 15 s: test://3: ffmpeg failed (exit status: 1): refused"];
    rig.folders.assert_refused(video.env("PATH", &path), &words);
    let mut video =
        rig.video(&["--path", "line:3", "-o", &out, "--source", "cam3=test://1", "--source", "cam9=test://1"]);
    rig.folders.assert_refused(video.env("PATH", path), &["camera cam9 has a source but no pose"]);
}

#[test]
fn frames_are_matched_by_number_as_those_of_files() {
    let rig = Rig::new(4);
    let out = rig.folders.out("frames");
    let pictures = || -> Vec<Vec<u8>> {
        let read = |frame: usize| fs::read(Path::new(&out).join(format!("frame_{frame:06}.png"))).unwrap();
        (0..4).map(read).collect()
    };
    let arguments = ["--camera", "cam2", "-o", &out];
    rig.report(&arguments);
    let of_files = pictures();
    fs::remove_dir_all(&out).unwrap();
    rig.as_videos(&[4; 6]);
    let recorded = rig.folders.out("recorded");
    fs::create_dir(&recorded).unwrap();
    for camera in 0..6 {
        let name = format!("cam{camera}.mp4");
        fs::rename(rig.path().join(&name), Path::new(&recorded).join(&name)).unwrap();
    }
    let replay = |out: &str| {
        let mut video = rig.video(&["--camera", "cam2", "--clock", "frame", "-o", out]);
        for camera in 0..6 {
            video.arg("--source").arg(format!("cam{camera}={recorded}/cam{camera}.mp4"));
        }
        video.env("PATH", ffmpeg(&rig.folders, ""));
        video
    };
    let (report, _) = report(&mut replay(&out));
    let none = Value::Array(vec![]);
    assert_eq!((&report["rendered"], &report["faults"], &report["sources"]), (&4.into(), &none, &none));
    assert!(of_files == pictures());
    let refused = replay(&format!("{recorded}/cam0.mp4")).output().unwrap();
    assert!(stderr(&refused).contains("would overwrite --source"), "{}", stderr(&refused));
}

/// The processes that play the example rig's clips, ended with the test.
struct Senders(Vec<Option<Child>>);

impl Senders {
    fn stop(&mut self, camera: usize) {
        let mut sender = self.0[camera].take().unwrap();
        sender.kill().unwrap();
        sender.wait().unwrap();
    }
}

impl Drop for Senders {
    fn drop(&mut self) {
        self.0.iter_mut().flatten().for_each(|sender| drop(sender.kill().and_then(|()| sender.wait())));
    }
}

/// The cameras that stop, are late, and leave out frames.
const STOPS: usize = 1;
const LATE: usize = 2;
const DROPS: usize = 3;

fn example_rig() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/scenes/rig")
}

/// Plays a clip at 20 frames a second, again and again; time stamps are those of the system's clock since `start`, microseconds.
fn send(camera: usize, port: u16, start: u128) -> Child {
    // Well before the first frame: no time stamp is negative.
    let start = start - 10_000_000 + if camera == LATE { 300_000 } else { 0 };
    let select = if camera == DROPS { "select='mod(n+1,5)'," } else { "" };
    let filter = format!("{select}scale=252:176,setpts=(RTCSTART-{start})/1000000/TB+PTS-STARTPTS");
    let photos = example_rig().join(format!("cam0{camera}/%04d.jpg"));
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-nostdin", "-re", "-stream_loop", "-1", "-framerate", "20", "-i"]).arg(photos);
    ffmpeg.args(["-vf", &filter, "-fps_mode", "passthrough", "-c:v", "mpeg2video", "-q:v", "3", "-g", "1", "-bf", "0"]);
    ffmpeg
        .args(["-threads", "1", "-f", "mpegts"])
        .arg(address(camera, port) + if is_tcp(camera) { "?listen=1" } else { "" });
    ffmpeg.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

fn is_tcp(camera: usize) -> bool {
    camera == STOPS || camera == LATE
}

fn address(camera: usize, port: u16) -> String {
    format!("{}://127.0.0.1:{port}", if is_tcp(camera) { "tcp" } else { "udp" })
}

/// A port that is free.
fn free_port(camera: usize) -> u16 {
    let address = "127.0.0.1:0";
    let bound = if is_tcp(camera) {
        TcpListener::bind(address).and_then(|socket| socket.local_addr())
    } else {
        UdpSocket::bind(address).and_then(|socket| socket.local_addr())
    };
    bound.unwrap().port()
}

/// Whether any process has this in its arguments.
fn is_running(argument: &str) -> bool {
    let processes =
        fs::read_dir("/proc").unwrap().filter_map(|entry| fs::read(entry.ok()?.path().join("cmdline")).ok());
    processes.into_iter().any(|arguments| String::from_utf8_lossy(&arguments).contains(argument))
}

#[test]
fn cameras_that_stop_lag_and_drop_frames_are_played_and_reported() {
    let found = std::env::split_paths(&std::env::var_os("PATH").unwrap()).any(|folder| folder.join("ffmpeg").is_file());
    if !found {
        eprintln!("skipped: ffmpeg is not on the PATH");
        return;
    }
    ["stream", "arrival"].iter().for_each(|clock| play_clips(clock));
}

fn play_clips(clock: &str) {
    let start = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_micros();
    let ports: Vec<u16> = (0..5).map(free_port).collect();
    let mut senders = Senders((0..5).map(|camera| Some(send(camera, ports[camera], start))).collect());
    let root = tempfile::tempdir().unwrap();
    let (out, log) = (root.path().join("frames"), root.path().join("log.jsonl"));
    let mut video = Command::new(env!("CARGO_BIN_EXE_liveview"));
    video.arg("video").arg(example_rig()).args(["--camera", "target", "--network", "none", "--clock", clock]);
    for (camera, &port) in ports.iter().enumerate() {
        video.arg("--source").arg(format!("cam0{camera}={}", address(camera, port)));
    }
    video.args([
        "--fps",
        "20",
        "--latency",
        "1s",
        "--frames",
        ":140",
        "--width",
        "126",
        "--layers",
        "planes:4",
        "--json",
    ]);
    let mut video = video
        .args([&"-o", &out.to_str().unwrap(), &"--log", &log.to_str().unwrap()])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    wait_until(&mut video, || out.join("frame_000010.png").exists());
    senders.stop(STOPS);
    sleep(Duration::from_secs(2));
    senders.0[STOPS] = Some(send(STOPS, ports[STOPS], start));
    let output = video.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let number = |value: &Value| value.as_u64().unwrap();
    let counts = ["rendered", "repeated", "frames"].map(|name| number(&report[name]));
    assert!(counts[0] >= 20 && counts[0] + counts[1] == 140 && counts[2] == 140, "{report}");
    let log = fs::read_to_string(&log).unwrap();
    let lines = log.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    assert!(lines.enumerate().all(|(index, line)| line["frame"] == index), "in order");
    assert_eq!(fs::read_dir(&out).unwrap().count(), 140);
    let source = |camera: usize| source(&report, &format!("cam0{camera}"));
    let stopped = source(STOPS);
    assert!(number(&stopped["longest_gap_ms"]) >= 1800 && number(&stopped["restarts"]) >= 1, "{stopped}");
    assert!(stopped["failure"].as_str().unwrap().contains("tcp://127.0.0.1:"), "{stopped}");
    let fault = report["faults"].as_array().unwrap().iter().find(|fault| fault["camera"] == "cam01").unwrap();
    assert!(number(&fault["not_delivered"]) >= 10 && fault["first"].as_str().unwrap().contains("was late"), "{fault}");
    let dropping = source(DROPS);
    let missing = number(&dropping["missing"]) as f64 / number(&dropping["frames"]) as f64;
    assert!((0.15..0.4).contains(&missing), "every fifth: {dropping}");
    if clock == "stream" {
        let late = number(&source(LATE)["late_ms"]);
        assert!((150..=600).contains(&late), "{report}");
        assert!(number(&source(0)["late_ms"]) < late, "{report}");
    }
    drop(senders);
    for (camera, &port) in ports.iter().enumerate() {
        assert!(!is_running(&address(camera, port)), "{}", address(camera, port));
        let again = format!("127.0.0.1:{port}");
        assert!(is_tcp(camera) || UdpSocket::bind(again).is_ok());
    }
}
