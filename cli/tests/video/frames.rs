//! `liveview video` on a tiny rig: its frames, its report, and cameras that fail.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::common::rig::{Rig, ffmpeg};
use crate::common::{HEIGHT, WIDTH, photo};

fn lines(path: &str) -> Vec<Value> {
    fs::read_to_string(path).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn held_out_camera_is_rendered_and_scored() {
    let rig = Rig::new(4);
    let (out, log) = (rig.folders.out("frames"), rig.folders.out("log.jsonl"));
    let report = rig.report(&["--camera", "cam2", "--layers", "guided:1", "-o", &out, "--log", &log]);
    let names: Vec<String> = (0..4).map(|frame| format!("frames/frame_{frame:06}.png")).collect();
    assert_eq!(rig.folders.written(), [names, vec!["log.jsonl".to_owned()]].concat());
    assert_eq!((report["rendered"].as_u64(), report["repeated"].as_u64()), (Some(4), Some(0)));
    assert_eq!(report["layers_from"], serde_json::json!({ "searched": 1, "propagated": 3 }));
    assert!(report["mean"]["psnr"].as_f64().unwrap() > 15.0, "{report}");
    assert!(report["mean"]["flicker"].as_f64().unwrap() < 1e-3, "nothing moves: {report}");
    let lines = lines(&log);
    assert_eq!(lines.len(), 4);
    let views = lines[0]["views"].as_array().unwrap();
    assert!(views.len() == 4 && !views.contains(&Value::from(2)), "held out: {views:?}");
}

#[test]
fn paths_poses_and_ranges_choose_the_frames() {
    let rig = Rig::new(5);
    let out = rig.folders.out("frames");
    let report = rig.report(&["--path", "line:3", "--policy", "once", "--frames", "1:", "-o", &out]);
    assert_eq!((report["rendered"].as_u64(), &report["mean"]["psnr"]), (Some(4), &Value::Null));
    assert_eq!(report["layers_from"], serde_json::json!({ "searched": 1, "propagated": 3 }));
    let poses = rig.folders.out("poses.json");
    fs::write(&poses, r#"[{"cam_from_world": [[1, 0, 0, -0.25], [0, -1, 0, 0], [0, 0, -1, 0]]}]"#).unwrap();
    let report = rig.report(&["--poses", &poses, "--layers", "select:16/64", "--frames", ":2", "-o", &out]);
    assert_eq!(report["layers_from"], serde_json::json!({ "dense": 1, "selected": 1 }));
    assert_eq!((&report["layers"], &report["policy"]), (&"select:16/64".into(), &"once".into()));
}

#[test]
fn policy_decides_which_frames_search_their_layers() {
    let rig = Rig::new(3);
    let out = rig.folders.out("frames");
    for (layers, policy, default, from) in [
        ("guided:2", "propagate", true, serde_json::json!({ "searched": 1, "propagated": 2 })),
        ("guided:2", "each", false, serde_json::json!({ "searched": 3 })),
        ("guided:2/32", "once", false, serde_json::json!({ "searched": 1, "propagated": 2 })),
        ("surface:1", "propagate", true, serde_json::json!({ "searched": 1, "propagated": 2 })),
        ("surface:2", "each", false, serde_json::json!({ "searched": 3 })),
        ("surface:1", "once", false, serde_json::json!({ "searched": 1, "propagated": 2 })),
        ("select:2/8", "each", false, serde_json::json!({ "dense": 3 })),
        ("planes:3", "once", true, serde_json::json!({ "fixed": 3 })),
        ("list:0.4,0.2", "once", true, serde_json::json!({ "fixed": 3 })),
    ] {
        let given: &[&str] = if default { &[] } else { &["--policy", policy] };
        let report = rig.report(&[&["--camera", "cam2", "--layers", layers, "-o", &out], given].concat());
        assert_eq!(report["layers_from"], from, "{layers}, {policy}");
        assert_eq!((&report["layers"], &report["policy"]), (&layers.into(), &policy.into()));
    }
    let mut recommended = rig.folders.liveview("video", &["--camera", "cam2", "-o", &out, "--json"]);
    let output = recommended.args(["--model", &rig.folders.recommending("planes:3")]).output().unwrap();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["layers_from"], serde_json::json!({ "fixed": 3 }), "as the model recommends");
}

#[test]
fn surface_layers_skip_a_missing_photo_and_search_where_photos_change() {
    let rig = Rig::new(4);
    fs::remove_file(rig.frame(3, 1)).unwrap();
    let (out, log) = (rig.folders.out("frames"), rig.folders.out("log.jsonl"));
    let arguments = ["--camera", "cam2", "--layers", "surface:1", "-o", &out, "--log", &log];
    let with = rig.report(&arguments);
    // Another camera stands in for the one that has no second frame: its depth is searched.
    let expected = serde_json::json!({ "searched": 1, "refreshed": 1, "propagated": 2 });
    assert_eq!(with["layers_from"], expected, "{with}");
    let views = |frame: usize| lines(&log)[frame]["views"].as_array().unwrap().contains(&Value::from(3));
    assert!(views(0) && !views(1) && views(2));
    // The wall moves, in all photos.
    (0..6).for_each(|camera| rig.film(camera, 3, 0.5));
    let moved = rig.report(&arguments);
    assert_eq!(moved["layers_from"]["propagated"], 1, "{moved}");
    // Surface layers without a network are the default.
    let mut without = rig.folders.liveview("video", &["--camera", "cam2", "-o", &out, "--json"]);
    let output = without.output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let without: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&without["layers"], &without["policy"]), (&"surface:1".into(), &"propagate".into()));
    assert!(without["mean"]["psnr"].as_f64().unwrap() > 20.0, "{without}");
}

