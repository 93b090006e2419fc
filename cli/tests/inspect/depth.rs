//! `liveview depth`: its files, how accurate they are, its errors.

use std::fs;
use std::path::Path;

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
fn table_has_a_line_per_photo_and_the_mean() {
    let folders = Folders::new();
    let shares: Vec<f64> = depth(&folders, &[]).0["photos"]
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one["confirmed"].as_f64().unwrap())
        .collect();
    let table = folders.liveview("depth", &["-o", &folders.out("depth")]).output().unwrap();
    let table = String::from_utf8(table.stdout).unwrap();
    let share = |name: &str| table.lines().find_map(|line| line.strip_prefix(name)?.split_whitespace().next());
    for (view, expected) in shares.iter().enumerate() {
        assert_eq!(share(&format!("{view}.png ")), Some(&*format!("{:.1}", 100.0 * expected)), "{table}");
    }
    assert_eq!(share("mean "), Some(&*format!("{:.1}", 20.0 * shares.iter().sum::<f64>())), "{table}");
}

/// Shares of the pixels within 0.5, 1 and 2 pixels of parallax of the true depth of the workshop, where it is known.
fn within(found: &Array2<f32>, pixel: f32, view: &str) -> [f64; 3] {
    let truth = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/scenes/workshop/depth");
    let scale: Value = serde_json::from_str(&fs::read_to_string(truth.join("scale.json")).unwrap()).unwrap();
    let unit = scale["delta_max"].as_f64().unwrap() as f32 / 65535.0;
    let truth = image::open(truth.join(view)).unwrap().into_luma16();
    assert_eq!((truth.height() as usize, truth.width() as usize), found.dim());
    let errors = found.indexed_iter().filter(|(_, found)| **found >= 0.0).filter_map(|((y, x), found)| {
        let truth = f32::from(truth[(x as u32, y as u32)].0[0]) * unit;
        (truth > 0.0).then_some((found - truth).abs() / pixel)
    });
    let errors: Vec<f32> = errors.collect();
    [0.5, 1.0, 2.0].map(|bound| errors.iter().filter(|&&error| error <= bound).count() as f64 / errors.len() as f64)
}

#[test]
fn depth_of_the_example_scene_is_accurate() {
    let folders = Folders::new();
    let workshop = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/scenes/workshop");
    let mut liveview = assert_cmd::Command::new(env!("CARGO_BIN_EXE_liveview"));
    liveview.arg("depth").arg(workshop).args(["--photo", "source_0", "-o", &folders.out("depth"), "--json"]);
    liveview.args(["--cache", &folders.out("kept")]);
    let report: Value = serde_json::from_slice(&liveview.output().unwrap().stdout).unwrap();
    let photo = &report["photos"][0];
    assert!(photo["confirmed"].as_f64().unwrap() > 0.7, "{photo}");
    let pixel = photo["disparity_per_pixel_of_parallax"].as_f64().unwrap() as f32;
    let confirmed: Array2<f32> = npy::read(&fs::read(folders.out("depth/source_0.npy")).unwrap()).unwrap();
    let confirmed = within(&confirmed, pixel, "source_0.png");
    // What is kept is the depth of all pixels, of each photo that was searched.
    let kept = fs::read_dir(folders.out("kept")).unwrap().map(|file| depth_of(&file.unwrap().path()));
    let all = kept.map(|found| within(&found, pixel, "source_0.png")).max_by(|a, b| a[2].total_cmp(&b[2])).unwrap();
    assert!(confirmed[1] > 0.85 && confirmed[2] > all[2] && all[2] > 0.5, "{confirmed:?}, of all pixels {all:?}");
}

/// The depth in a file of `--cache`.
fn depth_of(file: &Path) -> Array2<f32> {
    let mut archive = zip::ZipArchive::new(fs::File::open(file).unwrap()).unwrap();
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut archive.by_name("disparity.npy").unwrap(), &mut bytes).unwrap();
    npy::read(&bytes).unwrap()
}

#[test]
fn invalid_options_of_depth_are_errors() {
    let folders = Folders::new();
    // True depth, which another program has written.
    fs::create_dir(folders.scene().join("depth")).unwrap();
    fs::copy(folders.photo(0), folders.scene().join("depth/0.png")).unwrap();
    let out = folders.out("depth");
    let [images, truth, own] =
        ["images", "depth", "images/.."].map(|name| folders.scene().join(name).to_str().unwrap().to_owned());
    for (arguments, words) in [
        (vec!["-o", &images], ["images/0.png", "would overwrite a photo"]),
        (vec!["-o", &truth], ["-o", "that liveview did not write"]),
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
