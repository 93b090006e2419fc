//! Checks, before any work, that no output overwrites an input of the command, another output, a
//! file of the scene folder, or JSON that the program did not write. Paths are compared after resolving links and `..`.

use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};
use std::{fs, io};

use anyhow::{Result, anyhow, bail};
use liveview::image::is_tagged;
use liveview_files::atomic::{AtomicFile, is_special};
use liveview_files::bounded;
use liveview_synthesizer::Scene;
use serde_json::Value;

use crate::args::{has_extension, refuse_stdout};

/// The output files of a command.
#[derive(Debug)]
pub(crate) struct OutputPlan {
    /// The scene that is read.
    scene: SceneFolder,
    /// Descriptions of the inputs, for messages.
    inputs: HashMap<Identity, String>,
    /// The planned files, by their resolved paths: option and path as given, for messages.
    planned: HashMap<PathBuf, String>,
    /// Folders with an unknown number of frames: all `.png` with this prefix are planned. Option
    /// and path as given.
    frames: Vec<(PathBuf, &'static str, String)>,
    /// The planned files: option and path as given, and the path.
    files: Vec<(String, PathBuf)>,
}

impl OutputPlan {
    /// An empty plan of a command that reads this scene.
    pub(crate) fn new(scene: &Scene) -> Self {
        let photos = scene.views.iter().map(|view| view.image_path());
        let photo = |path: &Path| Some((Identity::of(path).ok()?, format!("a photo of the scene, {}", path.display())));
        Self {
            scene: SceneFolder::new(scene),
            inputs: photos.filter_map(photo).collect(),
            planned: HashMap::new(),
            frames: Vec::new(),
            files: Vec::new(),
        }
    }

    /// Protects another input file, if one is given.
    pub(crate) fn protect(&mut self, option: &str, file: Option<&Path>) {
        let Some(file) = file else { return };
        if let Ok(identity) = Identity::of(file) {
            self.inputs.insert(identity, format!("{option} {}", file.display()));
        }
    }

    /// Adds a file that will be written.
    ///
    /// # Errors
    ///
    /// If it would overwrite an input, another output, or a file of the scene or JSON that the
    /// program did not write; if it would be read as part of the scene; or if it cannot be a file.
    pub(crate) fn file(&mut self, option: &str, file: &Path) -> Result<()> {
        self.add(option, file, false)
    }

    /// Adds a file whose name the program chose, such as that of a report.
    ///
    /// # Errors
    ///
    /// As [`Self::file`], but outside the scene any JSON of that name is replaced.
    pub(crate) fn named_file(&mut self, option: &str, file: &Path) -> Result<()> {
        self.add(option, file, true)
    }

    /// `by_name`: a name that the program chose, under which an earlier run may have left a damaged file.
    fn add(&mut self, option: &str, file: &Path, by_name: bool) -> Result<()> {
        let shown = format!("{option} {}", file.display());
        refuse_stdout(option, file)?;
        let refused = |why: String| anyhow!("{shown}: cannot be written: {why}");
        let folder = file.parent().unwrap_or(Path::new(""));
        if folder.exists() && !folder.is_dir() {
            return Err(refused(format!("{} is a file; expected a folder", folder.display())));
        }
        if file.is_dir() {
            return Err(refused("it is a folder; expected a file or a new name".to_owned()));
        }
        let real = resolved(file).map_err(|error| refused(error.to_string()))?;
        let name = real.file_name().unwrap_or_default().to_string_lossy();
        let within = |(folder, prefix, _): &&(PathBuf, &str, _)| {
            real.parent() == Some(folder) && name.starts_with(prefix) && name.ends_with(".png")
        };
        let other = self.frames.iter().find(within).map(|(.., shown)| shown);
        if let Some(other) = other.or(self.planned.get(&real)) {
            bail!("{shown}: {other} is the same file; expected different files");
        }
        if !is_special(file) {
            self.check(&shown, file, &real, by_name)?;
        }
        self.planned.insert(real, shown.clone());
        self.files.push((shown, file.to_owned()));
        Ok(())
    }

    /// Checks a folder of files that the program writes and reads again.
    ///
    /// # Errors
    ///
    /// If its files are read as part of a scene, or a scene's folder holds it and it holds others.
    pub(crate) fn cache(&self, option: &str, folder: &Path) -> Result<()> {
        self.refuse_folder(option, folder, |scene, real| real.starts_with(&scene.root) && scene.is_its_own(real))
    }

    /// Checks a folder of outputs, which are added one by one.
    ///
    /// # Errors
    ///
    /// If it is the folder of a scene, or holds its poses.
    pub(crate) fn folder(&self, option: &str, folder: &Path) -> Result<()> {
        self.refuse_folder(option, folder, SceneFolder::has_inputs_in)
    }

