//! Checks, before any work, that no output overwrites an input of the command, another output, a
//! file of the scene folder, or JSON that the program did not write. Paths are compared after resolving links and `..`.

mod own;
mod scene_folder;

use std::collections::HashMap;
use std::ffi::OsString;
use std::io;
use std::path::{Component, Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use liveview_files::atomic::{AtomicFile, is_special};
use liveview_synthesizer::Scene;
use own::Existing;
pub(crate) use own::note_other_pictures;
use scene_folder::SceneFolder;

use crate::args::output::refuse_stdout;

/// The output files of a command.
#[derive(Debug)]
pub(crate) struct OutputPlan {
    /// The scene that is read.
    scene: SceneFolder,
    /// Descriptions of the inputs, for messages.
    inputs: HashMap<Identity, String>,
    /// The planned files: option and path as given, for messages.
    planned: HashMap<Location, String>,
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
    /// program did not write, or the record of a run; if it would be read as part of the scene; or
    /// if it cannot be a file.
    pub(crate) fn file(&mut self, option: &str, file: &Path) -> Result<()> {
        self.add(option, file, Existing::Replaced)
    }

    /// Adds a file whose name the program chose, such as the record of a run.
    ///
    /// # Errors
    ///
    /// As [`Self::file`], but outside the scene any JSON of that name is replaced.
    pub(crate) fn named_file(&mut self, option: &str, file: &Path) -> Result<()> {
        self.add(option, file, Existing::ReplacedByName)
    }

    fn add(&mut self, option: &str, file: &Path, existing: Existing) -> Result<()> {
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
        if let Some(other) = other.or(self.planned.get(&Location::of(&real))) {
            bail!("{shown}: {other} is the same file; expected different files");
        }
        if !is_special(file) {
            self.check(&shown, file, &real, existing)?;
        }
        self.planned.insert(Location::of(&real), shown.clone());
        self.files.push((shown, file.to_owned()));
        Ok(())
    }

    /// Checks a folder of files that the program writes and reads again.
    ///
    /// # Errors
    ///
    /// If its files are read as part of a scene, or a scene's folder holds it and it holds others.
    pub(crate) fn cache(&self, option: &str, folder: &Path) -> Result<()> {
        self.refuse_folder(option, folder, |scene, real| scene.holds(real) && scene.is_its_own(real))
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
            bail!("{shown}: is a folder of the scene {}; expected another folder", self.scene.root().display());
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
        resolved(path).is_ok_and(|real| real.starts_with(self.scene.root()))
    }

    /// Checks that a file overwrites no input and no file of another's, and is not read as part of
    /// a scene.
    fn check(&self, shown: &str, file: &Path, real: &Path, existing: Existing) -> Result<()> {
        if let Ok(identity) = Identity::of(file) {
            if let Some(input) = self.inputs.get(&identity) {
                bail!("{shown}: would overwrite {input}; expected another file");
            }
            let scene = self.scene.holds(real).then(|| self.scene.root());
            own::check(shown, file, scene, existing)?;
        }
        if let Some(part) = self.scene.reads(real) {
            let root = self.scene.root().display();
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
pub(super) struct Identity(#[cfg(unix)] (u64, u64), #[cfg(not(unix))] PathBuf);

impl Identity {
    #[cfg(unix)]
    pub(super) fn of(path: &Path) -> io::Result<Self> {
        use std::os::unix::fs::MetadataExt;
        let about = path.metadata()?;
        Ok(Self((about.dev(), about.ino())))
    }

    #[cfg(not(unix))]
    pub(super) fn of(path: &Path) -> io::Result<Self> {
        path.canonicalize().map(Self)
    }
}

/// Identity of a file that may not exist yet: an existing folder, and the names below it.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct Location(Option<Identity>, Vec<OsString>);

impl Location {
    /// The location of a [`resolved`] path.
    pub(super) fn of(real: &Path) -> Self {
        let (mut folder, mut names) = (real, Vec::new());
        while let (Some(name), Some(parent)) = (folder.file_name(), folder.parent()) {
            names.push(name.to_owned());
            if let Ok(identity) = Identity::of(parent) {
                return Self(Some(identity), names);
            }
            folder = parent;
        }
        Self(None, names)
    }
}

/// The path without links and `..`; below a folder that does not exist, `..` removes the preceding
/// name.
pub(super) fn resolved(path: &Path) -> io::Result<PathBuf> {
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

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn location_is_equal_for_all_paths_to_a_file() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        std::fs::create_dir_all(at("a/b")).unwrap();
        symlink(at("a/b"), at("link")).unwrap();
        let location = |name: &str| Location::of(&resolved(&at(name)).unwrap());
        for same in
            ["a/./b/new/c.png", "link/new/c.png", "link/../b/new/c.png", "link/x/../new/c.png", "none/../a/b/new/c.png"]
        {
            assert_eq!(location(same), location("a/b/new/c.png"), "{same}");
        }
        assert_ne!(location("a/new/c.png"), location("a/b/new/c.png"));
        assert_ne!(location("a/b/c.png"), location("a/b/new/c.png"));
    }
}
