//! What the views and the depth range of a shot were chosen from.

use anyhow::Result;
use liveview::scene::View;
use liveview::surface::PhotoDepth;
use liveview::{Camera, SceneViews, Shot};
use ndarray::{Array1, Array2, Array3};

use crate::npz::Arrays;

/// The photos of a shot with the depth that was found for them, and the range that was searched.
pub(super) struct Photos {
    pub(super) views: Vec<usize>,
    pub(super) depths: Vec<PhotoDepth>,
    pub(super) range: (f64, f64),
}

/// Writes the cameras and depth ranges of all views, which of them are not held out, the given range, and
/// the choice; and the original photos, where a lens distortion was removed and nothing else.
pub(super) fn write_scene(views: &SceneViews, shot: &Shot, arrays: &mut Arrays) -> Result<()> {
    let all = &views.scene().views;
    let matrices = |of: fn(&Camera) -> glam::DMat3| {
        Array3::from_shape_fn((all.len(), 3, 3), |(view, row, column)| of(&all[view].camera).row(row)[column])
    };
    arrays.add("scene.k", matrices(Camera::k))?;
    arrays.add("scene.rotation", matrices(Camera::rotation))?;
    arrays.add("scene.translation", Array2::from_shape_fn((all.len(), 3), |(v, i)| all[v].camera.translation()[i]))?;
    let size = |view: &View| [view.camera.width() as i64, view.camera.height() as i64];
    arrays.add("scene.size", Array2::from_shape_fn((all.len(), 2), |(v, i)| size(&all[v])[i]))?;
    arrays.add("scene.free", (0..all.len()).map(|v| i64::from(!shot.held_out.contains(&v))).collect::<Array1<_>>())?;
    let range = |view: &View| view.depth_range.map_or([f64::NAN; 2], |(near, far)| [near, far]);
    arrays.add("scene.range", Array2::from_shape_fn((all.len(), 2), |(v, i)| range(&all[v])[i]))?;
    let (near, far) = views.given_depth();
    arrays.add("scene.given", Array1::from_vec(vec![near.unwrap_or(f64::NAN), far.unwrap_or(f64::NAN)]))?;
    arrays.add("shot.photos", photos(shot).map(|view| view as i64).collect::<Array1<_>>())?;
    arrays.add("shot.range", Array1::from_vec(vec![shot.near, shot.far]))?;
    for (index, &view) in shot.views.iter().enumerate() {
        write_original(&all[view], index, arrays)?;
    }
    Ok(())
}

/// The views to render from, then the helpers.
pub(super) fn photos(shot: &Shot) -> impl Iterator<Item = usize> {
    shot.views.iter().chain(&shot.helpers).copied()
}

fn write_original(view: &View, index: usize, arrays: &mut Arrays) -> Result<()> {
    let (model, coefficients) = view.distortion();
    let fisheye = model == "OPENCV_FISHEYE";
    let distorted = fisheye || coefficients.iter().any(|(_, value)| *value != 0.0);
    if !distorted || view.native_camera().size() != view.camera.size() {
        return Ok(());
    }
    let photo = liveview::image::load(view.image_path())?;
    arrays.add(&format!("original{index}.photo"), photo.as_array().to_owned())?;
    for (name, value) in coefficients {
        arrays.add(&format!("original{index}.{name}"), ndarray::arr0(value))?;
    }
    arrays.add(&format!("original{index}.fisheye"), ndarray::arr0(i64::from(fisheye)))
}