    fn refuse_folder(&self, option: &str, folder: &Path, is_its: fn(&SceneFolder, &Path) -> bool) -> Result<()> {
        let shown = format!("{option} {}", folder.display());
        let real = resolved(folder).map_err(|error| anyhow!("{shown}: cannot be opened: {error}"))?;
        if is_its(&self.scene, &real) {
            bail!("{shown}: is a folder of the scene {}; expected another folder", self.scene.root.display());
        }
        Ok(())
    }

    /// Adds any number of files `PREFIX….png`.
    ///
    /// # Errors
    ///
    /// As [`Self::file`], for the first one.
    pub(crate) fn frames(&mut self, option: &str, folder: &Path, prefix: &'static str, first: &Path) -> Result<()> {
        self.file(option, first)?;
        if let Ok(real) = resolved(folder) {
            self.frames.push((real, prefix, format!("{option} {}", folder.display())));
        }
        Ok(())
    }

    /// Whether a path is inside a scene folder.
    pub(crate) fn in_scene(&self, path: &Path) -> bool {
        resolved(path).is_ok_and(|real| real.starts_with(&self.scene.root))
    }

    /// Checks that a file overwrites no input and no file of another's, and is not read as part of
    /// a scene.
    fn check(&self, shown: &str, file: &Path, real: &Path, by_name: bool) -> Result<()> {
        if let Ok(identity) = Identity::of(file) {
            if let Some(input) = self.inputs.get(&identity) {
                bail!("{shown}: would overwrite {input}; expected another file");
            }
            let scene = real.starts_with(&self.scene.root).then_some(&*self.scene.root);
            check_own(shown, file, scene, by_name)?;
        }
        if let Some(part) = self.scene.reads(real) {
            let root = self.scene.root.display();
            bail!("{shown}: would be read as {part} of the scene {root}; expected another file");
        }
        Ok(())
    }

    /// Creates the missing folders, and checks that files can be written there.
    ///
    /// # Errors
    ///
    /// If a file cannot be written.
    pub(crate) fn prepare(&self) -> Result<()> {
        let mut checked = None;
        for (shown, file) in self.files.iter().filter(|(_, file)| !is_special(file)) {
            let folder = file.parent().unwrap_or(Path::new(""));
            // One file per folder is enough.
            if checked.replace(folder) == Some(folder) {
                continue;
            }
            std::fs::create_dir_all(folder)
                .and_then(|()| AtomicFile::create(file).map(drop))
                .map_err(|error| anyhow!("{shown}: cannot be written: {error}"))?;
        }
        Ok(())
    }
}

/// Identity of an existing file or folder: equal for all paths to it.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Identity(#[cfg(unix)] (u64, u64), #[cfg(not(unix))] PathBuf);

impl Identity {
    #[cfg(unix)]
    fn of(path: &Path) -> io::Result<Self> {
        use std::os::unix::fs::MetadataExt;
        let about = path.metadata()?;
        Ok(Self((about.dev(), about.ino())))
    }

