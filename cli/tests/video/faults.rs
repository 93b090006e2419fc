//! Cameras of a video that end early, differ in their frame times, or cannot be read: what is left
//! out is reported, with the reason.
#![cfg(target_os = "linux")]

use std::fs;
use std::os::unix::fs::symlink;

use assert_cmd::Command;

use crate::common::rig::{Rig, ffmpeg, report, stderr};
use crate::common::{HEIGHT, WIDTH, fixture, photo};

/// Bytes of a frame written to ffmpeg.
const FRAME: u64 = 3 * WIDTH as u64 * HEIGHT as u64;

#[test]
fn frames_are_matched_by_number_or_by_time() {
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
            "the numbers are taken as times",
        ),
        (
            &|_, frame| format!("{:08}.png", [0, 1, 2, 99_999_999][frame]),
            "no camera has a frame between 2 and 99999999",
        ),
    ] {
        rename(name);
        let (report, stderr) = report(&mut rig.video(&arguments));
        assert_eq!(
            (report["rendered"].as_u64(), report["frames"].as_u64(), &report["faults"]),
            (Some(4), Some(4), &serde_json::json!([]))
        );
        assert!(stderr.contains(words), "{stderr}");
        assert_eq!(fs::read_dir(&out).unwrap().count(), 4);
        fs::remove_dir_all(&out).unwrap();
    }
    rename(&|_: usize, frame: usize| format!("{}.png", ["0", "1", "2", "18446744073709551615"][frame]));
    rig.folders.assert_refused(&mut rig.video(&arguments), &["18446744073709551615.png", "the number in its name"]);
}

#[test]
fn different_frame_rates_are_matched_by_time() {
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
    let (report, stderr) =
        report(rig.video(&["--camera", "cam2", "--layers", "planes:8", "-o", &out]).env("PATH", path));
    assert!(stderr.contains("different frame rates (cam0 30, cam1 15, cam2 30"), "{stderr}");
    assert!(stderr.contains("matched by time, 15 steps per second"), "{stderr}");
    assert_eq!((report["rendered"].as_u64(), &report["faults"]), (Some(6), &serde_json::json!([])), "{report}");
    assert!(report["mean"]["psnr"].as_f64().unwrap() > 20.0, "{report}");
}

#[test]
fn unreadable_cameras_are_refused_with_the_reason() {
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
    // ffmpeg decodes a 10-bit video to 16-bit pixmaps unless rgb24 is requested.
    let deep =
        r#"case "$all" in *image2pipe*) case "$all" in *"-pix_fmt rgb24"*) ;; *) echo "P6 64 48 65535";; esac;; esac"#;
    let path = ffmpeg(&rig.folders, deep);
    report(rig.video(&["--camera", "cam2", "-o", &frames]).env("PATH", &path));
    // Folder names that look like protocols.
    let root = rig.path().parent().unwrap().to_owned();
    symlink(rig.path(), root.join("a:b")).unwrap();
    let mut video = Command::new(env!("CARGO_BIN_EXE_liveview"));
    video.current_dir(&root).env("PATH", &path).args(["video", "a:b", "--camera", "cam2", "-o", "c:d/a.mp4"]);
    report(video.args(["--model", &fixture("tiny_v4")]));
    assert_eq!(fs::metadata(root.join("c:d/a.mp4")).unwrap().len(), 2 * FRAME);
    // Deleted after opening: no frame, no file.
    let path = ffmpeg(&rig.folders, r#"case "$all" in *yuv4*) /bin/rm "$2"; echo YUV4MPEG2 F30:1; exit;; esac"#);
    fs::remove_dir_all(&frames).unwrap();
    let mut video = rig.video(&["--camera", "cam2", "-o", &out]);
    rig.folders.assert_refused(
        video.env("PATH", path),
        &["no frame could be rendered", "cam1.mp4: ffmpeg failed", "No such file"],
    );
}

#[test]
fn missing_frames_are_counted_and_an_empty_video_is_an_error() {
    let rig = Rig::new(12);
    (3..12).for_each(|frame| fs::remove_file(rig.frame(1, frame)).unwrap());
    let out = rig.folders.out("frames");
    let (report, _) = report(&mut rig.video(&["--camera", "cam2", "-o", &out]));
    let expected = serde_json::json!([{ "camera": "cam1", "not_delivered": 9, "first": "no frames from 3 on" }]);
    assert_eq!(report["faults"], expected);
    fs::remove_dir_all(&out).unwrap();
    let refused = |arguments: &[&str], words: &[&str]| {
        rig.folders.assert_refused(&mut rig.video(&[&["--camera", "cam2", "-o", &out], arguments].concat()), words);
    };
    refused(&["--frames", "100:"], &["--frames 100:", "12 time steps"]);
    refused(&["--fps", "0"], &["--fps", "30000/1001"]);
    // The length of videos is unknown before they are read.
    let films = Rig::new(2);
    films.as_videos(&[2; 6]);
    let mut late = films.video(&["--camera", "cam2", "-o", &films.folders.out("frames"), "--frames", "9:"]);
    films
        .folders
        .assert_refused(late.env("PATH", ffmpeg(&films.folders, "")), &["no camera has a frame from time step 9 on"]);
    // Too few cameras at every step of the range.
    (0..6).for_each(|camera| (9..11).for_each(|frame| fs::write(rig.frame(camera, frame), "").unwrap()));
    refused(&["--frames", "9:11"], &["no frame could be rendered", "cam0: ", "009.png"]);
}

#[test]
fn rates_exposure_and_models_for_planes() {
    let rig = Rig::new(2);
    for (rate, header) in [("29.97", "F2997:100 "), ("30000/1001", "F30000:1001 ")] {
        let output = rig.video(&["--camera", "cam2", "--fps", rate, "-o", "-"]).output().unwrap();
        assert!(String::from_utf8_lossy(&output.stdout[..80]).contains(header), "{}", stderr(&output));
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
        report(&mut rig.video(&arguments)).0["mean"]["psnr"].as_f64().unwrap()
    };
    let (balanced, kept) = (psnr(&[]), psnr(&["--keep-exposure"]));
    assert!((balanced - kept).abs() > 0.1, "{balanced} {kept}");

    let models = rig.folders.scene().join("models");
    fs::create_dir(&models).unwrap();
    for of in ["", "_planes", "_planes_paper", "_surface"] {
        fs::copy(fixture("tiny_v4"), models.join(format!("liveview_v4{of}.onnx"))).unwrap();
    }
    for (layers, alpha, file) in [
        ("planes:3", &[][..], "liveview_v4_planes.onnx"),
        ("planes:3", &["--alpha", "independent"], "liveview_v4_planes_paper.onnx"),
        ("guided:1", &[], "liveview_v4.onnx"),
        ("surface:1", &["--network", "model"], "liveview_v4_surface.onnx"),
    ] {
        let arguments = [&["--camera", "cam2", "--layers", layers, "-o", &out], alpha].concat();
        let mut video = rig.folders.liveview("video", &arguments);
        let (report, _) = report(video.env("LIVEVIEW_MODELS", &models));
        assert!(report["model"]["file"].as_str().unwrap().ends_with(file), "{report}");
    }
}
