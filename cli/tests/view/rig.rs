//! `liveview view` of a rig: its time steps.

use std::fs;

use serde_json::{Value, json};

use crate::common::rig::{Rig, ffmpeg};
use crate::common::viewer::{Client, Viewer, moved};
use crate::common::{Folders, fixture};

const STEPS: usize = 4;

/// A rig in front of a moving wall.
fn rig() -> Rig {
    let rig = Rig::new(STEPS);
    (0..6 * STEPS).for_each(|i| rig.film(i % 6, i / 6, 0.07 * (i / 6) as f64));
    rig
}

fn request(client: &mut Client, id: usize, camera: &Value, step: usize, moving: bool) -> (Value, Vec<u8>) {
    client.send(&json!({ "id": id, "camera": camera, "step": step, "moving": moving, "depth": false }));
    client.frame()
}

/// The frame that `liveview video` renders of this time step alone.
fn frame(rig: &Rig, camera: &Value, step: usize, arguments: &[&str]) -> Vec<u8> {
    let (poses, out) = (rig.folders.out("poses.json"), rig.folders.out("frames"));
    fs::write(&poses, camera.to_string()).unwrap();
    let steps = format!("{step}..{}", step + 1);
    rig.video(&["--poses", &poses, "--frames", &steps, "-o", &out]).args(arguments).assert().success();
    let frames: Vec<_> = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(frames.len(), 1);
    let frame = fs::read(&frames[0]).unwrap();
    fs::remove_dir_all(&out).unwrap();
    frame
}

#[test]
fn time_step_at_rest_equals_the_frame_of_video() {
    let rig = rig();
    for layers in ["surface:1", "guided:2", "select:4/8"] {
        let viewer = Viewer::start(&rig.folders, &["--layers", layers, "--threads", "2"]);
        let (mut client, info) = viewer.client();
        assert_eq!(info["video"], json!({ "steps": STEPS, "rate": 30.0 }));
        let cameras = [0.013, 0.045].map(|by| moved(&info, 2, by));
        // Forward and back in time, and two viewpoints at one time step.
        let requests = [(0, 2), (1, 2), (0, 0), (1, 3), (0, 2)];
        for (id, (camera, step)) in requests.into_iter().enumerate() {
            let (header, picture) = request(&mut client, 2 * id + 1, &cameras[camera], step, true);
            assert_eq!(
                (&header["step"], &header["moving"], &picture[..2]),
                (&step.into(), &true.into(), &[0xFF, 0xD8][..])
            );
            client.send(&json!({ "shown": 1 }));
            let (header, picture) = request(&mut client, 2 * id + 2, &cameras[camera], step, false);
            assert_eq!(
                (&header["step"], &header["layers"], &header["left_out"]),
                (&step.into(), &layers.into(), &json!([]))
            );
            assert!(picture == frame(&rig, &cameras[camera], step, &["--layers", layers]), "{layers} {camera} {step}");
            client.send(&json!({ "shown": 2 }));
        }
        let saved = |step: usize| {
            let body = json!({ "camera": cameras[1], "step": step });
            viewer.ask("POST /picture", &[], &body.to_string())
        };
        assert!(saved(1) == (200, frame(&rig, &cameras[1], 1, &["--layers", layers])));
        let (status, reason) = saved(STEPS);
        assert!(status == 400 && String::from_utf8_lossy(&reason).contains("step: expected a time step from 0 to 3"));
    }
}

#[test]
fn newest_time_step_is_served() {
    let rig = rig();
    let viewer = Viewer::start(&rig.folders, &["--layers", "guided:1", "--fps", "12.5"]);
    let (mut client, info) = viewer.client();
    assert_eq!(info["video"]["rate"], 12.5);
    let camera = moved(&info, 2, 0.01);
    (1..3).for_each(|id| assert_eq!(request(&mut client, id, &camera, 0, true).0["id"], id));
    // As many frames are in flight as may be: of the next hundred requests only the newest is kept.
    for id in 3..103 {
        client.send(&json!({ "id": id, "camera": camera, "step": id % STEPS, "moving": true, "depth": false }));
    }
    client.send(&json!({ "shown": 1 }));
    let (header, _) = client.frame();
    assert_eq!((&header["id"], &header["step"]), (&102.into(), &(102 % STEPS).into()));
}

