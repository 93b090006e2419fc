//! `render --frames`: shares of a path have the pictures of the whole path.

use std::collections::BTreeMap;
use std::fs;

use crate::common::{COPIES, Folders, fixture};

/// The pictures of a folder by name.
fn pictures(folder: &str) -> BTreeMap<String, Vec<u8>> {
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let pictures = files.filter(|file| file.extension().is_some_and(|extension| extension == "png"));
    pictures.map(|file| (file.file_name().unwrap().to_str().unwrap().to_owned(), fs::read(file).unwrap())).collect()
}

/// Of planes, the whole path decides the range; of selected ones, the first frame decides the planes.
#[test]
fn shares_of_a_path_have_the_pictures_of_the_whole_path() {
    let model = fixture("tiny_v4");
    for options in [
        &["--network", "none", "--layers", "surface:1"][..],
        &["--network", "none", "--layers", "planes:6"],
        &["--model", &model, "--layers", "guided:2"],
        &["--model", &model, "--layers", "select:2/8"],
    ] {
        let folders = Folders::new();
        // Without a given range, planes lie over what a single picture shows.
        folders.write_scene(5, ", \"near\": 2, \"far\": 8", "");
        let (whole, shares) = (folders.out("whole"), folders.out("shares"));
        let render = |more: &[&str]| {
            let depth = format!("{}_depth", more[1]);
            let path = ["--path", "circle:6", "--depth", &depth];
            let output = folders.liveview("render", &[&path, options, more].concat()).output().unwrap();
            let stderr = String::from_utf8(output.stderr).unwrap();
            assert!(output.status.success(), "{options:?} {more:?}: {stderr}");
            (String::from_utf8(output.stdout).unwrap(), stderr)
        };
        render(&["-o", &whole]);
        for frames in ["1:2", "4:6", "2:4", "0:1"] {
            let (text, _) = render(&["-o", &shares, "--frames", frames]);
            let (start, end) = frames.split_once(':').unwrap();
            assert!(text.contains(&format!("frames  {start} up to but without {end}, of 6 of the path")), "{text}");
        }
        for (kind, files) in [("", 6), ("_depth", 2 * 6)] {
            let [expected, found] = [&whole, &shares].map(|folder| pictures(&format!("{folder}{kind}")));
            assert_eq!(expected.len(), files, "{options:?}: {:?}", expected.keys());
            assert!(expected == found, "{options:?}: {:?}", found.keys());
        }
        let expected = pictures(&whole);
        assert!(expected["frame_0000.png"] != expected["frame_0003.png"], "frames differ from one another");
    }
}

#[test]
fn share_can_be_a_video() {
    let folders = Folders::new();
    let film = folders.out("a.mp4");
    let share = ["--path", "line:6", "--network", "none", "--frames", "2:5", "-o", &film];
    let ffmpeg = folders.ffmpeg(COPIES);
    folders.liveview("render", &share).env("PATH", ffmpeg).assert().success();
    assert_eq!(fs::metadata(&film).unwrap().len(), 3 * 3 * 64 * 48);
}

#[test]
fn ranges_outside_the_path_are_refused() {
    let folders = Folders::new();
    let out = folders.out("frames");
    let refused = |targets: &[&str], words: &[&str]| {
        let more = ["--network", "none", "-o", &out];
        folders.assert_refused(&mut folders.liveview("render", &[targets, &more].concat()), words);
    };
    for wrong in ["3", "3:3", "4:3", "-1:3", "a:b", "1:2:3", ""] {
        let frames = format!("--frames={wrong}");
        refused(&["--path", "line:6", &frames], &["--frames", "expected A:B, A: or :B with whole numbers, A below B"]);
    }
    refused(&["--path", "line:6", "--frames", "4:7"], &["--frames 4:7", "the path has 6 frames", "expected B up to 6"]);
    refused(&["--target", "2", "--frames", "0:1"], &["--frames", "cannot be used with", "--target"]);
}
