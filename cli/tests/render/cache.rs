//! `--cache`: the depth of photos kept on disk saves time and changes no picture.

use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::process::{Command, Stdio};

use liveview_files::npy;
use serde_json::Value;

use crate::common::{Folders, HEIGHT, WIDTH, fixture, photo};

/// Renders view 2 with these arguments; returns the picture and stderr.
fn render(folders: &Folders, arguments: &[&str]) -> (Vec<u8>, String) {
    let picture = folders.scene().join("picture.png");
    let mut render = folders.render(&["--target", "2", "--layers", "surface:2", "-o", picture.to_str().unwrap()]);
    let output = render.args(arguments).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{stderr}");
    (fs::read(picture).unwrap(), stderr)
}

/// All written files by name, with their contents.
fn kept(folders: &Folders) -> BTreeMap<String, Vec<u8>> {
    folders.written().into_iter().map(|name| (name.clone(), fs::read(folders.out(&name)).unwrap())).collect()
}

/// The source of each photo's depth, as `liveview depth` reports it.
fn sources(folders: &Folders, arguments: &[&str]) -> Vec<String> {
    let depths = folders.scene().join("depths");
    let mut depth = folders.liveview("depth", arguments);
    depth.args(["--cache", &folders.out("kept"), "--json", "-o"]).arg(depths);
    let output = depth.output().unwrap();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    report["photos"].as_array().unwrap().iter().map(|photo| photo["source"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn pictures_are_equal_with_and_without_cache() {
    let folders = Folders::new();
    let cache = folders.out("a/kept");
    let (without, _) = render(&folders, &[]);
    let (cold, _) = render(&folders, &["--cache", &cache]);
    let files = kept(&folders);
    assert_eq!(files.len(), 4, "one for each photo that is not held out: {:?}", files.keys());
    let digest = |name: &str| name.strip_prefix("a/kept/")?.strip_suffix(".npz").map(str::to_owned);
    for name in files.keys() {
        let digest = digest(name).unwrap_or_else(|| panic!("{name}"));
        assert!(digest.len() == 64 && digest.bytes().all(|byte| byte.is_ascii_hexdigit()), "{name}");
    }
    // Files that are written again have new inodes.
    #[cfg(unix)]
    let inodes = || {
        use std::os::unix::fs::MetadataExt;
        files.keys().map(|name| fs::metadata(folders.out(name)).unwrap().ino()).collect::<Vec<_>>()
    };
    #[cfg(unix)]
    let before = inodes();
    let (warm, stderr) = render(&folders, &["--cache", &cache]);
    #[cfg(unix)]
    assert_eq!(inodes(), before);
    assert!(without == cold && cold == warm && stderr.is_empty() && kept(&folders) == files, "{stderr}");
}

#[test]
fn cached_disparity_equals_that_of_depth() {
    let folders = Folders::new();
    assert_eq!(sources(&folders, &["--photo", "1"]), ["searched"]);
    let written: ndarray::Array2<f32> = npy::read(&fs::read(folders.scene().join("depths/1.npy")).unwrap()).unwrap();
    let maps = folders.written().into_iter().map(|name| {
        let mut file = zip::ZipArchive::new(fs::File::open(folders.out(&name)).unwrap()).unwrap();
        let mut array = |name: &str| {
            let mut bytes = Vec::new();
            file.by_name(name).unwrap().read_to_end(&mut bytes).unwrap();
            bytes
        };
        let key: ndarray::Array1<u8> = npy::read(&array("key.npy")).unwrap();
        let digest: String = key.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(name, format!("kept/{digest}.npz"));
        npy::read(&array("disparity.npy")).unwrap()
    });
    let same = |map: &ndarray::Array2<f32>| {
        map.iter().zip(&written).all(|(kept, &written)| written == -1.0 || *kept == written)
    };
    assert_eq!(maps.filter(same).count(), 1);
}

#[test]
fn damaged_cache_file_is_reported_and_replaced() {
    let folders = Folders::new();
    let cache = folders.out("kept");
    let (picture, _) = render(&folders, &["--cache", &cache]);
    let files = kept(&folders);
    let damaged: Vec<Vec<u8>> = files.values().cloned().collect();
    let mut poisoned = damaged[3].clone();
    let last = poisoned.len() / 2;
    poisoned[last..last + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let damaged = [Vec::new(), damaged[1][..damaged[1].len() / 2].to_vec(), damaged[0].clone(), poisoned];
    for (name, bytes) in files.keys().zip(&damaged) {
        fs::write(folders.out(name), bytes).unwrap();
    }
    let (again, stderr) = render(&folders, &["--cache", &cache]);
    assert!(again == picture && kept(&folders) == files, "{stderr}");
    let words = ["no archive", "no archive", "key: of another depth", "disparity: Invalid checksum"];
    for (name, word) in files.keys().zip(words) {
        let line =
            stderr.lines().find(|line| line.contains(name.as_str())).unwrap_or_else(|| panic!("{name}: {stderr}"));
        assert!(line.starts_with("note: ") && line.contains(word) && line.contains("; expected "), "{word}: {stderr}");
        assert!(line.ends_with(": the depth is searched again"), "{stderr}");
    }
    assert_eq!(stderr.lines().count(), 4, "{stderr}");

    // A folder in place of the file: it can be neither read nor written.
    let name = files.keys().next().unwrap();
    fs::remove_file(folders.out(name)).unwrap();
    fs::create_dir_all(folders.out(name) + "/folder").unwrap();
    let (again, stderr) = render(&folders, &["--cache", &cache]);
    assert!(again == picture && stderr.lines().count() == 2, "{stderr}");
    assert!(stderr.contains("cannot be read: ") && stderr.contains(": the depth is not kept"), "{stderr}");
}

#[test]
fn cached_depth_does_not_depend_on_held_out_photos() {
    let folders = Folders::new();
    assert_eq!(sources(&folders, &["--target", "2"]), ["searched"; 4]);
    assert_eq!(sources(&folders, &["--target", "2"]), ["kept"; 4]);
    // A render that holds out the same photo uses the same files.
    let files = kept(&folders);
    render(&folders, &["--cache", &folders.out("kept")]);
    assert!(kept(&folders) == files);
    photo(&folders.photo(2), 7.0, WIDTH, HEIGHT);
    assert_eq!(sources(&folders, &["--target", "2"]), ["kept"; 4], "the held-out photo changed");
    assert_eq!(sources(&folders, &[]), ["searched"; 5], "it is not held out");
    assert_eq!(sources(&folders, &["--target", "1"]), ["searched"; 4], "another one is held out");
    assert_eq!(sources(&folders, &["--target", "2", "--far", "9"]), ["searched"; 4], "another range");
    assert_eq!(sources(&folders, &["--target", "2", "--width", "48"]), ["searched"; 4], "another size");
    photo(&folders.photo(3), 0.31, WIDTH, HEIGHT);
    assert_eq!(sources(&folders, &["--target", "2"]), ["searched"; 4], "a neighbour of all photos changed");
}

#[test]
fn cache_without_surface_layers_prints_a_note() {
    let folders = Folders::new();
    let (picture, cache) = (folders.out("a.png"), folders.out("kept"));
    let mut render = folders.render(&["--target", "2", "--layers", "guided:1", "-o", &picture, "--cache", &cache]);
    let output = render.output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(
        output.status.success() && stderr.contains("has no effect, guided:1 does not use the photos' depth"),
        "{stderr}"
    );
    assert_eq!(folders.written(), ["a.png"]);
}

#[test]
fn concurrent_runs_share_a_cache() {
    let folders = Folders::new();
    let (picture, _) = render(&folders, &[]);
    let cache = folders.out("kept");
    let runs: Vec<_> = (0..3).map(|run| folders.scene().join(format!("run{run}.png"))).collect();
    let started: Vec<_> = runs
        .iter()
        .map(|run| {
            let mut render = Command::new(env!("CARGO_BIN_EXE_liveview"));
            render.arg("render").arg(folders.scene()).args([
                "--target",
                "2",
                "--layers",
                "surface:2",
                "--cache",
                &cache,
            ]);
            render.args(["--model", &fixture("tiny_v4"), "-o"]).arg(run).stdout(Stdio::null()).stderr(Stdio::piped());
            render.spawn().unwrap()
        })
        .collect();
    for run in started {
        let output = run.wait_with_output().unwrap();
        assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    runs.iter().for_each(|run| assert!(fs::read(run).unwrap() == picture, "{}", run.display()));
    let names = folders.written();
    assert!(names.len() == 4 && names.iter().all(|name| name.ends_with(".npz")), "{names:?}");
}

#[test]
fn unwritable_cache_folder_is_an_error() {
    let folders = Folders::new();
    let taken = folders.scene().join("transforms.json").to_str().unwrap().to_owned();
    for folder in [taken.clone(), format!("{taken}/kept")] {
        let picture = folders.out("a.png");
        let arguments = ["--target", "2", "--layers", "surface:1", "-o", &picture, "--cache", &folder];
        folders.assert_refused(&mut folders.render(&arguments), &["--cache", "transforms.json", "cannot be written"]);
        let mut depth = folders.liveview("depth", &["-o", &folders.out("depth"), "--cache", &folder]);
        let output = depth.output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(
            output.status.code() == Some(2) && stderr.contains("--cache") && folders.written().is_empty(),
            "{stderr}"
        );
    }
}