#[test]
fn missing_and_damaged_frames_are_left_out_and_reported() {
    let rig = rig();
    fs::remove_file(rig.frame(4, 1)).unwrap();
    fs::write(rig.frame(1, 1), b"no picture").unwrap();
    let viewer = Viewer::start(&rig.folders, &["--layers", "guided:1", "--target", "cam5"]);
    let (mut client, info) = viewer.client();
    let (header, _) = request(&mut client, 1, &moved(&info, 2, 0.0), 0, false);
    assert_eq!((&header["left_out"], header["views"].as_array().unwrap().len()), (&json!([]), 4));
    // Four views are needed, and three are left.
    client.send(&json!({ "id": 2, "camera": moved(&info, 2, 0.0), "step": 1, "moving": false, "depth": false }));
    let error = client.text()["error"].as_str().unwrap().to_owned();
    assert!(error.contains("4 views are needed") && error.contains("cam4: frame 1 is missing"), "{error}");
    assert!(error.contains("cam1: ") && error.contains("001.png"), "{error}");
    drop(viewer);
    let viewer = Viewer::start(&rig.folders, &["--layers", "guided:1"]);
    let (mut client, _) = viewer.client();
    let (header, _) = request(&mut client, 1, &moved(&info, 2, 0.01), 1, true);
    let left_out = header["left_out"].as_array().unwrap();
    assert!(left_out.len() == 2 && left_out[1] == "cam4: frame 1 is missing", "{left_out:?}");
    assert_eq!(viewer.status("GET /photo/4?step=1", &[]), 400);
}

#[test]
fn held_out_camera_scores_each_time_step() {
    let rig = rig();
    let viewer = Viewer::start(&rig.folders, &["--layers", "surface:1", "--target", "cam2"]);
    let (mut client, info) = viewer.client();
    let scores = [0, 3].map(|step| {
        let (header, _) = request(&mut client, step, &info["views"][2]["camera"], step, false);
        client.send(&json!({ "shown": step }));
        assert!(!header["views"].as_array().unwrap().contains(&2.into()));
        header["psnr"].as_f64().unwrap()
    });
    for (step, score) in [0, 3].into_iter().zip(scores) {
        let (steps, out) = (format!("{step}..{}", step + 1), rig.folders.out(&format!("frames{step}")));
        let options = ["--camera", "cam2", "--layers", "surface:1", "--frames", &steps, "-o", &out];
        assert_eq!(rig.report(&options)["mean"]["psnr"], score, "step {step}");
    }
    let photos = [0, 3].map(|step| viewer.ask(&format!("GET /photo/2?step={step}"), &[], ""));
    assert!(photos[0].0 == 200 && photos[1].0 == 200 && photos[0].1 != photos[1].1);
    for wrong in ["/photo/2", "/photo/2?step=4", "/photo/2?step=x", "/photo/6?step=0"] {
        assert_eq!(viewer.status(&format!("GET {wrong}"), &[]), 404, "{wrong}");
    }
}

#[test]
fn video_files_are_played_forward_and_back() {
    let rig = rig();
    let arguments = ["--layers", "guided:1"];
    let folders = Viewer::start(&rig.folders, &arguments);
    let (mut client, info) = folders.client();
    let camera = moved(&info, 2, 0.01);
    let steps = [2, 3, 0, 1];
    let shown = |client: &mut Client| {
        steps.map(|step| {
            let (_, picture) = request(client, step, &camera, step, false);
            client.send(&json!({ "shown": step }));
            picture
        })
    };
    let expected = shown(&mut client);
    drop(folders);
    rig.as_videos(&[STEPS; 6]);
    let path = ffmpeg(&rig.folders, "");
    let viewer = Viewer::start_with(&rig.folders, &arguments, |command| {
        command.env("PATH", &path);
    });
    let (mut client, info) = viewer.client();
    assert_eq!(info["video"], json!({ "steps": STEPS, "rate": 30.0 }));
    assert!(shown(&mut client) == expected);
}

#[test]
fn time_steps_of_a_scene_of_photos_are_refused() {
    let folders = Folders::new();
    let model = fixture("tiny_v4");
    let mut refused = folders.liveview("view", &["--port", "0", "--fps", "25", "--model", &model]);
    folders.assert_refused(&mut refused, &["--fps", "is a scene of photos", "--fps is for a rig"]);
    // Photos of one scene in folders of several sizes.
    for other in ["images_2", "images_4"] {
        fs::create_dir(folders.scene().join(other)).unwrap();
        for view in 0..5 {
            fs::copy(folders.photo(view), folders.scene().join(format!("{other}/{view}.png"))).unwrap();
        }
    }
    let viewer = Viewer::start(&folders, &["--layers", "guided:1"]);
    let (mut client, info) = viewer.client();
    assert_eq!((&info["video"], info["views"].as_array().unwrap().len()), (&Value::Null, 5));
    client.send(&json!({ "id": 1, "camera": moved(&info, 2, 0.0), "step": 1, "moving": false, "depth": false }));
    assert!(client.closed().1.contains("step: expected a time step from 0 to 0"));
}
