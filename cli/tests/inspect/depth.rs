//! `liveview depth`: its files, its scores, its errors.

use std::fs;
use std::path::Path;

use image::{ImageBuffer, Luma};
use liveview_files::npy;
use ndarray::Array2;
use serde_json::Value;

use crate::common::{Folders, HEIGHT, WIDTH};

/// Disparity of the wall.
const WALL: f32 = 0.25;

/// Runs `liveview depth scene -o out/depth ARGUMENTS --json`; returns its report and stderr.
fn depth(folders: &Folders, arguments: &[&str]) -> (Value, String) {
    let output = folders.liveview("depth", arguments).args(["-o", &folders.out("depth"), "--json"]).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{stderr}");
    (serde_json::from_slice(&output.stdout).unwrap(), stderr)
}

fn map(folders: &Folders, view: usize) -> Array2<f32> {
    npy::read(&fs::read(folders.out(&format!("depth/{view}.npy"))).unwrap()).unwrap()
}

/// Writes the true depth of the wall as 16-bit PNGs of this size, in units of 1/65535 of
/// `delta_max`.
fn write_truth(folders: &Folders, width: u32, height: u32, delta_max: f32) {
    let folder = folders.scene().join("depth");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("scale.json"), format!("{{\"delta_max\": {delta_max}}}")).unwrap();
    let value = (WALL / delta_max * 65535.0).round() as u16;
    for view in 0..5 {
        // The first row is unknown.
        let pixel = |_, row| Luma([if row == 0 { 0 } else { value }]);
        let picture: ImageBuffer<Luma<u16>, Vec<u16>> = ImageBuffer::from_fn(width, height, pixel);
        picture.save(folder.join(format!("{view}.png"))).unwrap();
    }
}

#[test]
fn depth_of_every_photo_is_written_as_array_and_pictures() {
    let folders = Folders::new();
    let (report, _) = depth(&folders, &[]);
    let names =
        |view: usize| [".npy", ".png", "_colour.png", "_scale.json"].map(|suffix| format!("depth/{view}{suffix}"));
    assert_eq!(folders.written(), (0..5).flat_map(names).collect::<Vec<_>>());
    assert_eq!(
        (&report["near"], &report["far"], report["photos"].as_array().unwrap().len()),
        (&2.0.into(), &8.0.into(), 5)
    );
    for view in 0..5 {
        let (report, map) = (&report["photos"][view], map(&folders, view));
        assert_eq!(map.dim(), (HEIGHT as usize, WIDTH as usize));
        let confirmed: Vec<f32> = map.iter().copied().filter(|&disparity| disparity != -1.0).collect();
        assert!(confirmed.iter().all(|disparity| (0.11..0.52).contains(disparity)), "{confirmed:?}");
        let share = confirmed.len() as f64 / map.len() as f64;
        assert!(share > 0.5 && report["confirmed"] == share && report["source"] == "searched", "{share} in {report}");
        let pixel = report["disparity_per_pixel_of_parallax"].as_f64().unwrap() as f32;
        let accurate = confirmed.iter().filter(|&disparity| (disparity - WALL).abs() < pixel).count();
        assert!(10 * accurate > 8 * confirmed.len(), "photo {view}: {accurate} of {}", confirmed.len());

        let path = |suffix: &str| folders.out(&format!("depth/{view}{suffix}"));
        let scale: Value = serde_json::from_str(&fs::read_to_string(path("_scale.json")).unwrap()).unwrap();
        let largest = scale["disparity_max"].as_f64().unwrap() as f32;
        let grey = image::open(path(".png")).unwrap().into_luma16();
        let colour = image::open(path("_colour.png")).unwrap().into_rgb8();
        for ((y, x), &disparity) in map.indexed_iter() {
            let (value, rgb) = (grey[(x as u32, y as u32)].0[0], colour[(x as u32, y as u32)].0);
            assert_eq!((value == 0, rgb == [0; 3]), (disparity == -1.0, disparity == -1.0), "row {y}, column {x}");
            if value > 0 {
                assert!(
                    (f32::from(value) / 65535.0 * largest - disparity).abs() < 1e-5 * largest,
                    "row {y}, column {x}"
                );
            }
        }
    }
}

