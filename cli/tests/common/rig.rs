//! A tiny camera rig, and a substitute for ffmpeg.

use std::fs;
use std::path::PathBuf;
use std::process::Output;

use assert_cmd::Command;
use serde_json::Value;

use super::{Folders, HEIGHT, WIDTH, fixture, photo};

/// Six cameras in a row in front of a wall, each a folder of frames.
pub(crate) struct Rig {
    pub(crate) folders: Folders,
}

impl Rig {
    pub(crate) fn new(frames: usize) -> Self {
        let rig = Self { folders: Folders::new() };
        fs::remove_dir_all(rig.path().join("images")).unwrap();
        for camera in 0..6 {
            fs::create_dir(rig.path().join(format!("cam{camera}"))).unwrap();
            for frame in 0..frames {
                rig.film(camera, frame, 0.0);
            }
        }
        rig.write_poses(6);
        rig
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.folders.scene()
    }

    pub(crate) fn frame(&self, camera: usize, frame: usize) -> PathBuf {
        self.path().join(format!("cam{camera}/{frame:03}.png"))
    }

    /// A frame of a wall that has moved sideways.
    pub(crate) fn film(&self, camera: usize, frame: usize, moved: f64) {
        photo(&self.frame(camera, frame), 0.1 * camera as f64 + moved, WIDTH, HEIGHT);
    }

    /// Replaces each camera's folder by a video file: pixmaps, which the substitute for ffmpeg
    /// copies.
    pub(crate) fn as_videos(&self, frames: &[usize; 6]) {
        for (camera, &frames) in frames.iter().enumerate() {
            let mut video = Vec::new();
            for frame in 0..frames {
                let picture = image::open(self.frame(camera, frame)).unwrap().into_rgb8();
                video.extend(format!("P6\n{WIDTH} {HEIGHT}\n255\n").bytes());
                video.extend(picture.as_raw());
            }
            fs::remove_dir_all(self.path().join(format!("cam{camera}"))).unwrap();
            fs::write(self.path().join(format!("cam{camera}.mp4")), video).unwrap();
        }
    }

    pub(crate) fn write_poses(&self, cameras: usize) {
        let frame = |camera: usize| {
            let x = 0.1 * camera as f64;
            format!(
                r#"{{"file_path": "cam{camera}/000.png", "transform_matrix": [[1, 0, 0, {x}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}}"#
            )
        };
        let frames = (0..cameras).map(frame).collect::<Vec<_>>().join(",\n");
        let head = r#""fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24, "w": 64, "h": 48, "near": 2, "far": 8"#;
        fs::write(self.path().join("transforms.json"), format!("{{{head}, \"frames\": [{frames}]}}")).unwrap();
    }

    pub(crate) fn video(&self, arguments: &[&str]) -> Command {
        let mut video = self.folders.liveview("video", arguments);
        video.args(["--model", &fixture("tiny_v4"), "--threads", "2"]);
        video
    }

    /// The report of a run that succeeds.
    pub(crate) fn report(&self, arguments: &[&str]) -> Value {
        let output = self.video(arguments).arg("--json").output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    }
}

/// A substitute for ffmpeg. It decodes a file of pixmaps as a video of 30 frames per second, and
/// encodes by copying its input. `script` runs first; when decoding, `$2` is the input file and
/// `$all` the arguments.
pub(crate) fn ffmpeg(folders: &Folders, script: &str) -> String {
    folders.ffmpeg(&format!(
        r#"all="$*"
for last; do :; done
if [ "$last" = - ]; then
    while [ "$1" != -i ]; do shift; done
fi
{script}
case "$last" in ?*:*) case "$last" in /*) ;; *) echo "$last: Protocol not found" >&2; exit 1;; esac;; esac
if [ "$last" = - ]; then
    case "$2" in /*) ;; *:*) echo "$2: Protocol not found" >&2; exit 1;; esac
    case "$all" in *yuv4mpegpipe*) echo YUV4MPEG2 F30:1; exit;; esac
    case "$all" in *framecrc*) echo '#tb 0: 1/30'; /bin/grep -a -x "64 48" "$2"; exit;; esac
    exec /bin/cat "$2"
fi
exec /bin/cat > "$last""#
    ))
}

/// The standard error of a program.
pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The report of a run that succeeds, and its standard error.
pub(crate) fn report(command: &mut Command) -> (Value, String) {
    let output = command.arg("--json").output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    (serde_json::from_slice(&output.stdout).unwrap(), stderr(&output))
}

/// A substitute for ffmpeg, for sources `test://CAMERA`: ten frames a second of the camera's photo. `script` runs first, with the
/// camera in `$camera`.
pub(crate) fn running(rig: &Rig, script: &str) -> String {
    for camera in 0..6 {
        let picture = image::open(rig.frame(camera, 0)).unwrap().into_rgb8();
        let pixmap = [format!("P6\n{WIDTH} {HEIGHT}\n255\n").as_bytes(), picture.as_raw()].concat();
        fs::write(rig.path().join(format!("{camera}.ppm")), pixmap).unwrap();
        fs::remove_dir_all(rig.path().join(format!("cam{camera}"))).unwrap();
    }
    let root = rig.path();
    let play = format!("while /bin/cat {}/$camera.ppm; do /bin/sleep 0.1; done", root.display());
    ffmpeg(&rig.folders, &format!("case \"$2\" in test://*) camera=${{2#test://}}\n{script}\n{play}; exit;; esac"))
}

/// Names the cameras' sources in `transforms.json`.
pub(crate) fn name_sources(rig: &Rig) {
    let file = rig.path().join("transforms.json");
    let text = (0..6).fold(fs::read_to_string(&file).unwrap(), |text, camera| {
        text.replace(
            &format!("\"file_path\": \"cam{camera}/"),
            &format!("\"source\": \"test://{camera}\", \"file_path\": \"cam{camera}/"),
        )
    });
    fs::write(file, text).unwrap();
}
