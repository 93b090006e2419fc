//! Paths through photos, field of view, quality of JPEG files, and the table of scores.

use std::fs;
use std::path::Path;

use liveview::image::{self, ImageRgb};
use liveview_synthesizer::psnr;
use serde_json::Value;

use crate::common::Folders;

/// Runs a command that must succeed; returns its stdout.
fn run(command: &mut assert_cmd::Command) -> String {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Renders without a network; the pictures of a folder.
fn frames(folders: &Folders, arguments: &[&str], names: &[&str]) -> Vec<ImageRgb> {
    let out = folders.out("frames");
    run(&mut folders.liveview("render", &[&["--network", "none", "-o", &out], arguments].concat()));
    names.iter().map(|name| image::load(&Path::new(&out).join(name)).unwrap()).collect()
}

fn assert_shows(frame: &ImageRgb, photo: &Path) {
    let score = psnr(frame, &image::load(photo).unwrap(), 4);
    assert!(score > 35.0, "{}: {score}", photo.display());
}

#[test]
fn interpolated_path_goes_through_the_photos() {
    let folders = Folders::new();
    let names = ["frame_0000.png", "frame_0001.png", "frame_0002.png", "frame_0003.png", "frame_0004.png"];
    let all = frames(&folders, &["--path", "interpolate:5"], &names);
    (0..5).for_each(|view| assert_shows(&all[view], &folders.photo(view)));
    // Photos 4, 0 and 2 in that order, and a frame between each two.
    let chosen = frames(&folders, &["--path", "interpolate:5:4.png,0,images/2.png"], &names);
    [(0, 4), (2, 0), (4, 2)].iter().for_each(|&(frame, view)| assert_shows(&chosen[frame], &folders.photo(view)));
    let folders = Folders::new();
    for (path, words) in [
        ("interpolate:0", "expected a whole number from 1 to 4096"),
        ("interpolate:5:", "expected names of photos"),
        ("interpolate:5:9.png", "no view is named \"9.png\""),
        ("interpolate", "interpolate:N"),
    ] {
        let arguments = ["--path", path, "--network", "none", "-o", &folders.out("refused")];
        folders.assert_refused(&mut folders.liveview("render", &arguments), &[words]);
    }
}

#[test]
fn field_of_view_zooms() {
    let folders = Folders::new();
    let pose = folders.scene().join("pose.json");
    fs::write(&pose, r#"{"transform_matrix": [[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}"#).unwrap();
    let render = |degrees: f64| {
        let (picture, degrees) = (folders.out("a.png"), degrees.to_string());
        let arguments = ["--pose", pose.to_str().unwrap(), "--fov", &degrees, "--network", "none", "-o", &picture];
        run(&mut folders.liveview("render", &arguments));
        image::load(picture.as_ref()).unwrap()
    };
    let degrees = |focal: f64| 2.0 * (32.0 / focal).atan().to_degrees();
    assert_shows(&render(degrees(60.0)), &folders.photo(2));
    // Half the field of view in x and y: the middle of the photo, twice as large.
    let photo = image::load(&folders.photo(2)).unwrap();
    let middle = (12..36).flat_map(|y| (16..48).flat_map(|x| photo.pixel(x, y)).collect::<Vec<_>>()).collect();
    let expected = ImageRgb::new(32, 24, middle).unwrap().resized(64, 48).unwrap();
    let score = psnr(&render(degrees(120.0)), &expected, 4);
    assert!(score > 28.0 && score > psnr(&photo, &expected, 4) + 6.0, "{score}");
    let folders = Folders::new();
    let arguments = ["--target", "2", "--fov", "50", "--network", "none", "-o", &folders.out("b.png")];
    folders.assert_refused(&mut folders.liveview("render", &arguments), &["--fov", "--target"]);
    let arguments = ["--path", "line:2", "--fov", "180", "--network", "none", "-o", &folders.out("b")];
    folders.assert_refused(&mut folders.liveview("render", &arguments), &["expected degrees from 1 to 170"]);
}

#[test]
fn jpeg_quality_is_that_of_files_and_folders() {
    let folders = Folders::new();
    let sizes = ["20", "95"].map(|quality| {
        let file = folders.out("a.jpg");
        let arguments = ["--target", "2", "--network", "none", "--jpeg-quality", quality, "-o", &file];
        run(&mut folders.liveview("render", &arguments));
        fs::read(file).unwrap().len()
    });
    let file = folders.out("a.jpg");
    run(&mut folders.liveview("render", &["--target", "2", "--network", "none", "-o", &file]));
    assert!(sizes[0] < sizes[1] / 2 && fs::read(file).unwrap().len() == sizes[1], "{sizes:?}");
    let path = ["--path", "line:2", "--jpeg-quality", "80"];
    frames(&folders, &path, &["frame_0000.jpg", "frame_0001.jpg"]);
    let folders = Folders::new();
    for (quality, name, words) in [("80", "a.png", "ends in .jpg, or a folder"), ("0", "a.jpg", "from 1 to 100")] {
        let picture = folders.out(name);
        let arguments = ["--target", "2", "--network", "none", "--jpeg-quality", quality, "-o", &picture];
        folders.assert_refused(&mut folders.liveview("render", &arguments), &["--jpeg-quality", words]);
    }
}

#[test]
fn scores_are_a_table_with_a_line_per_picture() {
    let folders = Folders::new();
    folders.write_scene(5, "images/4.png", "images/4, last.png");
    fs::rename(folders.photo(4), folders.scene().join("images/4, last.png")).unwrap();
    let file = folders.out("scores.csv");
    let arguments = ["--heldout", "4", "--network", "none", "--views", "2", "--scores", &file];
    let report: Value = serde_json::from_str(&run(folders.liveview("render", &arguments).arg("--json"))).unwrap();
    let table = fs::read_to_string(&file).unwrap();
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(lines[0], "name,psnr,ssim,psnr_covered,uncovered_share,occluded_share,guessed_share,seconds");
    assert_eq!(lines.len(), 3);
    for (line, (name, target)) in
        lines[1..].iter().zip(["0.png", "\"4, last.png\""].iter().zip(report["targets"].as_array().unwrap()))
    {
        let numbers: Vec<Option<f64>> =
            line.strip_prefix(&format!("{name},")).unwrap().split(',').map(|n| n.parse().ok()).collect();
        for (number, key) in
            numbers.iter().zip(["psnr", "ssim", "psnr_covered", "uncovered_share", "occluded_share", "guessed_share"])
        {
            assert_eq!(*number, target[key].as_f64(), "{key} in {line}");
        }
        assert!(numbers.len() == 7 && numbers[0].is_some() && numbers[6] > Some(0.0), "{line}");
    }
    let text = run(&mut folders.liveview("render", &arguments));
    assert!(text.contains(&format!("wrote   {file}")), "{text}");
    fs::remove_file(&file).unwrap();
    for (arguments, words) in [
        (["--path", "line:2"], "there is no photo to compare with"),
        (["--target", "2"], "expected a name that ends in .csv"),
    ] {
        let name = folders.out(if arguments[0] == "--path" { "a.csv" } else { "a.txt" });
        let rest = ["--network", "none", "-o", &folders.out("refused"), "--scores", &name];
        folders
            .assert_refused(&mut folders.liveview("render", &[&arguments[..], &rest].concat()), &["--scores", words]);
    }
}