#[test]
fn held_out_photos_do_not_affect_the_depth_of_others() {
    let folders = Folders::new();
    let names = |report: &Value| {
        let photos = report["photos"].as_array().unwrap().iter();
        photos.map(|photo| photo["name"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    let (report, _) = depth(&folders, &["--photo", "3,0"]);
    assert_eq!(names(&report), ["3.png", "0.png"]);
    let with_neighbours = map(&folders, 3);
    let (report, _) = depth(&folders, &["--heldout", "2"]);
    assert_eq!(
        (names(&report), &report["held_out"]),
        (vec!["1.png".into(), "3.png".into()], &serde_json::json!(["0.png", "2.png", "4.png"]))
    );
    let without = map(&folders, 3);
    assert_ne!(with_neighbours, without, "two of its neighbours are held out");
    // The content of a held-out photo has no effect.
    crate::common::photo(&folders.photo(2), 7.0, WIDTH, HEIGHT);
    depth(&folders, &["--target", "0,2,4"]);
    assert_eq!(map(&folders, 3), without);
    let (report, _) = depth(&folders, &["--target", "0,1,2,4"]);
    assert_eq!((&report["photos"][0]["source"], &report["photos"][0]["confirmed"]), (&"alone".into(), &0.0.into()));
    assert!(map(&folders, 3).iter().all(|&disparity| disparity == -1.0));
}

#[test]
fn depth_is_scored_if_the_scene_has_true_depth() {
    let folders = Folders::new();
    assert_eq!(depth(&folders, &[]).0["photos"][0]["within"], Value::Null);
    write_truth(&folders, WIDTH, HEIGHT, 0.5);
    let (report, stderr) = depth(&folders, &[]);
    assert_eq!(stderr, "");
    for view in 0..5 {
        let report = &report["photos"][view];
        let map = map(&folders, view);
        let pixel = report["disparity_per_pixel_of_parallax"].as_f64().unwrap() as f32;
        let value = (WALL / 0.5 * 65535.0).round() / 65535.0 * 0.5;
        let disparities: Vec<f32> = map.rows().into_iter().skip(1).flatten().copied().filter(|&d| d != -1.0).collect();
        for (k, bound) in [0.5, 1.0, 2.0].into_iter().enumerate() {
            let accurate = disparities.iter().filter(|&d| (d - value).abs() / pixel <= bound).count();
            let share = accurate as f64 / disparities.len() as f64;
            let (confirmed, all) = (&report["within"]["confirmed"][k], report["within"]["all"][k].as_f64().unwrap());
            assert!(
                (confirmed.as_f64().unwrap() - share).abs() < 2e-3,
                "photo {view}, {bound} px: {share} in {report}"
            );
            assert!((0.3..=1.0).contains(&all), "{report}");
        }
    }
    let table = folders.liveview("depth", &["-o", &folders.out("depth")]).output().unwrap();
    let table = String::from_utf8(table.stdout).unwrap();
    assert!(table.contains("of the truth") && table.lines().any(|line| line.starts_with("mean ")), "{table}");

    write_truth(&folders, WIDTH / 2, HEIGHT, 0.5);
    let (report, stderr) = depth(&folders, &["--photo", "1"]);
    assert!(
        stderr.contains("the depth is not scored: ") && stderr.contains("depth/1.png: 32x48; expected 64x48"),
        "{stderr}"
    );
    assert_eq!(report["photos"][0]["within"], Value::Null);
    for (scale, word) in [("{}", "\"delta_max\" is null"), ("{\"delta_max\": -1}", "-1"), ("{", "EOF")] {
        fs::write(folders.scene().join("depth/scale.json"), scale).unwrap();
        let (_, stderr) = depth(&folders, &["--photo", "1"]);
        assert!(stderr.lines().count() == 1 && stderr.starts_with("note: the depth is not scored: "), "{stderr}");
        assert!(stderr.contains("scale.json: ") && stderr.contains(word), "{stderr}");
    }
}

#[test]
fn depth_of_the_example_scene_is_accurate() {
    let folders = Folders::new();
    let workshop = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/scenes/workshop");
    let mut liveview = assert_cmd::Command::new(env!("CARGO_BIN_EXE_liveview"));
    liveview.arg("depth").arg(workshop).args(["--photo", "source_0", "-o", &folders.out("depth"), "--json"]);
    let report: Value = serde_json::from_slice(&liveview.output().unwrap().stdout).unwrap();
    let photo = &report["photos"][0];
    let share = |of: &str, k: usize| photo["within"][of][k].as_f64().unwrap();
    assert!(photo["confirmed"].as_f64().unwrap() > 0.7, "{photo}");
    assert!(share("confirmed", 1) > 0.85 && share("confirmed", 2) > share("all", 2), "{photo}");
}

#[test]
fn invalid_options_of_depth_are_errors() {
    let folders = Folders::new();
    write_truth(&folders, WIDTH, HEIGHT, 0.5);
    let out = folders.out("depth");
    let [images, truth, own] =
        ["images", "depth", "images/.."].map(|name| folders.scene().join(name).to_str().unwrap().to_owned());
    for (arguments, words) in [
        (vec!["-o", &images], ["images/0.png", "would overwrite a photo"]),
        (vec!["-o", &truth], ["-o", "would overwrite the true depth"]),
        (vec!["-o", &own], ["-o", "is a folder of the scene"]),
        (vec!["-o", &folders.out("a.png")], ["a.png", "expected a folder"]),
        (vec!["-o", &out, "--photo", "nobody"], ["nobody", "no view is named"]),
        (vec!["-o", &out, "--photo", "1,1"], ["--photo", "twice"]),
        (vec!["-o", &out, "--photo", "2", "--target", "2"], ["2.png", "held out"]),
        (vec!["-o", &out, "--target", "0,1,2,3,4"], ["--target", "every view"]),
        (vec!["-o", &out, "--heldout", "1"], ["--heldout 1", "every view"]),
        (vec!["-o", &out, "--far", "1"], ["near", "far"]),
    ] {
        let before = fs::read(folders.photo(0)).unwrap();
        let output = folders.liveview("depth", &arguments).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), stderr.matches("error: ").count()), (Some(2), 1), "{arguments:?}: {stderr}");
        words.iter().for_each(|word| assert!(stderr.contains(word), "\"{word}\" is missing in: {stderr}"));
        assert_eq!((fs::read(folders.photo(0)).unwrap(), folders.written()), (before, Vec::new()), "{arguments:?}");
    }
}
