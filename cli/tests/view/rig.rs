//! `liveview view` of a rig: its time steps.

use std::fs;

use serde_json::{Value, json};

use crate::common::rig::{Rig, ffmpeg, name_sources, running};
use crate::common::viewer::{Viewer, moved};
use crate::common::{Folders, fixture};

const STEPS: usize = 4;

/// A rig in front of a moving wall.
fn rig() -> Rig {
    let rig = Rig::new(STEPS);
    (0..6 * STEPS).for_each(|i| rig.film(i % 6, i / 6, 0.07 * (i / 6) as f64));
    rig
}

#[test]
fn each_time_step_has_its_photos_depth_and_pictures() {
    let rig = rig();
    let viewer = Viewer::start(&rig.folders, &["--layers", "surface:1", "--threads", "2", "--target", "cam2"]);
    let info = viewer.description();
    assert_eq!(info["served"]["video"], json!({ "steps": STEPS, "rate": 30.0 }));
    assert_eq!(info["views"][2]["held_out"], true);
    let files = |kind: &str, view: usize| {
        // Forward and back in time.
        let steps = [2, 0, 3, 2].map(|step| viewer.ask(&format!("GET /{kind}/{view}?step={step}"), &[], ""));
        assert!(steps.iter().all(|(status, _)| *status == 200), "{kind}");
        assert!(steps[0].1 != steps[1].1 && steps[0].1 == steps[3].1, "{kind}");
    };
    files("photo", 2);
    files("photo", 1);
    files("depth", 1);
    for wrong in ["/photo/2?step=4", "/photo/2?step=x", "/photo/6?step=0", "/depth/1?step=4"] {
        assert_eq!(viewer.status(&format!("GET {wrong}"), &[]), 404, "{wrong}");
    }
    let pictures = [1, 3].map(|step| viewer.picture(&json!({ "camera": moved(&info, 2, 0.01), "step": step })));
    assert!(pictures.iter().all(|(status, png)| *status == 200 && png.starts_with(b"\x89PNG")));
    assert!(pictures[0].1 != pictures[1].1);
    let (status, reason) = viewer.picture(&json!({ "camera": moved(&info, 2, 0.0), "step": STEPS }));
    assert!(status == 400 && String::from_utf8_lossy(&reason).contains("step: expected a time step from 0 to 3"));
}

#[test]
fn video_files_are_read_forward_and_back() {
    let rig = rig();
    let photos = |viewer: &Viewer| -> Vec<Vec<u8>> {
        let steps = [2, 3, 0, 1].iter();
        steps.map(|step| viewer.ask(&format!("GET /photo/2?step={step}"), &[], "").1).collect()
    };
    let folders = Viewer::start(&rig.folders, &["--layers", "guided:1"]);
    let expected = photos(&folders);
    drop(folders);
    rig.as_videos(&[STEPS; 6]);
    let path = ffmpeg(&rig.folders, "");
    let viewer = Viewer::start_with(&rig.folders, &["--layers", "guided:1"], |command| {
        command.env("PATH", &path);
    });
    assert_eq!(viewer.description()["served"]["video"], json!({ "steps": STEPS, "rate": 30.0 }));
    assert!(photos(&viewer) == expected);
}

#[test]
fn cameras_that_run_are_shown_as_they_are() {
    let rig = Rig::new(1);
    let path = running(&rig, "");
    name_sources(&rig);
    let viewer = Viewer::start_with(&rig.folders, &["--layers", "surface:1", "--threads", "2"], |command| {
        command.env("PATH", &path);
    });
    let info = viewer.description();
    assert_eq!(info["served"]["video"], json!({ "steps": null, "rate": 30.0 }));
    let ask = |kind: &str, step: usize| viewer.ask(&format!("GET /{kind}/1?step={step}"), &[], "");
    let moment = || {
        std::thread::sleep(std::time::Duration::from_millis(100));
        let (status, step) = viewer.ask("GET /moment", &[], "");
        assert_eq!(status, 200);
        String::from_utf8(step).unwrap().parse::<usize>().unwrap()
    };
    let first = moment();
    let (photo, depth) = (ask("photo", first), ask("depth", first));
    assert_eq!((photo.0, depth.0), (200, 200));
    // The camera shows something else.
    let file = |name: &str| rig.path().join(name);
    fs::copy(file("4.ppm"), file("other.ppm")).unwrap();
    fs::rename(file("other.ppm"), file("1.ppm")).unwrap();
    let later = (0..100).map(|_| moment()).find(|&step| ask("photo", step) != photo).expect("newer frames");
    assert!(later > first);
    assert_ne!(ask("depth", later), depth);
    assert_eq!(ask("photo", first), photo, "a moment stays as it was");
    assert_eq!([ask("photo", later + 1000).0, ask("depth", later + 1000).0], [500; 2], "there was no such moment");
    assert_ne!(ask("depth", moment()), depth);
    let (status, png) = viewer.picture(&json!({ "camera": moved(&info, 2, 0.01), "step": later }));
    assert!(status == 200 && png.starts_with(b"\x89PNG"));
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
    let info = viewer.description();
    assert_eq!((&info["served"]["video"], info["views"].as_array().unwrap().len()), (&Value::Null, 5));
    assert_eq!(viewer.picture(&json!({ "camera": moved(&info, 2, 0.0), "step": 1 })).0, 400);
}
