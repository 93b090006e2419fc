//! Arrays for the Python reference: .npz files, written completely or not at all.

use std::path::{Path, PathBuf};

use anyhow::{Error, Result, anyhow};
use liveview::Camera;
use liveview_files::atomic::AtomicFile;
use liveview_synthesizer::{SceneViews, Shot};
use ndarray::{Array, Array1, Dimension};
use ndarray_npy::{NpzWriter, WritableElement};

/// A .npz file being written.
pub(crate) struct Arrays {
    file: NpzWriter<AtomicFile>,
    path: PathBuf,
}

impl Arrays {
    pub(crate) fn create(path: &Path) -> Result<Self> {
        let file = AtomicFile::create(path).map_err(|error| unwritten(path, error))?;
        Ok(Self { file: NpzWriter::new(file), path: path.to_owned() })
    }

    pub(crate) fn add<A: WritableElement, D: Dimension>(&mut self, name: &str, array: Array<A, D>) -> Result<()> {
        self.file.add_array(name, &array).map_err(|error| unwritten(&self.path, error))
    }

    fn add_camera(&mut self, name: &str, camera: &Camera) -> Result<()> {
        let matrix = |m: glam::DMat3| Array::from_shape_fn((3, 3), |(row, column)| m.row(row)[column]);
        self.add(&format!("{name}.k"), matrix(camera.k()))?;
        self.add(&format!("{name}.rotation"), matrix(camera.rotation()))?;
        self.add(&format!("{name}.translation"), Array1::from_vec(camera.translation().to_array().to_vec()))
    }

    /// Adds the photos that a shot is rendered from, their cameras, and the target camera.
    pub(crate) fn add_rig(&mut self, views: &SceneViews, shot: &Shot) -> Result<()> {
        for (index, &view) in shot.views.iter().enumerate() {
            self.add_camera(&format!("view{index}"), &views.scene().views[view].camera)?;
            self.add(&format!("view{index}.image"), views.scene().load_image(view)?.as_array().to_owned())?;
        }
        self.add_camera("target", &shot.target)?;
        self.add("target.size", Array1::from_vec(vec![shot.target.width() as i64, shot.target.height() as i64]))
    }

    /// Closes the file and gives it its name.
    pub(crate) fn finish(self) -> Result<()> {
        let file = self.file.finish().map_err(|error| unwritten(&self.path, error))?;
        file.finish().map_err(|error| unwritten(&self.path, error))
    }
}

/// The error of a file that cannot be written, with only the root cause.
pub(crate) fn unwritten(path: &Path, error: impl Into<Error>) -> Error {
    anyhow!("{}: cannot be written: {}", path.display(), error.into().root_cause())
}
