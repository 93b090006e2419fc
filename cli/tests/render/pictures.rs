//! `liveview render`: its pictures and its report.

use std::fs;

use liveview::geometry::Size;
use liveview::image::{self};
use liveview_synthesizer::psnr;
use serde_json::Value;

use crate::common::{Folders, HEIGHT, WIDTH};

/// Runs a command that must succeed; returns its stdout.
fn run(command: &mut assert_cmd::Command) -> String {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn json(command: &mut assert_cmd::Command) -> Value {
    serde_json::from_str(&run(command.arg("--json"))).unwrap()
}

#[test]
fn held_out_view_is_rendered_scored_and_compared() {
    let folders = Folders::new();
    let [picture, depth, compare] = ["a.png", "d.png", "c.png"].map(|name| folders.out(name));
    let report =
        json(&mut folders.render(&["--target", "2", "-o", &picture, "--depth", &depth, "--compare", &compare]));
    assert_eq!(folders.written(), ["a.png", "c.png", "d.png", "d_colour.png", "d_scale.json"]);
    let target = &report["targets"][0];
    assert_eq!(target["name"], "2.png");
    let mut views: Vec<&str> = target["views"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    views.sort_unstable();
    assert_eq!(views, ["0.png", "1.png", "3.png", "4.png"], "not from the target itself");
    assert_eq!((&target["near"], &target["far"]), (&2.0.into(), &8.0.into()));
    assert_eq!(report["layers"], "guided:2", "as the model recommends");

    let (result, truth) = (image::load(picture.as_ref()).unwrap(), image::load(&folders.photo(2)).unwrap());
    let score = psnr(&result, &truth, 16);
    assert!(score > 40.0, "{score}");
    assert!((target["psnr"].as_f64().unwrap() - score).abs() < 1e-9, "{score} dB from the file, {report}");
    let size = image::read_size(compare.as_ref()).unwrap();
    assert_eq!(size, Size::new(3 * WIDTH as usize + 8, HEIGHT as usize));

    let scale: Value = serde_json::from_slice(&fs::read(folders.out("d_scale.json")).unwrap()).unwrap();
    let grey = ::image::open(&depth).unwrap().into_luma16();
    assert_eq!(grey.iter().max(), Some(&65535));
    let disparity = f64::from(grey.get_pixel(32, 24).0[0]) / 65535.0 * scale["disparity_max"].as_f64().unwrap();
    assert!((disparity - 0.25).abs() < 0.05, "the wall is at depth 4: {disparity}");
}

#[test]
fn heldout_renders_every_nth_view_from_the_others() {
    let folders = Folders::new();
    folders.write_scene(5, "images/4.png", "images/9.png");
    fs::rename(folders.photo(4), folders.photo(9)).unwrap();
    // Two of five views remain, too few for V = 4.
    folders.assert_refused(&mut folders.render(&["--heldout", "2"]), &["0.png", "only 2 of 2"]);
    let text = run(&mut folders.render(&["--heldout", "5"]));
    assert!(text.contains("PSNR") && text.contains("0.png"), "{text}");
    assert!(folders.written().is_empty(), "no pictures without -o");
    let report = json(&mut folders.render(&["--target", "0", "-o", &folders.out("a.png")]));
    assert_eq!(report["mean"]["psnr"], report["targets"][0]["psnr"]);
}

#[test]
fn picture_does_not_depend_on_threads_or_batch_size() {
    let folders = Folders::new();
    let pictures = [("1", "1"), ("2", "3"), ("2", "3")].map(|(threads, batch)| {
        let picture = folders.out("a.png");
        run(&mut folders.render(&[
            "--target",
            "2",
            "--layers",
            "planes:8",
            "--threads",
            threads,
            "--batch",
            batch,
            "-o",
            &picture,
        ]));
        fs::read(picture).unwrap()
    });
    assert!(pictures[0] == pictures[1] && pictures[1] == pictures[2]);
}

#[test]
fn pose_of_a_view_gives_its_photo() {
    let folders = Folders::new();
    for pose in [
        r#"{"transform_matrix": [[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}"#,
        r#"{"cam_from_world": [[1, 0, 0, -0.2], [0, -1, 0, 0], [0, 0, -1, 0]]}"#,
    ] {
        let file = folders.scene().join("pose.json");
        fs::write(&file, pose).unwrap();
        let picture = folders.out("a.png");
        run(&mut folders.render(&["--pose", file.to_str().unwrap(), "-o", &picture]));
        let score = psnr(&image::load(picture.as_ref()).unwrap(), &image::load(&folders.photo(2)).unwrap(), 0);
        assert!(score > 45.0, "{pose}: {score}");
    }
    let path = folders.scene().join("path.json");
    let frame = r#"{"camera_to_world": [1, 0, 0, 0.2, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], "fov": 43.6028189727, "aspect": 1.333}"#;
    let text = format!(
        r#"{{"camera_type": "perspective", "render_width": 64, "render_height": 48, "camera_path": [{frame}]}}"#
    );
    fs::write(&path, text).unwrap();
    let picture = folders.out("n.png");
    run(&mut folders.render(&["--pose", path.to_str().unwrap(), "-o", &picture]));
    let score = psnr(&image::load(picture.as_ref()).unwrap(), &image::load(&folders.photo(2)).unwrap(), 0);
    assert!(score > 45.0, "nerfstudio's: {score}");
    // nerfstudio rotated the scene by 180° about z, moved and scaled it, as the file beside the
    // path says.
    let report = folders.render(&["--pose", path.to_str().unwrap(), "-o", &picture]).output().unwrap();
    assert!(String::from_utf8_lossy(&report.stderr).contains("path.json: assumed to be in the scene's own axes"));
    let trained = "[-1, 0, 0, 0.4, 0, -1, 0, 0.5, 0, 0, 1, 1.5, 0, 0, 0, 1]";
    fs::write(
        &path,
        fs::read_to_string(&path).unwrap().replace("[1, 0, 0, 0.2, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]", trained),
    )
    .unwrap();
    let transforms = r#"{"transform": [[-1, 0, 0, 1], [0, -1, 0, 1], [0, 0, 1, 3]], "scale": 0.5}"#;
    fs::write(folders.scene().join("dataparser_transforms.json"), transforms).unwrap();
    let report = folders.render(&["--path", path.to_str().unwrap(), "-o", &picture]).output().unwrap();
    assert!(String::from_utf8_lossy(&report.stderr).contains("path.json: converted from nerfstudio's axes"));
    let score = psnr(&image::load(picture.as_ref()).unwrap(), &image::load(&folders.photo(2)).unwrap(), 0);
    assert!(score > 45.0, "from nerfstudio's axes: {score}");
    let (file, picture) = (folders.scene().join("pose.json"), folders.out("wide.jpg"));
    fs::write(&file, r#"{"transform_matrix": [[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "w": 96, "h": 48, "cx": 48}"#).unwrap();
    run(&mut folders.render(&["--pose", file.to_str().unwrap(), "-o", &picture]));
    assert_eq!(image::read_size(picture.as_ref()).unwrap(), Size::new(96, 48));
}

#[test]
fn path_gives_a_folder_of_frames_with_the_planes_of_the_first() {
    let folders = Folders::new();
    let report =
        json(&mut folders.render(&["--path", "line:3", "--layers", "select:2/8", "-o", &folders.out("frames")]));
    let frames = ["frames/frame_0000.png", "frames/frame_0001.png", "frames/frame_0002.png"];
    assert_eq!(folders.written(), frames);
    let seconds = |frame: usize| report["targets"][frame]["seconds"]["select"].as_f64().unwrap();
    assert!(seconds(0) > 0.0 && seconds(1) == 0.0 && seconds(2) == 0.0, "{report}");
    assert_eq!((&report["targets"][2]["layers"], &report["layers"]), (&2.into(), &"select:2/8".into()));
    // The ends of a line are the outermost views.
    for (frame, view) in [(0, 0), (2, 4)] {
        let frame = image::load(folders.out(&format!("frames/frame_{frame:04}.png")).as_ref()).unwrap();
        let score = psnr(&frame, &image::load(&folders.photo(view)).unwrap(), 0);
        assert!(score > 45.0, "{score}");
    }
    for path in ["circle:2", "spiral:2"] {
        run(&mut folders.render(&["--path", path, "-o", &folders.out("frames")]));
    }
}

#[test]
fn layers_and_width_options_are_applied() {
    let folders = Folders::new();
    let picture = folders.out("a.png");
    for (how, layers) in [
        (["--layers", "guided:3"], 3),
        (["--layers", "planes:5"], 5),
        (["--layers", "surface:2"], 2),
        (["--layers", "list:0.25"], 1),
        (["--layers", "list:0.4,0.2,0"], 3),
    ] {
        let report = json(&mut folders.render(&[&["--target", "2", "-o", &picture], &how[..]].concat()));
        assert_eq!(report["targets"][0]["layers"], layers, "{how:?}");
    }
    let report = json(&mut folders.render(&["--target", "2", "--width", "32", "-o", &picture]));
    assert_eq!((&report["targets"][0]["width"], &report["targets"][0]["height"]), (&32.into(), &24.into()));
    assert!(report["notes"][0].as_str().unwrap().contains("scaled down"), "{report}");
}

#[test]
fn default_layers_are_those_that_the_model_recommends() {
    let folders = Folders::new();
    for (layers, count) in [("planes:3", 3), ("guided:4", 4)] {
        let model = folders.recommending(layers);
        let arguments = ["--target", "2", "--model", &model, "-o", &folders.out("a.png")];
        let report = json(&mut folders.liveview("render", &arguments));
        assert_eq!((report["layers"].as_str(), report["targets"][0]["layers"].as_u64()), (Some(layers), Some(count)));
    }
}

#[test]
fn videos_are_written_by_ffmpeg() {
    let folders = Folders::new();
    let copies = "for last; do :; done; /bin/cat > \"$last\"";
    for name in ["a.mp4", "a.gif"] {
        let arguments = ["--path", "line:3", "-o", &folders.out(name)];
        folders
            .assert_refused(folders.render(&arguments).env("PATH", "/nowhere"), &[name, "ffmpeg", "not on the PATH"]);
        folders.assert_refused(
            folders.render(&arguments).env("PATH", folders.ffmpeg("echo no such codec >&2; exit 1")),
            &[name, "no such codec", "exit status: 1"],
        );
        let report = json(folders.render(&arguments).env("PATH", folders.ffmpeg(copies)));
        assert_eq!((report["video"].as_str(), folders.written()), (Some(arguments[3]), vec![name.to_owned()]));
        assert_eq!(fs::read(arguments[3]).unwrap().len() as u32, 3 * 3 * WIDTH * HEIGHT);
        fs::remove_file(arguments[3]).unwrap();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn memory_does_not_grow_with_the_number_of_layers() {
    let folders = Folders::new();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/scenes/workshop");
    let peak = |planes: &str| {
        let mut command = assert_cmd::Command::new(env!("CARGO_BIN_EXE_liveview"));
        command.args(["render", scene, "--target", "target_0", "--width", "252", "--layers", planes]);
        json(command.args(["-o", &folders.out("a.png")]))["peak_memory_bytes"].as_f64().unwrap()
    };
    let (few, many) = (peak("planes:8"), peak("planes:64"));
    assert!(many <= 1.2 * few, "{few} bytes at 8 planes, {many} at 64");
}

#[test]
fn explain_reports_ranges_times_and_skipped_layers() {
    let folders = Folders::new();
    let [picture, why] = ["a.png", "why.png"].map(|name| folders.out(name));
    let report = json(&mut folders.render(&["--target", "2", "-o", &picture, "--explain", &why]));
    let explained = &report["explanation"];
    let shares: f64 = explained["time_shares"].as_object().unwrap().values().map(|share| share.as_f64().unwrap()).sum();
    assert!((shares - 1.0).abs() < 1e-9, "{explained}");
    assert_eq!(image::read_size(why.as_ref()).unwrap(), Size::new(2 * WIDTH as usize + 4, HEIGHT as usize));

    // At depth 0.01 the parallax is 600 pixels: no photo covers the first three of these planes.
    let near = ["--target", "2", "-o", &picture, "--near", "0.01", "--layers", "planes:4", "--explain", &why];
    let report = json(&mut folders.render(&near));
    assert_eq!(report["explanation"]["uncovered_layers"], 3, "as `inspect` says: {report}");

    let text = run(&mut folders.render(&["--target", "2", "-o", &picture, "--layers", "planes:5", "--explain", &why]));
    assert!(text.contains("5 planes from ") && text.contains(", of which"), "{text}");
    assert_eq!(image::read_size(why.as_ref()).unwrap(), Size::new(WIDTH as usize, HEIGHT as usize));
    fs::remove_dir_all(folders.out("")).unwrap();
    fs::create_dir(folders.out("")).unwrap();
    let refused = |arguments: &[&str], words: &[&str]| folders.assert_refused(&mut folders.render(arguments), words);
    refused(
        &["--path", "line:2", "-o", &folders.out("many"), "--explain", &why],
        &["--explain", "2 pictures", "one target"],
    );
}

#[test]
fn explain_reports_gains_and_sharpening_unless_they_are_disabled() {
    let folders = Folders::new();
    let [picture, why] = ["a.png", "why.png"].map(|name| folders.out(name));
    let arguments = ["--target", "2", "-o", &picture, "--layers", "surface:2", "--explain", &why];
    let report = json(&mut folders.render(&arguments));
    assert_eq!((&report["layers"], &report["targets"][0]["layers"]), (&"surface:2".into(), &2.into()));
    let explained = &report["explanation"];
    assert!(explained["surface"]["guessed_share"].as_f64().unwrap() < 0.5, "{explained}");
    assert_eq!(explained["gains"].as_array().unwrap().len(), 4, "{explained}");
    assert_eq!(image::read_size(why.as_ref()).unwrap(), Size::new(2 * WIDTH as usize + 4, HEIGHT as usize));
    let kept = json(folders.render(&arguments).arg("--keep-exposure"));
    let gains = kept["explanation"]["gains"].as_array().unwrap().clone();
    assert!(gains.iter().flat_map(|view| view.as_array().unwrap()).all(|gain| gain == 1.0), "{gains:?}");
    let sharpening = |report: &serde_json::Value| report["explanation"]["sharpening"].as_array().unwrap().clone();
    let kept = json(folders.render(&arguments).arg("--keep-sharpness"));
    assert!(sharpening(&kept).iter().all(|amount| amount == 0.0), "{kept}");
    assert!(sharpening(&report).iter().any(|amount| amount.as_f64().unwrap() > 0.0), "{report}");
    // Planes use the same, or none of the photos' depth.
    let arguments = arguments.map(|argument| if argument == "surface:2" { "planes:4" } else { argument });
    let planes = json(&mut folders.render(&arguments));
    assert_eq!(planes["explanation"]["gains"], explained["gains"]);
    assert_eq!(planes["explanation"]["sharpening"], explained["sharpening"]);
    let kept = json(folders.render(&arguments).args(["--keep-exposure", "--keep-sharpness"]));
    assert!(kept["explanation"]["gains"].is_null(), "{kept}");
    // They lie where the target sees something, unless the range is given or the photos' depth is not used.
    let depth =
        |report: &serde_json::Value| [0, 1].map(|end| report["explanation"]["planes_depth"][end].as_f64().unwrap());
    let ([near, far], whole) = (depth(&planes), [2.0, 8.0]);
    assert!(near > 2.1 && far <= 8.0 && near < far, "{planes}");
    assert_eq!(depth(&kept), whole);
    assert_eq!(depth(&json(folders.render(&arguments).args(["--near", "2", "--far", "8"]))), whole);
}

#[test]
fn quality_options_select_layers() {
    let folders = Folders::new();
    let layers = |arguments: &[&str]| {
        let report = json(folders.render(&["--target", "2", "-o", &folders.out("a.png")]).args(arguments));
        report["layers"].as_str().unwrap().to_owned()
    };
    assert_eq!(layers(&["--quality", "fast"]), "guided:1");
    assert_eq!(layers(&["--quality", "surface"]), "surface:3");
    assert_eq!(layers(&["--quality", "planes"]), "select:16/64");
    assert_eq!(layers(&["--layers", "guided:3"]), "guided:3");
    let picture = |arguments: &[&str]| {
        assert_eq!(layers(arguments), "select:16/64");
        fs::read(folders.out("a.png")).unwrap()
    };
    let paper = picture(&["--quality", "paper"]);
    let by_options = ["--layers", "select:16/64", "--alpha", "independent", "--keep-exposure", "--keep-sharpness"];
    assert!(paper == picture(&by_options) && paper != picture(&["--quality", "planes"]));
}