#[test]
fn y4m_goes_to_stdout_and_the_summary_to_stderr() {
    let rig = Rig::new(3);
    let output = rig.video(&["--camera", "cam2", "-o", "-"]).output().unwrap();
    let (width, height) = (WIDTH as usize, HEIGHT as usize);
    let header = format!("YUV4MPEG2 W{width} H{height} F30:1 Ip A1:1 C444 XCOLORRANGE=LIMITED\n");
    assert!(output.stdout.starts_with(header.as_bytes()));
    assert_eq!(output.stdout.len(), header.len() + 3 * (6 + 3 * width * height));
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(stderr.contains("3 rendered") && stderr.contains("PSNR"), "{stderr}");
}

#[test]
fn failing_cameras_are_left_out_and_named() {
    let rig = Rig::new(6);
    fs::write(rig.frame(1, 2), "no picture").unwrap();
    fs::remove_file(rig.frame(3, 1)).unwrap();
    photo(&rig.frame(0, 3), 0.0, 32, 24);
    [4, 5].into_iter().for_each(|frame| fs::remove_file(rig.frame(5, frame)).unwrap());
    let (out, log) = (rig.folders.out("frames"), rig.folders.out("log.jsonl"));
    let report = rig.report(&["--camera", "cam2", "-o", &out, "--log", &log]);
    assert_eq!((report["rendered"].as_u64(), report["repeated"].as_u64()), (Some(6), Some(0)), "{report}");
    let fault = |camera: &str| {
        let faults = report["faults"].as_array().unwrap();
        faults.iter().find(|fault| fault["camera"] == camera).unwrap()["first"].as_str().unwrap()
    };
    assert!(fault("cam1").contains("002.png"), "{report}");
    assert_eq!(fault("cam3"), "frame 1 is missing");
    assert_eq!(fault("cam0"), "frame 3 is 32x24, not the size of the others");
    assert_eq!(fault("cam5"), "no frames from 4 on");
    let views = |frame: usize| lines(&log)[frame]["views"].as_array().unwrap().clone();
    assert!(!views(2).contains(&Value::from(1)) && views(3).contains(&Value::from(1)));
}