    #[cfg(not(unix))]
    fn of(path: &Path) -> io::Result<Self> {
        path.canonicalize().map(Self)
    }
}

/// The path without links and `..`; below a folder that does not exist, `..` removes the preceding
/// name.
fn resolved(path: &Path) -> io::Result<PathBuf> {
    if let Ok(real) = path.canonicalize() {
        return Ok(real);
    }
    let mut real = PathBuf::new();
    for part in std::path::absolute(path)?.components() {
        if part == Component::ParentDir {
            real.pop();
        } else {
            real.push(part);
        }
        real = real.canonicalize().unwrap_or(real);
    }
    Ok(real)
}

/// Bytes at the start of a picture file that include the program's tag.
const TAGGED_BYTES: u64 = 256;

/// Checks that the program wrote an existing file that will be replaced; `scene` is the folder of
/// the scene that holds it.
fn check_own(shown: &str, file: &Path, scene: Option<&Path>, by_name: bool) -> Result<()> {
    let replaces_json = !by_name && is_json(file);
    // Any JSON, because a scene or its cameras may consist of it.
    let is_protected = scene.is_some() || replaces_json;
    if is_protected && !is_own(file) {
        let of = scene.map(|root| format!(" of the scene folder {}", root.display())).unwrap_or_default();
        bail!(
            "{shown}: would overwrite a file{of} that liveview did not write; expected another file, or that one moved \
             away"
        );
    }
    Ok(())
}

/// Whether the program wrote a file: a tagged picture, or JSON with the program's fields.
fn is_own(file: &Path) -> bool {
    if is_json(file) {
        let json = json(file);
        // The last is of a log, which has a line for each frame.
        return json["liveview"].is_string() || json["layers_from"].is_string();
    }
    if has_extension(file, &["npy"]) {
        // An array has no tag; `liveview depth` writes a picture and its scale next to each.
        let stem = file.file_stem().unwrap_or_default();
        return [".png", "_scale.json"].iter().all(|ending| {
            let mut name = stem.to_owned();
            name.push(ending);
            is_own(&file.with_file_name(name))
        });
    }
    let mut start = Vec::new();
    let mut read = || File::open(file).and_then(|file| file.take(TAGGED_BYTES).read_to_end(&mut start));
    file.is_file() && read().is_ok() && is_tagged(&start)
}

fn is_json(file: &Path) -> bool {
    has_extension(file, &["json", "jsonl"])
}

/// The JSON of a file, or of its first line; null if it is neither.
fn json(file: &Path) -> Value {
    let bytes = bounded::read_regular(file, bounded::MAX_JSON_BYTES).unwrap_or_default();
    let bytes = bounded::without_byte_order_mark(&bytes);
    let first_line = || bytes.split(|&byte| byte == b'\n').next().unwrap_or_default();
    serde_json::from_slice(bytes).or_else(|_| serde_json::from_slice(first_line())).unwrap_or_default()
}

/// Folders from which photos or the cameras of a rig are read.
const FOLDERS: [&str; 7] = ["images", "images_2", "images_4", "images_8", "input", "frames", "videos"];
/// Names of pose files.
const POSES: [&str; 11] = [
    "transforms.json",
    "transforms_train.json",
    "poses_bounds.npy",
    "models.json",
    "cameras.json",
    "cameras.txt",
    "cameras.bin",
    "images.txt",
    "images.bin",
    "points3D.txt",
    "points3D.bin",
];
/// Extensions of files that are read as a photo, or as a camera of a rig.
const PICTURES: [&str; 14] =
    ["png", "jpg", "jpeg", "webp", "tif", "tiff", "bmp", "mp4", "m4v", "mov", "mkv", "avi", "webm", "y4m"];

/// A scene folder.
#[derive(Debug)]
struct SceneFolder {
    root: PathBuf,
    /// Folders of photos; every file in them would be read.
    photos: BTreeSet<PathBuf>,
    /// Folders that hold a rig's cameras; a new folder of pictures would be another camera.
    cameras: BTreeSet<PathBuf>,
    /// Whether photos and poses are in the same folder.
    flat: bool,
}

impl SceneFolder {
    fn new(scene: &Scene) -> Self {
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
        }
    }

    /// The part of the scene that a file of this name would be read as, if any.
    fn reads(&self, real: &Path) -> Option<&'static str> {
        let below = |folder: &PathBuf| real.starts_with(folder);
        if below(&self.root) && POSES.iter().any(|poses| real.file_name() == Some(poses.as_ref())) {
            return Some("the poses");
        }
        let beside = self.flat && real.parent() == Some(&self.root) || self.cameras.iter().any(below);
        let read = self.photos.iter().any(below) || beside && has_extension(real, &PICTURES);
        read.then_some("a photo or a camera")
    }

    /// Whether a folder is the scene's own, or holds poses of it.
    fn has_inputs_in(&self, real: &Path) -> bool {
        real == self.root || real.starts_with(&self.root) && POSES.iter().any(|poses| real.join(poses).exists())
    }

    /// Whether a folder is part of the scene: its files would be read, or it holds files other than
    /// arrays (.npz) that the program did not write.
    fn is_its_own(&self, real: &Path) -> bool {
        let other = |entry: &fs::DirEntry| !has_extension(&entry.path(), &["npz"]) && !is_own(&entry.path());
        self.reads(&real.join("depth.npz")).is_some()
            || fs::read_dir(real).into_iter().flatten().flatten().any(|entry| other(&entry))
    }
}

#[cfg(unix)]
#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn all_paths_to_a_file_resolve_to_one() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        std::fs::create_dir_all(at("a/b")).unwrap();
        symlink(at("a/b"), at("link")).unwrap();
        let real = |name: &str| resolved(&at(name)).unwrap();
        for same in
            ["a/./b/new/c.png", "link/new/c.png", "link/../b/new/c.png", "link/x/../new/c.png", "none/../a/b/new/c.png"]
        {
            assert_eq!(real(same), real("a/b/new/c.png"), "{same}");
        }
        assert_ne!(real("a/new/c.png"), real("a/b/new/c.png"));
        assert_ne!(real("a/b/c.png"), real("a/b/new/c.png"));
    }
}
