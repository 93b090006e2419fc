//! `liveview inspect` of scenes.

use serde_json::Value;

use crate::common::{Folders, fixture};

fn json(command: &mut assert_cmd::Command) -> Value {
    let output = command.arg("--json").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn assert_close(value: &Value, expected: f64) {
    assert!((value.as_f64().unwrap() - expected).abs() < 1e-6, "{value}, expected {expected}");
}

#[test]
fn inspect_reports_the_rig_and_parallax() {
    let folders = Folders::new();
    let report = json(&mut folders.liveview("inspect", &[]));
    assert_eq!((&report["views"]["count"], &report["target"]["name"]), (&5.into(), &"2.png".into()));
    assert_close(&report["rig"]["extent"][0], 0.4);
    assert_close(&report["rig"]["baseline"]["median"], 0.1);
    assert_close(&report["target"]["near"], 2.0);
    let view = &report["target"]["views"][0];
    assert_close(&view["distance"], 0.1);
    // 60 pixels · 0.1 · (1/2 − 1/8); the farthest of the four views has twice that, over 63 steps.
    assert_close(&view["parallax_pixels"], 2.25);
    assert_close(&report["target"]["planes"]["largest_step_pixels"], 4.5 / 63.0);
    let text = folders.liveview("inspect", &["--layers", "planes:3"]).output().unwrap();
    let text = String::from_utf8(text.stdout).unwrap();
    assert!(text.contains("2.25 pixels") && text.contains("planes:6"), "{text}");
}

#[test]
fn inspect_reports_skipped_views_and_planes() {
    let folders = Folders::new();
    // View 4 faces backwards.
    folders.write_scene(
        5,
        "[[1, 0, 0, 0.4], [0, 1, 0, 0], [0, 0, 1, 0]",
        "[[-1, 0, 0, 0.4], [0, 1, 0, 0], [0, 0, -1, 0]",
    );
    let report = json(&mut folders.liveview("inspect", &["--target", "1"]));
    assert_eq!(report["target"]["facing_away"], serde_json::json!(["4.png"]));
    assert!(report["target"]["warning"].as_str().unwrap().contains("4 views are needed"), "{report}");
    folders.write_scene_in_one_place(5);
    let report = json(&mut folders.liveview("inspect", &[]));
    assert!(report["target"]["warning"].as_str().unwrap().contains("--near and --far"), "{report}");
    folders.write_scene(5, "", "");
    folders.assert_refused(&mut folders.liveview("inspect", &["--near", "5", "--far", "2"]), &["0 < near < far"]);
    // At depth 0.01 the parallax is 60 · 0.1 / 0.01 = 600 pixels, more than the width of the photo.
    let report = json(&mut folders.liveview("inspect", &["--near", "0.01", "--far", "8", "--layers", "planes:4"]));
    assert_eq!(report["target"]["planes"]["uncovered"], serde_json::json!([0, 1, 2]));
}

#[test]
fn depth_range_is_found_from_the_photos_where_nothing_gives_it() {
    let folders = Folders::new();
    folders.write_scene(5, ", \"near\": 2, \"far\": 8", "");
    // Around the wall at depth 4, where a pixel of parallax in the farthest photo is a depth of 0.5.
    let report = json(&mut folders.liveview("inspect", &["--target", "2"]));
    let found = ["near", "far"].map(|end| report["target"][end].as_f64().unwrap());
    assert!((3.0..4.0).contains(&found[0]) && (4.0..7.0).contains(&found[1]), "{report}");
    let text = folders.liveview("inspect", &["--target", "2"]).output().unwrap();
    assert!(String::from_utf8_lossy(&text.stdout).contains("scene units, found from the photos"));
    let report = json(&mut folders.liveview("inspect", &["--target", "2", "--near", "1"]));
    assert_eq!((report["target"]["near"].as_f64(), report["target"]["far"].as_f64()), (Some(1.0), Some(found[1])));
    let picture = folders.out("a.png");
    for layers in ["surface:3", "guided:2"] {
        let options = ["--target", "2", "--network", "none", "--layers", layers, "-o", &picture];
        let report = json(&mut folders.liveview("render", &options));
        assert!(report["mean"]["psnr"].as_f64().unwrap() > 30.0, "{report}");
        std::fs::remove_file(&picture).unwrap();
    }
    // A photo that cannot be read is an error, not a worse range.
    std::fs::write(folders.photo(0), "no photo").unwrap();
    let output = folders.liveview("inspect", &[]).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.contains("images/0.png is left out: "), "{text}");
}

