//! Random scene folders: one of four formats, with one to three faults.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::scene_common::{Colmap, LLFF_ROW, picture, poses_bounds, write};
use crate::{faults_of_photos, faults_of_poses};

/// Number of photos of a scene.
const VIEWS: usize = 5;

const NAMES: [&str; VIEWS] = ["0.png", "1.png", "2.png", "3.png", "4.png"];

/// A scene to be rendered.
pub(crate) struct Hostile {
    /// Holds the folders `scene`, and `out` for the output.
    pub(crate) root: TempDir,
    /// The option that says what to render.
    pub(crate) target: [&'static str; 2],
    /// Descriptions of the faults, for failure messages.
    pub(crate) faults: Vec<String>,
}

impl Hostile {
    pub(crate) fn new(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let root = tempfile::tempdir().unwrap();
        let scene = root.path().join("scene");
        fs::create_dir(root.path().join("out")).unwrap();
        NAMES.iter().for_each(|name| picture(&scene.join("images").join(name), 64, 48));
        let format = *random.of(&[Format::Transforms, Format::Transforms, Format::Text, Format::Binary, Format::Llff]);
        format.write(&scene);
        let target = *random.of(&[["--target", "2.png"], ["--target", "2"], ["--path", "line:1"], ["--heldout", "9"]]);
        let mut faults = vec![format!("{format:?}")];
        for _ in 0..1 + random.below(3) {
            let photos = random.below(2) == 0;
            let apply = if photos { faults_of_photos::apply } else { faults_of_poses::apply };
            faults.push(apply(&scene, format, &mut random));
        }
        Self { root, target, faults }
    }
}

/// The format of the poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Format {
    Transforms,
    Text,
    Binary,
    Llff,
}

impl Format {
    pub(crate) const ALL: [Self; 4] = [Self::Transforms, Self::Text, Self::Binary, Self::Llff];

    /// Writes the poses of the five photos.
    pub(crate) fn write(self, scene: &Path) {
        // An earlier fault may have put something else in its place.
        for path in self.files().iter().map(|file| scene.join(file)).filter(|path| !path.is_file()) {
            let _ = fs::remove_file(&path).or_else(|_| fs::remove_dir_all(&path));
        }
        let colmap = Colmap { camera: Colmap::PINHOLE, names: &NAMES };
        match self {
            Self::Transforms => write(&scene.join("transforms.json"), transforms().to_string()),
            Self::Text => colmap.write_text(&scene.join("sparse/0")),
            Self::Binary => colmap.write_binary(&scene.join("sparse/0")),
            Self::Llff => poses_bounds(&scene.join("poses_bounds.npy"), &llff()),
        }
    }

    /// The files that hold the poses.
    pub(crate) fn files(self) -> &'static [&'static str] {
        match self {
            Self::Transforms => &["transforms.json"],
            Self::Text => &["sparse/0/cameras.txt", "sparse/0/images.txt", "sparse/0/points3D.txt"],
            Self::Binary => &["sparse/0/cameras.bin", "sparse/0/images.bin", "sparse/0/points3D.bin"],
            Self::Llff => &["poses_bounds.npy"],
        }
    }
}

/// A `transforms.json` of five cameras in a row.
pub(crate) fn transforms() -> Value {
    let frame = |(view, name): (usize, &&str)| {
        let x = 0.1 * view as f64;
        let pose = json!([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
        json!({ "file_path": format!("images/{name}"), "transform_matrix": pose })
    };
    let frames: Vec<_> = NAMES.iter().enumerate().map(frame).collect();
    json!({ "fl_x": 50, "fl_y": 60, "cx": 32, "cy": 24, "w": 64, "h": 48, "near": 2, "far": 9, "frames": frames })
}

/// Rows of a `poses_bounds.npy` of five cameras in a row.
pub(crate) fn llff() -> [[f64; 17]; VIEWS] {
    std::array::from_fn(|view| {
        let mut row = LLFF_ROW;
        row[3] += 0.1 * view as f64;
        row
    })
}

/// The path of a random photo of the scene.
pub(crate) fn random_photo(scene: &Path, random: &mut Random) -> PathBuf {
    scene.join("images").join(random.of(&NAMES))
}

/// Random choices from a seed (splitmix64).
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15))
    }

    pub(crate) fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) % count as u64) as usize
    }

    pub(crate) fn of<'a, T>(&mut self, choices: &'a [T]) -> &'a T {
        &choices[self.below(choices.len())]
    }
}
