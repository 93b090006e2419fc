//! The folder of a scene: what lies in it, and what would be read from it.

use std::cell::OnceCell;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use liveview::Scene;

use crate::args::output::has_ending;

/// Folders that some format, or a rig, is read from.
const FOLDERS: [&str; 6] = ["images", "images_2", "images_4", "images_8", "frames", "videos"];
/// Files that make a folder a scene.
const POSES: [&str; 9] = [
    "transforms.json",
    "poses_bounds.npy",
    "models.json",
    "cameras.txt",
    "cameras.bin",
    "images.txt",
    "images.bin",
    "points3D.txt",
    "points3D.bin",
];
/// What is read as a photo, or as a camera of a rig.
const PICTURES: [&str; 10] = ["png", "jpg", "jpeg", "mp4", "m4v", "mov", "mkv", "avi", "webm", "y4m"];
/// Links nested deeper than this are not looked for.
const MAX_DEPTH: usize = 4;

/// A scene's folder.
#[derive(Debug)]
pub(super) struct SceneFolder {
    root: PathBuf,
    /// Folders of which all is read.
    photos: BTreeSet<PathBuf>,
    /// Folders of a rig's cameras: pictures below would be another one.
    cameras: BTreeSet<PathBuf>,
    /// Whether photos lie beside the poses.
    flat: bool,
    /// Where links in the folder lead.
    linked: OnceCell<Vec<PathBuf>>,
}

impl SceneFolder {
    pub(super) fn new(scene: &Scene) -> Self {
        let real = |path: PathBuf| path.canonicalize().unwrap_or(path);
        let named: BTreeSet<&Path> = scene.views.iter().filter_map(|view| view.image_path().parent()).collect();
        // A rig has a folder for each camera; a scene may have one of photos to learn from and one to test on.
        let rig = named.len() > 1 && named.len() == scene.views.len();
        let cameras = named.iter().filter(|_| rig).filter_map(|folder| folder.parent());
        let cameras = cameras.filter(|folder| folder.starts_with(&scene.root));
        // Below the folder's real path: those that do not exist cannot be resolved.
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

    /// Whether a file that exists lies in the folder, or where a link in it leads.
    pub(super) fn holds(&self, real: &Path) -> bool {
        let find = || {
            let mut found = Vec::new();
            links(&self.root, MAX_DEPTH, &mut found);
            found
        };
        real.starts_with(&self.root) || self.linked.get_or_init(find).iter().any(|target| real.starts_with(target))
    }

    /// What of the scene a file of this name would be taken for, if it would.
    pub(super) fn reads(&self, real: &Path) -> Option<&'static str> {
        let below = |folder: &PathBuf| real.starts_with(folder);
        if below(&self.root) && POSES.iter().any(|poses| real.file_name() == Some(poses.as_ref())) {
            return Some("the poses");
        }
        let beside = self.flat && real.parent() == Some(&self.root) || self.cameras.iter().any(below);
        let read = self.photos.iter().any(below) || beside && has_ending(real, &PICTURES);
        read.then_some("a photo or a camera")
    }
}

/// Adds the targets of the links below a folder.
fn links(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        match entry.file_type() {
            Ok(kind) if kind.is_symlink() => found.extend(entry.path().canonicalize()),
            Ok(kind) if kind.is_dir() && depth > 0 => links(&entry.path(), depth - 1, found),
            _ => {}
        }
    }
}