#[test]
fn poses_that_do_not_belong_to_the_photos_are_noticed() {
    let folders = Folders::new();
    let picture = folders.out("a.png");
    let warns = || {
        let inspected = folders.liveview("inspect", &["--target", "2"]).output().unwrap();
        let rendered = folders.liveview("render", &["--target", "2", "-o", &picture]).output().unwrap();
        [inspected.stdout, rendered.stderr]
            .map(|text| String::from_utf8(text).unwrap().contains("photos agree on only"))
    };
    assert_eq!(warns(), [false; 2]);
    // The cameras stand in a column instead of in a row.
    let poses = folders.scene().join("transforms.json");
    let text = std::fs::read_to_string(&poses).unwrap();
    let turned = |text: String, view: usize| {
        let x = 0.1 * view as f64;
        text.replace(&format!("[1, 0, 0, {x}], [0, 1, 0, 0]"), &format!("[1, 0, 0, 0], [0, 1, 0, {x}]"))
    };
    std::fs::write(&poses, (0..5).fold(text, turned)).unwrap();
    assert_eq!(warns(), [true; 2]);
}

#[test]
fn explain_tells_the_exposure_gains_and_inspect_warns_without_a_depth_range() {
    let folders = Folders::new();
    // Photos large enough for gains to be estimated, one of them a third darker in red.
    folders.write_scene(5, r#""cx": 32, "cy": 24, "w": 64, "h": 48"#, r#""cx": 96, "cy": 72, "w": 192, "h": 144"#);
    (0..5).for_each(|view| crate::common::photo(&folders.photo(view), 0.1 * view as f64, 192, 144));
    let darker = folders.photo(1);
    let mut picture = image::open(&darker).unwrap().into_rgb8();
    picture.pixels_mut().for_each(|pixel| pixel.0[0] = (2 * u16::from(pixel.0[0]) / 3) as u8);
    picture.save(&darker).unwrap();
    let (explained, picture) = (folders.out("why.png"), folders.out("new.png"));
    let arguments = ["--target", "2", "--layers", "surface:1", "-o", &picture, "--explain", &explained];
    let report = json(&mut folders.render(&arguments));
    let views = report["targets"][0]["views"].as_array().unwrap();
    let gain = |name: &str, channel: usize| {
        let view = views.iter().position(|view| view == name).unwrap();
        report["explanation"]["gains"][view][channel].as_f64().unwrap()
    };
    assert!((gain("1.png", 0) / gain("3.png", 0) - 1.5).abs() < 0.05, "{report}");
    assert!((gain("1.png", 2) / gain("3.png", 2) - 1.0).abs() < 0.02, "{report}");
    folders.write_scene_in_one_place(5);
    let report = json(&mut folders.liveview("inspect", &[]));
    assert!(report["target"]["warning"].as_str().unwrap().contains("--near and --far"), "{report}");
}

#[test]
fn unsupported_layers_are_errors() {
    let folders = Folders::new();
    let refused = |command: &str, arguments: &[&str], words: &[&str]| {
        folders.assert_refused(&mut folders.liveview(command, arguments), words);
    };
    refused("inspect", &["--layers", "guided:2"], &["--layers guided:2", "expected planes:D or list:"]);
    refused("inspect", &["--layers", "planes:0"], &["--layers", "planes:0", "a whole number from 1 to 4096"]);
    let target = |layers| ["--target", "2", "--planes", "--layers", layers];
    refused("inspect", &target("planes:4"), &["--layers planes:4", "expected select:K/D"]);
    refused("inspect", &["--model", &fixture("tiny_v4")], &["--model", "expected --planes with it"]);
    refused("inspect", &target("guided:0"), &["--layers", "guided:0", "a whole number from 1 to 4096"]);
}

#[test]
fn planes_are_reported_with_their_histogram() {
    let folders = Folders::new();
    let model = fixture("tiny_v4");
    let arguments = ["--planes", "--target", "2", "--layers", "select:3/8", "--model", &model];
    let report = json(&mut folders.liveview("inspect", &arguments));
    let histogram: Vec<u64> =
        report["histogram"].as_array().unwrap().iter().map(|votes| votes.as_u64().unwrap()).collect();
    assert_eq!((histogram.len(), histogram.iter().sum::<u64>()), (8, 64 * 48));
    // The fixture gives all planes the same opacity, so the nearest one wins.
    assert_eq!(report["chosen"][0], 0);
    let refused = ["--planes", "--target", "2", "--layers", "select:9/8", "--model", &model];
    folders.assert_refused(&mut folders.liveview("inspect", &refused), &["9 planes"]);
}
