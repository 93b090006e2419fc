//! A tiny scene and the `liveview` command, for the command-line tests.
#![allow(dead_code, reason = "each test file uses its own part")]

pub(crate) mod rig;
pub(crate) mod viewer;

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::thread::sleep;
use std::time::Duration;

use assert_cmd::Command;
use tempfile::TempDir;

/// Waits until `is_ready`, which a program is while it runs.
pub(crate) fn wait_until(running: &mut Child, is_ready: impl Fn() -> bool) {
    while !is_ready() {
        assert!(running.try_wait().unwrap().is_none(), "it ended before that");
        sleep(Duration::from_millis(1));
    }
}

/// An ffmpeg that copies its input to its last argument, or to standard output for `-`.
pub(crate) const COPIES: &str = "for last; do :; done; [ \"$last\" = - ] || exec > \"$last\"; exec /bin/cat";

pub(crate) const WIDTH: u32 = 64;
pub(crate) const HEIGHT: u32 = 48;

/// Five photos in a row, 0.1 apart, of a wall at depth 4, and an empty folder for what is written.
pub(crate) struct Folders {
    root: TempDir,
}

impl Folders {
    pub(crate) fn new() -> Self {
        let root = tempfile::tempdir().unwrap();
        fs::create_dir_all(root.path().join("scene/images")).unwrap();
        fs::create_dir(root.path().join("out")).unwrap();
        for view in 0..5 {
            photo(&root.path().join(format!("scene/images/{view}.png")), 0.1 * f64::from(view), WIDTH, HEIGHT);
        }
        let folders = Self { root };
        folders.write_scene(5, "", "");
        folders
    }

    /// `transforms.json` of the first `views` photos; `from` and `to` replace a piece of its text,
    /// wherever it stands.
    pub(crate) fn write_scene(&self, views: usize, from: &str, to: &str) {
        let frame = |view: usize| {
            let x = 0.1 * view as f64;
            format!(
                r#"{{"file_path": "images/{view}.png", "transform_matrix": [[1, 0, 0, {x}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}}"#
            )
        };
        let frames = (0..views).map(frame).collect::<Vec<_>>().join(",\n");
        let head = r#""fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24, "w": 64, "h": 48, "near": 2, "far": 8"#;
        let text = format!("{{{head}, \"frames\": [\n{frames}\n]}}");
        assert!(text.contains(from), "{from} is not in {text}");
        fs::write(self.scene().join("transforms.json"), text.replace(from, to)).unwrap();
    }

    /// As `write_scene`, without a depth range, and with all cameras in one place: there is no range
    /// to be found.
    pub(crate) fn write_scene_in_one_place(&self, views: usize) {
        self.write_scene(views, ", \"near\": 2, \"far\": 8", "");
        let poses = self.scene().join("transforms.json");
        let text = fs::read_to_string(&poses).unwrap();
        let moved =
            |text: String, view: usize| text.replace(&format!("[[1, 0, 0, {}]", 0.1 * view as f64), "[[1, 0, 0, 0]");
        fs::write(&poses, (0..views).fold(text, moved)).unwrap();
    }

    pub(crate) fn scene(&self) -> PathBuf {
        self.root.path().join("scene")
    }

    pub(crate) fn photo(&self, view: usize) -> PathBuf {
        self.scene().join(format!("images/{view}.png"))
    }

    /// A path in the folder for what is written.
    pub(crate) fn out(&self, name: &str) -> String {
        self.root.path().join("out").join(name).to_str().unwrap().to_owned()
    }

    /// All that was written, hidden and temporary files too.
    pub(crate) fn written(&self) -> Vec<String> {
        let mut names = Vec::new();
        list(&self.root.path().join("out"), "", &mut names);
        names.sort();
        names
    }

