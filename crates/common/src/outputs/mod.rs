//! Output paths held against all that they could destroy, before any work: the command's inputs, each other, and the files of the
//! scene's folder. Paths are compared by what they are, through links and `..`, not by how they are spelt.

mod identity;
mod others;
mod own;
mod scene_folder;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use identity::{Identity, Spot};
use liveview::Scene;
use liveview::fs::atomic::{AtomicFile, is_special};
pub use others::note_other_pictures;
use scene_folder::SceneFolder;

use crate::args::output::refuse_stdout;

/// The output files of a command.
#[derive(Debug)]
pub struct OutputPlan {
    scene: SceneFolder,
    /// What would be lost with a file that exists, in words.
    inputs: HashMap<Identity, String>,
    /// The option and the path, as given, of what will be written.
    taken: HashMap<Spot, String>,
    /// Folders whose frames are not known beforehand: all of these names are taken.
    frames: Vec<(PathBuf, &'static str, String)>,
    files: Vec<(String, PathBuf)>,
}

impl OutputPlan {
    /// No outputs yet, of a command that reads this scene.
    pub fn new(scene: &Scene) -> Self {
        let photo = |path: &Path| format!("a photo of the scene, {}", path.display());
        let photos = scene.views.iter().map(|view| view.image_path());
        let inputs = photos.filter_map(|path| Some((Identity::of(path).ok()?, photo(path)))).collect();
        Self { scene: SceneFolder::new(scene), inputs, taken: HashMap::new(), frames: Vec::new(), files: Vec::new() }
    }

    /// Protects another file that the command reads, if one is given.
    pub fn protect(&mut self, option: &str, file: Option<&Path>) {
        let Some(file) = file else { return };
        if let Ok(identity) = Identity::of(file) {
            self.inputs.insert(identity, format!("{option} {}", file.display()));
        }
    }

    /// Adds a file that will be written.
    ///
    /// # Errors
    ///
    /// It would overwrite an input, another output or a file of the scene that the program did not write, it would be taken for a part
    /// of the scene, or it cannot be a file.
    pub fn file(&mut self, option: &str, file: &Path) -> Result<()> {
        let shown = format!("{option} {}", file.display());
        refuse_stdout(option, file)?;
        let refused = |why: String| anyhow!("{shown}: cannot be written: {why}");
        let folder = file.parent().unwrap_or(Path::new(""));
        if folder.exists() && !folder.is_dir() {
            return Err(refused(format!("{} is a file; expected a folder", folder.display())));
        }
        if file.is_dir() {
            return Err(refused("it is a folder; expected a file, or nothing yet".to_owned()));
        }
        let real = identity::resolved(file).map_err(|error| refused(error.to_string()))?;
        let name = real.file_name().unwrap_or_default().to_string_lossy();
        let within = |(folder, prefix, _): &&(PathBuf, &str, _)| {
            real.parent() == Some(folder) && name.starts_with(prefix) && name.ends_with(".png")
        };
        let other = self.frames.iter().find(within).map(|(.., shown)| shown);
        if let Some(other) = other.or(self.taken.get(&Spot::of(&real))) {
            bail!("{shown}: {other} is written to the same place; expected different places");
        }
        if !is_special(file) {
            self.check(&shown, file, &real)?;
        }
        self.taken.insert(Spot::of(&real), shown.clone());
        self.files.push((shown, file.to_owned()));
        Ok(())
    }

    /// Adds files `PREFIX….png` of which there may be any number.
    ///
    /// # Errors
    ///
    /// Those of [`Self::file`], of the first.
    pub fn frames(&mut self, option: &str, folder: &Path, prefix: &'static str, first: &Path) -> Result<()> {
        self.file(option, first)?;
        if let Ok(real) = identity::resolved(folder) {
            self.frames.push((real, prefix, format!("{option} {}", folder.display())));
        }
        Ok(())
    }

    /// Whether a path lies in the scene's folder.
    pub fn in_scene(&self, path: &Path) -> bool {
        identity::resolved(path).is_ok_and(|real| real.starts_with(self.scene.root()))
    }

    /// Holds a file against what it would destroy.
    fn check(&self, shown: &str, file: &Path, real: &Path) -> Result<()> {
        let root = self.scene.root().display();
        if let Ok(identity) = Identity::of(file) {
            if let Some(input) = self.inputs.get(&identity) {
                bail!("{shown}: would overwrite {input}; expected another place");
            }
            if self.scene.holds(real) && !own::is_own(file) {
                bail!(
                    "{shown}: would overwrite a file of the scene's folder {root}, and it cannot be told that liveview wrote it; \
                     expected another place, or that file moved away"
                );
            }
        }
        match self.scene.reads(real) {
            Some(what) => bail!("{shown}: would be taken for {what} of the scene {root}; expected another place"),
            None => Ok(()),
        }
    }

    /// Makes the folders that are missing.
    ///
    /// # Errors
    ///
    /// A file cannot be written.
    pub fn prepare(&self) -> Result<()> {
        let mut tried = None;
        for (shown, file) in self.files.iter().filter(|(_, file)| !is_special(file)) {
            let folder = file.parent().unwrap_or(Path::new(""));
            // One of the files of a folder tells of all.
            if tried.replace(folder) == Some(folder) {
                continue;
            }
            std::fs::create_dir_all(folder)
                .and_then(|()| AtomicFile::create(file).map(drop))
                .map_err(|error| anyhow!("{shown}: cannot be written: {error}"))?;
        }
        Ok(())
    }
}
