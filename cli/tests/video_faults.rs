//! What goes wrong around a video: cameras that stall, end, go or do not match; programs that hang; signals. What is written is whole,
//! and what was left out is told.
#![cfg(target_os = "linux")]

mod common;

use std::fs;
use std::os::unix::fs::symlink;
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

use assert_cmd::Command;
use common::rig::{Rig, ffmpeg};
use common::{HEIGHT, WIDTH, fixture, photo};
use liveview::fs::atomic::TEMPORARY;
use serde_json::Value;

/// Bytes of a frame as it goes to ffmpeg.
const FRAME: u64 = 3 * WIDTH as u64 * HEIGHT as u64;

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Its report, once it has succeeded, and what else it said.
fn told(command: &mut Command) -> (Value, String) {
    let output = command.arg("--json").output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    (serde_json::from_slice(&output.stdout).unwrap(), said(&output))
}

/// The program, started; to be sent signals.
fn start(rig: &Rig, command: &str, model: &str, path: &str, arguments: &[&str]) -> Child {
    let mut started = std::process::Command::new(env!("CARGO_BIN_EXE_liveview"));
    started.arg(command).arg(rig.path()).args(arguments).args(["--json", "--model", &fixture(model)]).env("PATH", path);
    started.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Sends a signal once `is_ready`, and waits for the end.
fn signalled(child: Child, signal: &str, is_ready: impl Fn() -> bool) -> Output {
    while !is_ready() {
        std::thread::sleep(Duration::from_millis(20));
    }
    Command::new("/bin/kill").args([signal, &child.id().to_string()]).assert().success();
    child.wait_with_output().unwrap()
}

/// Processor time that a process has taken, in hundredths of a second.
fn ticks(process: u32) -> u64 {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
    stat.rsplit_once(") ").unwrap().1.split(' ').nth(11).unwrap().parse().unwrap()
}

/// Whether ffmpeg has been given a frame or more.
fn is_begun(rig: &Rig) -> bool {
    let written = rig.folders.written();
    written.iter().any(|name| fs::metadata(rig.folders.out(name)).is_ok_and(|file| file.len() >= FRAME))
}

/// A video of as many frames as it says, and nothing beside it.
fn assert_whole(rig: &Rig, output: &Output) {
    assert_eq!(output.status.code(), Some(0), "{}", said(output));
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(told["stopped"] == true, "{told}");
    assert_eq!(rig.folders.written(), ["a.mp4"]);
    assert_eq!(fs::metadata(rig.folders.out("a.mp4")).unwrap().len(), told["frames"].as_u64().unwrap() * FRAME);
}

#[test]
fn every_signal_that_asks_for_the_end_leaves_a_whole_video() {
    let rig = Rig::new(100);
    let (film, path) = (rig.folders.out("a.mp4"), ffmpeg(&rig.folders, ""));
    for signal in ["-TERM", "-HUP", "-INT"] {
        let live = ["--camera", "cam2", "--fps", "5", "--latency", "1s", "-o", &film];
        let video = start(&rig, "video", "tiny_v4", &path, &live);
        assert_whole(&rig, &signalled(video, signal, || is_begun(&rig)));
        fs::remove_file(&film).unwrap();
    }
}

#[test]
fn a_camera_that_stalls_for_ever_keeps_nothing_going() {
    let rig = Rig::new(8);
    fs::remove_file(rig.frame(1, 5)).unwrap();
    Command::new("mkfifo").arg(rig.frame(1, 5)).assert().success();
    let (film, path) = (rig.folders.out("a.mp4"), ffmpeg(&rig.folders, ""));
    let mut live = rig.video(&["--camera", "cam2", "--fps", "10", "--latency", "1s", "-o", &film]);
    let (told, _) = told(live.env("PATH", &path).timeout(Duration::from_secs(60)));
    let fault = &told["faults"][0];
    assert!(fault["camera"] == "cam1" && fault["not_delivered"] == 3, "{told}");
    fs::remove_file(&film).unwrap();
    // Without a clock it is waited for, until the one Ctrl-C.
    let video = start(&rig, "video", "tiny_v4", &path, &["--camera", "cam2", "-o", &film]);
    assert_whole(&rig, &signalled(video, "-INT", || is_begun(&rig)));
}

#[test]
fn steps_are_the_frames_there_are() {
    let rig = Rig::new(4);
    let rename = |name: &dyn Fn(usize, usize) -> String| {
        for camera in 0..6 {
            let mut frames: Vec<_> = fs::read_dir(rig.frame(camera, 0).parent().unwrap()).unwrap().collect();
            frames.sort_by_key(|entry| entry.as_ref().unwrap().path());
            for (frame, entry) in frames.into_iter().enumerate() {
                let path = entry.unwrap().path();
                fs::rename(&path, path.with_file_name(name(camera, frame))).unwrap();
            }
        }
    };
    let out = rig.folders.out("frames");
    let arguments = ["--camera", "cam2", "-o", &out];
    for (name, words) in [
        (
            &(|_: usize, frame: usize| format!("t{}.png", 1_000_000 + 33_333 * frame))
                as &dyn Fn(usize, usize) -> String,
            "",
        ),
        (
            &|camera: usize, frame: usize| format!("{}.png", 1_000_000 + 33_333 * frame + 7 * camera),
            "matched by these as times",
        ),
        (
            &|_, frame| format!("{:08}.png", [0, 1, 2, 99_999_999][frame]),
            "no camera has a frame between 2 and 99999999",
        ),
    ] {
        rename(name);
        let (told, said) = told(&mut rig.video(&arguments));
        assert_eq!(
            (told["rendered"].as_u64(), told["frames"].as_u64(), &told["faults"]),
            (Some(4), Some(4), &serde_json::json!([]))
        );
        assert!(said.contains(words), "{said}");
        assert_eq!(fs::read_dir(&out).unwrap().count(), 4);
        fs::remove_dir_all(&out).unwrap();
    }
    rename(&|_: usize, frame: usize| format!("{}.png", ["0", "1", "2", "18446744073709551615"][frame]));
    rig.folders.assert_refused(&mut rig.video(&arguments), &["18446744073709551615.png", "the number in its name"]);
}

#[test]
fn cameras_of_different_frame_rates_are_matched_by_time() {
    let rig = Rig::new(0);
    for frame in 0..12 {
        (0..6).for_each(|camera| rig.film(camera, frame, 0.1 * frame as f64 * if camera == 1 { 2.0 } else { 1.0 }));
    }
    (6..12).for_each(|frame| fs::remove_file(rig.frame(1, frame)).unwrap());
    rig.as_videos(&[12, 6, 12, 12, 12, 12]);
    let path = ffmpeg(
        &rig.folders,
        r#"case "$all" in
*cam1.mp4*yuv4mpegpipe*) echo YUV4MPEG2 F15:1; exit;;
*cam1.mp4*) ;;
*fps=15*) for frame in 0 2 4 6 8 10; do /bin/dd if="$2" bs=9229 skip=$frame count=1 2> /dev/null; done; exit;;
esac"#,
    );
    let out = rig.folders.out("frames");
    let (told, said) = told(rig.video(&["--camera", "cam2", "--layers", "planes:8", "-o", &out]).env("PATH", path));
    assert!(said.contains("different frame rates (cam0 30, cam1 15, cam2 30"), "{said}");
    assert!(said.contains("matched by time, 15 steps per second"), "{said}");
    assert_eq!((told["rendered"].as_u64(), &told["faults"]), (Some(6), &serde_json::json!([])), "{told}");
    assert!(told["mean"]["psnr"].as_f64().unwrap() > 20.0, "{told}");
}