#[test]
fn too_few_cameras_repeat_the_last_frame() {
    let rig = Rig::new(3);
    [0, 1].into_iter().for_each(|camera| fs::remove_file(rig.frame(camera, 1)).unwrap());
    let out = rig.folders.out("frames");
    let report = rig.report(&["--camera", "cam2", "-o", &out]);
    assert_eq!((report["rendered"].as_u64(), report["repeated"].as_u64()), (Some(2), Some(1)));
    let frame = |index: usize| fs::read(Path::new(&out).join(format!("frame_{index:06}.png"))).unwrap();
    assert_eq!(frame(0), frame(1));
}

#[test]
fn live_frames_keep_the_rate_and_late_ones_are_dropped() {
    let rig = Rig::new(12);
    let out = rig.folders.out("frames");
    let started = Instant::now();
    let report = rig.report(&["--camera", "cam2", "--fps", "20", "--latency", "5s", "-o", &out]);
    assert!(started.elapsed() > Duration::from_millis(11 * 50), "frames are due at their times");
    assert_eq!((report["rendered"].as_u64(), report["dropped"].as_u64()), (Some(12), Some(0)), "{report}");
    assert!(report["latency_ms"]["median"].as_u64().is_some() && report["mean"]["psnr"].is_null());
    // Too fast for any machine: the level falls and frames are dropped, and the video keeps its
    // length.
    let mut video =
        rig.video(&["--camera", "cam2", "--fps", "256", "--latency", "30ms", "--layers", "planes:512", "-o", &out]);
    let output = video.arg("--json").output().unwrap();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(report["dropped"].as_u64().unwrap() > 0, "{report}");
    let sum = ["rendered", "repeated"].map(|key| report[key].as_u64().unwrap()).iter().sum::<u64>();
    assert_eq!(report["frames"].as_u64(), Some(sum), "{report}");
}

#[test]
fn invalid_options_and_rigs_are_refused() {
    let rig = Rig::new(1);
    let folders = &rig.folders;
    let out = folders.out("frames");
    let refused = |arguments: &[&str], words: &[&str]| folders.assert_refused(&mut rig.video(arguments), words);
    refused(&["--camera", "cam9", "-o", &out], &["cam9", "no view is named"]);
    refused(&["--camera", "cam2", "-o", &folders.out("a.webm")], &["-o", "a.webm", ".mp4"]);
    let inside = rig.path().join("cam0");
    refused(&["--camera", "cam2", "-o", inside.to_str().unwrap()], &["-o", "the rig's own folder"]);
    refused(&["--camera", "cam2", "-o", &out, "--layers", "planes:0"], &["--layers", "a whole number from 1 to 4096"]);
    refused(&["--camera", "cam2", "-o", &out, "--policy", "paper"], &["--policy", "propagate, each or once"]);
    refused(
        &["--camera", "cam2", "-o", &out, "--layers", "planes:4", "--policy", "propagate"],
        &["--policy propagate", "each or once for planes:4"],
    );
    let mut no_ffmpeg = rig.video(&["--camera", "cam2", "-o", &folders.out("a.mp4")]);
    folders.assert_refused(no_ffmpeg.env("PATH", "/nowhere"), &["a.mp4", "ffmpeg"]);
    rig.write_poses(3);
    refused(&["--camera", "cam2", "-o", &out], &["4 views are needed", "only 2 of 2"]);
    fs::remove_file(rig.path().join("transforms.json")).unwrap();
    refused(&["--camera", "cam2", "-o", &out], &["no poses found", "poses_bounds.npy"]);
    (0..6).for_each(|camera| fs::remove_dir_all(rig.path().join(format!("cam{camera}"))).unwrap());
    refused(&["--camera", "cam2", "-o", &out], &["no rig found"]);
}