    /// `liveview COMMAND scene ARGUMENTS`.
    pub(crate) fn liveview(&self, command: &str, arguments: &[&str]) -> Command {
        let mut liveview = Command::new(env!("CARGO_BIN_EXE_liveview"));
        liveview.arg(command).arg(self.scene()).args(arguments);
        liveview
    }

    /// `liveview render scene ARGUMENTS` with the tiny model.
    pub(crate) fn render(&self, arguments: &[&str]) -> Command {
        let mut render = self.liveview("render", arguments);
        render.arg("--model").arg(fixture("tiny_v4"));
        render
    }

    /// The tiny model, its card recommending other layers, named in as many letters as "guided:2".
    pub(crate) fn recommending(&self, layers: &str) -> String {
        let own = b"guided:2";
        let mut model = fs::read(fixture("tiny_v4")).unwrap();
        let at = model.windows(own.len()).position(|text| text == own).expect("what the fixture recommends");
        model[at..at + own.len()].copy_from_slice(layers.as_bytes());
        let path = self.scene().join("recommending.onnx");
        fs::write(&path, model).unwrap();
        path.to_str().unwrap().to_owned()
    }

    /// A folder to be the PATH, with an `ffmpeg` that is this shell script. Its last argument is
    /// the file to write. The frames of a file under a temporary name are counted as raw pixels of
    /// 64x48.
    pub(crate) fn ffmpeg(&self, script: &str) -> String {
        let folder = self.scene().join("bin");
        fs::create_dir_all(&folder).unwrap();
        let count = "case \"$*\" in *.liveview-tmp-*framecrc*)\n\
            while [ \"$1\" != -i ]; do shift; done; exec /usr/bin/od -An -v -t x1 -w9216 \"$2\";; esac";
        fs::write(folder.join("ffmpeg"), format!("#!/bin/sh\n{count}\n{script}\n")).unwrap();
        fs::set_permissions(folder.join("ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
        folder.to_str().unwrap().to_owned()
    }

    /// Asserts that a command is refused with exit code 2, says all these words in one `error:`,
    /// and leaves nothing behind.
    pub(crate) fn assert_refused(&self, command: &mut Command, words: &[&str]) {
        let output = command.output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert_eq!(stderr.lines().filter(|line| line.starts_with("error: ")).count(), 1, "{stderr}");
        for word in words {
            assert!(stderr.contains(word), "\"{word}\" is missing in: {stderr}");
        }
        assert!(!stderr.contains("panicked") && !stderr.contains("--help"), "{stderr}");
        assert_eq!(output.stdout, b"", "nothing on stdout");
        assert_eq!(self.written(), Vec::<String>::new(), "nothing written");
    }
}

/// One of the models that tests/fixtures/make_models.py writes.
pub(crate) fn fixture(name: &str) -> String {
    format!("{}/../tests/fixtures/{name}.onnx", env!("CARGO_MANIFEST_DIR"))
}

/// A wall at depth 4 with a smooth pattern, seen from `x` by a camera of focal length 60.
pub(crate) fn photo(path: &Path, x: f64, width: u32, height: u32) {
    let picture = image::RgbImage::from_fn(width, height, |column, row| {
        let wall_x = x + 4.0 / 60.0 * (f64::from(column) + 0.5 - 0.5 * f64::from(width));
        let wall_y = 4.0 / 60.0 * (f64::from(row) + 0.5 - 0.5 * f64::from(height));
        let wave = |f: f64, g: f64| (127.5 + 120.0 * (f * wall_x + 1.0).sin() * (g * wall_y + 0.5).cos()) as u8;
        image::Rgb([wave(9.0, 3.0), wave(4.0, 8.0), wave(6.0, 6.0)])
    });
    picture.save(path).unwrap();
}

fn list(folder: &Path, prefix: &str, names: &mut Vec<String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = format!("{prefix}{}", path.file_name().unwrap().to_str().unwrap());
        if path.is_dir() {
            list(&path, &format!("{name}/"), names);
        } else {
            names.push(name);
        }
    }
}