#[test]
fn why_cameras_cannot_be_read_is_told() {
    let rig = Rig::new(2);
    rig.as_videos(&[2; 6]);
    let out = rig.folders.out("a.mp4");
    let frames = rig.folders.out("frames");
    let mut video = rig.video(&["--camera", "cam2", "-o", &frames]);
    let unread = ["0 of 6 cameras can be read", "cam0.mp4: videos are read by ffmpeg, which is not on the PATH"];
    rig.folders.assert_refused(video.env("PATH", "/nowhere"), &unread);
    let broken = ffmpeg(&rig.folders, "echo moov atom not found >&2; exit 1");
    let mut video = rig.video(&["--camera", "cam2", "-o", &frames]);
    let words = ["cam5.mp4: ffmpeg failed (exit status: 1): moov atom not found"];
    rig.folders.assert_refused(video.env("PATH", broken), &words);
    // Video of 10 bits becomes pixmaps of 16, unless others are asked for.
    let deep =
        r#"case "$all" in *image2pipe*) case "$all" in *"-pix_fmt rgb24"*) ;; *) echo "P6 64 48 65535";; esac;; esac"#;
    let path = ffmpeg(&rig.folders, deep);
    told(rig.video(&["--camera", "cam2", "-o", &frames]).env("PATH", &path));
    // In a folder that could be a protocol, and into one.
    let root = rig.path().parent().unwrap().to_owned();
    symlink(rig.path(), root.join("a:b")).unwrap();
    let mut video = Command::new(env!("CARGO_BIN_EXE_liveview"));
    video.current_dir(&root).env("PATH", &path).args(["video", "a:b", "--camera", "cam2", "-o", "c:d/a.mp4"]);
    told(video.args(["--model", &fixture("tiny_v4")]));
    assert_eq!(fs::metadata(root.join("c:d/a.mp4")).unwrap().len(), 2 * FRAME);
    // Gone after opening: no frame, no file.
    let path = ffmpeg(&rig.folders, r#"case "$all" in *yuv4*) /bin/rm "$2"; echo YUV4MPEG2 F30:1; exit;; esac"#);
    fs::remove_dir_all(&frames).unwrap();
    let mut video = rig.video(&["--camera", "cam2", "-o", &out]);
    rig.folders.assert_refused(
        video.env("PATH", path),
        &["no frame could be rendered", "cam1.mp4: ffmpeg failed", "No such file"],
    );
}

#[test]
fn frames_that_are_not_delivered_are_counted_and_no_video_is_no_success() {
    let rig = Rig::new(12);
    (3..12).for_each(|frame| fs::remove_file(rig.frame(1, frame)).unwrap());
    let out = rig.folders.out("frames");
    let (told, _) = told(&mut rig.video(&["--camera", "cam2", "-o", &out]));
    let expected = serde_json::json!([{ "camera": "cam1", "not_delivered": 9, "first": "no frames from 3 on" }]);
    assert_eq!(told["faults"], expected);
    fs::remove_dir_all(&out).unwrap();
    let refused = |arguments: &[&str], words: &[&str]| {
        rig.folders.assert_refused(&mut rig.video(&[&["--camera", "cam2", "-o", &out], arguments].concat()), words);
    };
    refused(&["--frames", "100.."], &["--frames 100..", "12 time steps"]);
    refused(&["--fps", "0"], &["--fps", "30000/1001"]);
    // Too few cameras at every step that is asked for.
    (0..6).for_each(|camera| (9..11).for_each(|frame| fs::write(rig.frame(camera, frame), "").unwrap()));
    refused(&["--frames", "9..11"], &["no frame could be rendered", "cam0: ", "009.png"]);
}

#[test]
fn rates_exposure_and_the_model_for_planes() {
    let rig = Rig::new(2);
    for (rate, header) in [("29.97", "F2997:100 "), ("30000/1001", "F30000:1001 ")] {
        let output = rig.video(&["--camera", "cam2", "--fps", rate, "-o", "-"]).output().unwrap();
        assert!(String::from_utf8_lossy(&output.stdout[..80]).contains(header), "{}", said(&output));
    }
    // Photos large enough for their exposures to be compared.
    let poses = rig.path().join("transforms.json");
    let text = fs::read_to_string(&poses).unwrap();
    let size = (r#""cx": 32, "cy": 24, "w": 64, "h": 48"#, r#""cx": 96, "cy": 72, "w": 192, "h": 144"#);
    fs::write(&poses, text.replace(size.0, size.1)).unwrap();
    for camera in 0..6 {
        let frame = rig.frame(camera, 0);
        fs::remove_file(rig.frame(camera, 1)).unwrap();
        photo(&frame, 0.1 * camera as f64, 192, 144);
        let mut picture = image::open(&frame).unwrap().into_rgb8();
        let exposure = if camera == 1 { 0.6 } else { 1.0 };
        picture.iter_mut().for_each(|value| *value = (f32::from(*value) * exposure) as u8);
        picture.save(&frame).unwrap();
    }
    let out = rig.folders.out("frames");
    let psnr = |more: &[&str]| {
        let arguments = [&["--camera", "cam2", "--layers", "surface:1", "-o", &out], more].concat();
        told(&mut rig.video(&arguments)).0["mean"]["psnr"].as_f64().unwrap()
    };
    let (balanced, kept) = (psnr(&[]), psnr(&["--keep-exposure"]));
    assert!((balanced - kept).abs() > 0.1, "{balanced} {kept}");

    let models = rig.folders.scene().join("models");
    fs::create_dir(&models).unwrap();
    for of in ["", "_planes"] {
        fs::copy(fixture("tiny_v4"), models.join(format!("liveview_v4{of}.onnx"))).unwrap();
    }
    for (layers, file) in [("planes:3", "liveview_v4_planes.onnx"), ("guided:1", "liveview_v4.onnx")] {
        let mut video = rig.folders.liveview("video", &["--camera", "cam2", "--layers", layers, "-o", &out]);
        let (told, _) = told(video.env("LIVEVIEW_MODELS", &models));
        assert!(told["model"]["file"].as_str().unwrap().ends_with(file), "{told}");
    }
}

#[test]
fn what_hangs_ends_after_one_interrupt() {
    let rig = Rig::new(30);
    let (film, frames) = (rig.folders.out("a.mp4"), rig.folders.out("frames"));
    let hanging = ffmpeg(&rig.folders, "[ \"$last\" = - ] || exec /bin/sleep 600");
    let started = Instant::now();
    let video = ["--camera", "cam2", "-o"];
    let encoder = start(&rig, "video", "tiny_v4", &hanging, &[&video[..], &[&film]].concat());
    let model = start(&rig, "video", "endless_v4", "", &[&video[..], &[&frames]].concat());
    // All that it does before takes far less.
    let process = model.id();
    let model = std::thread::spawn(move || signalled(model, "-TERM", || ticks(process) > 300));
    let encoder = signalled(encoder, "-INT", || !rig.folders.written().is_empty());
    let model = model.join().unwrap();
    assert!(started.elapsed() < Duration::from_secs(120));
    assert_eq!(
        (encoder.status.code(), model.status.code()),
        (Some(2), Some(130)),
        "{}",
        said(&encoder) + &said(&model)
    );
    assert!(said(&encoder).contains("a.mp4: ffmpeg did nothing for too long, and was ended"), "{}", said(&encoder));
    assert!(
        said(&model).contains("note: frame 0 was given up") && said(&model).ends_with("error: interrupted\n"),
        "{}",
        said(&model)
    );
    assert!(!rig.folders.written().iter().any(|name| name.contains(TEMPORARY)), "{:?}", rig.folders.written());
}