#[cfg(unix)]
#[test]
fn video_files_with_poses_bounds_are_a_rig() {
    let rig = Rig::new(3);
    rig.as_videos(&[3; 6]);
    let cut = rig.path().join("cam4.mp4");
    let video = fs::read(&cut).unwrap();
    fs::write(&cut, &video[..video.len() - 100]).unwrap();
    let mut poses = Vec::new();
    for camera in 0..6 {
        // Columns down, right, backwards, centre, and (height, width, focal length); then near and
        // far.
        let x = 0.1 * f64::from(camera as u8);
        poses.extend([0.0, 1.0, 0.0, x, 48.0, 1.0, 0.0, 0.0, 0.0, 64.0, 0.0, 0.0, -1.0, 0.0, 60.0, 2.0, 8.0]);
    }
    let poses = ndarray::Array2::from_shape_vec((6, 17), poses).unwrap();
    fs::write(rig.path().join("poses_bounds.npy"), liveview_files::npy::bytes(&poses)).unwrap();
    fs::remove_file(rig.path().join("transforms.json")).unwrap();
    let path = ffmpeg(&rig.folders, "");
    let film = rig.folders.out("a.mp4");
    let output = rig.video(&["--camera", "cam2", "-o", &film, "--json"]).env("PATH", &path).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["rendered"], 3, "{report}");
    assert!(report["mean"]["psnr"].as_f64().unwrap() > 15.0, "{report}");
    let fault = &report["faults"][0];
    assert!(fault["camera"] == "cam4" && fault["first"].as_str().unwrap().contains("cam4.mp4"), "{report}");
    assert_eq!(fs::metadata(&film).unwrap().len(), u64::from(3 * 3 * WIDTH * HEIGHT));
    let mut cut = rig.video(&["--camera", "cam2", "-o", &rig.folders.out("b.mp4")]);
    let output = cut.env("PATH", "/nowhere").output().unwrap();
    assert_eq!(output.status.code(), Some(2));
}

#[cfg(unix)]
#[test]
fn stalled_live_camera_is_left_out() {
    let rig = Rig::new(12);
    rig.as_videos(&[12; 6]);
    // The camera next to the viewpoint delivers four frames, then stalls.
    let bytes = 4 * (13 + 3 * WIDTH * HEIGHT);
    let path = ffmpeg(
        &rig.folders,
        &format!("case \"$all\" in *cam1.mp4*ppm*) /usr/bin/head -c {bytes} \"$2\"; exec /bin/sleep 60;; esac"),
    );
    let (out, log) = (rig.folders.out("frames"), rig.folders.out("log.jsonl"));
    let mut video =
        rig.video(&["--camera", "cam2", "--fps", "10", "--latency", "2s", "-o", &out, "--log", &log, "--json"]);
    let output = video.env("PATH", &path).timeout(Duration::from_secs(50)).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let faults = report["faults"].as_array().unwrap();
    assert!(faults.len() == 1 && faults[0]["camera"] == "cam1" && faults[0]["first"] == "frame 4 was late", "{report}");
    let seen = |line: &Value| line["views"].as_array().is_some_and(|views| views.contains(&Value::from(1)));
    let with: Vec<u64> =
        lines(&log).iter().filter(|line| seen(line)).map(|line| line["frame"].as_u64().unwrap()).collect();
    assert!(with.iter().all(|&frame| frame < 4) && report["rendered"].as_u64() > Some(with.len() as u64), "{report}");
}

#[test]
fn memory_does_not_grow_with_the_length() {
    let rig = Rig::new(300);
    let (out, log) = (rig.folders.out("frames"), rig.folders.out("log.json"));
    for options in [&[][..], &["--layers", "surface:1", "--policy", "each", "--frames", ":150"]] {
        rig.report(&[&["--camera", "cam2", "-o", &out, "--log", &log], options].concat());
        let memory: Vec<f64> = lines(&log).iter().map(|line| line["memory_bytes"].as_f64().unwrap()).collect();
        let quarter = memory.len() / 4;
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        let (early, late) = (mean(&memory[quarter..2 * quarter]), mean(&memory[3 * quarter..]));
        assert!(late < early + 4e6, "{options:?}: {early} to {late} bytes");
    }
}
