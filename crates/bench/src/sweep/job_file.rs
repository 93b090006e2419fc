//! The job of the reference implementations as a .npz file: a target, its photos and planes
//! (`liveview_ref.rig_arrays`).

use std::io::Cursor;
use std::path::Path;

use anyhow::{Error, Result, anyhow};
use liveview::Camera;
use liveview::layers::uniform_disparities;
use liveview_files::atomic;
use liveview_synthesizer::{SceneViews, Shot};
use ndarray::{Array1, Array2};
use ndarray_npy::{NpzWriter, WriteNpzError};

type Arrays = NpzWriter<Cursor<Vec<u8>>>;

/// Writes the photos that a shot is rendered from, their cameras, the target camera and uniform planes.
pub(super) fn write_job(path: &Path, views: &SceneViews, shot: &Shot, planes: usize) -> Result<()> {
    let unwritten = |error: WriteNpzError| unwritten(path, error);
    let mut arrays = NpzWriter::new(Cursor::new(Vec::new()));
    for (index, &view) in shot.views.iter().enumerate() {
        add_camera(&mut arrays, &format!("view{index}"), &views.scene().views[view].camera).map_err(unwritten)?;
        let photo = views.scene().load_image(view)?;
        arrays.add_array(format!("view{index}.image"), &photo.as_array()).map_err(unwritten)?;
    }
    add_camera(&mut arrays, "target", &shot.target).map_err(unwritten)?;
    let size = Array1::from_vec(vec![shot.target.width() as i64, shot.target.height() as i64]);
    arrays.add_array("target.size", &size).map_err(unwritten)?;
    let disparities = Array1::from_vec(uniform_disparities(shot.near, shot.far, planes)?);
    arrays.add_array("disparities", &disparities).map_err(unwritten)?;
    let bytes = arrays.finish().map_err(unwritten)?.into_inner();
    atomic::write(path, &bytes).map_err(|error| self::unwritten(path, error))
}

fn add_camera(arrays: &mut Arrays, name: &str, camera: &Camera) -> Result<(), WriteNpzError> {
    let matrix = |m: glam::DMat3| Array2::from_shape_fn((3, 3), |(row, column)| m.row(row)[column]);
    arrays.add_array(format!("{name}.k"), &matrix(camera.k()))?;
    arrays.add_array(format!("{name}.rotation"), &matrix(camera.rotation()))?;
    arrays.add_array(format!("{name}.translation"), &Array1::from_vec(camera.translation().to_array().to_vec()))
}

/// The error of a file that cannot be written, with only the root cause.
pub(super) fn unwritten(path: &Path, error: impl Into<Error>) -> Error {
    anyhow!("{}: cannot be written: {}", path.display(), error.into().root_cause())
}
