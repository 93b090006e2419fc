//! The scene folder: which files it holds, and which files in it would be read as part of the
//! scene.

use std::cell::OnceCell;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use liveview_synthesizer::Scene;

use super::own;
use crate::args::output::has_extension;

/// Folders from which photos or the cameras of a rig are read.
const FOLDERS: [&str; 6] = ["images", "images_2", "images_4", "images_8", "frames", "videos"];
/// Names of pose files.
const POSES: [&str; 10] = [
    "transforms.json",
    "transforms_train.json",
    "poses_bounds.npy",
    "models.json",
    "cameras.txt",
    "cameras.bin",
    "images.txt",
    "images.bin",
    "points3D.txt",
    "points3D.bin",
];
/// Extensions of files that are read as a photo, or as a camera of a rig.
const PICTURES: [&str; 10] = ["png", "jpg", "jpeg", "mp4", "m4v", "mov", "mkv", "avi", "webm", "y4m"];
/// Levels of nested folders that are searched for links.
const MAX_DEPTH: usize = 4;

/// A scene folder.
#[derive(Debug)]
pub(super) struct SceneFolder {
    root: PathBuf,
    /// Folders of photos; every file in them would be read.
    photos: BTreeSet<PathBuf>,
    /// Folders that hold a rig's cameras; a new folder of pictures would be another camera.
    cameras: BTreeSet<PathBuf>,
    /// Whether photos and poses are in the same folder.
    flat: bool,
    /// Targets of the links in the folder.
    linked: OnceCell<Vec<PathBuf>>,
}

impl SceneFolder {
    pub(super) fn new(scene: &Scene) -> Self {
        let real = |path: PathBuf| path.canonicalize().unwrap_or(path);
        let named: BTreeSet<&Path> = scene.views.iter().filter_map(|view| view.image_path().parent()).collect();
        // A rig has a folder for each camera; other scenes may have a few, such as training and
        // test photos.
        let rig = named.len() > 1 && named.len() == scene.views.len();
        let cameras = named.iter().filter(|_| rig).filter_map(|folder| folder.parent());
        let cameras = cameras.filter(|folder| folder.starts_with(&scene.root));
        // Joined to the resolved root, since folders that do not exist cannot be resolved.
        let root = real(scene.root.clone());
        let usual = FOLDERS.map(|folder| root.join(folder));
        let photos = named.iter().filter(|&&folder| folder != scene.root).map(|folder| folder.to_path_buf());
        Self {
            photos: photos.chain(usual).map(real).collect(),
            cameras: cameras.map(|folder| real(folder.to_owned())).collect(),
            flat: named.contains(&*scene.root),
            root,
            linked: OnceCell::new(),
        }
    }

    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// Whether an existing file is in the folder, or in the target of a link in it.
    pub(super) fn holds(&self, real: &Path) -> bool {
        let find = || {
            let mut found = Vec::new();
            links(&self.root, MAX_DEPTH, &mut found);
            found
        };
        real.starts_with(&self.root) || self.linked.get_or_init(find).iter().any(|target| real.starts_with(target))
    }

    /// The part of the scene that a file of this name would be read as, if any.
    pub(super) fn reads(&self, real: &Path) -> Option<&'static str> {
        let below = |folder: &PathBuf| real.starts_with(folder);
        if below(&self.root) && POSES.iter().any(|poses| real.file_name() == Some(poses.as_ref())) {
            return Some("the poses");
        }
        let beside = self.flat && real.parent() == Some(&self.root) || self.cameras.iter().any(below);
        let read = self.photos.iter().any(below) || beside && has_extension(real, &PICTURES);
        read.then_some("a photo or a camera")
    }

    /// Whether a folder is the scene's own, or holds poses of it.
    pub(super) fn has_inputs_in(&self, real: &Path) -> bool {
        real == self.root || real.starts_with(&self.root) && POSES.iter().any(|poses| real.join(poses).exists())
    }

    /// Whether a folder is part of the scene: its files would be read, or it holds files other than
    /// arrays (.npz) that the program did not write.
    pub(super) fn is_its_own(&self, real: &Path) -> bool {
        let other = |entry: &fs::DirEntry| !has_extension(&entry.path(), &["npz"]) && !own::is_own(&entry.path());
        self.reads(&real.join("depth.npz")).is_some()
            || fs::read_dir(real).into_iter().flatten().flatten().any(|entry| other(&entry))
    }
}

/// Adds the targets of the links in a folder and its subfolders.
fn links(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        match entry.file_type() {
            Ok(kind) if kind.is_symlink() => found.extend(entry.path().canonicalize()),
            Ok(kind) if kind.is_dir() && depth > 0 => links(&entry.path(), depth - 1, found),
            _ => {}
        }
    }
}
