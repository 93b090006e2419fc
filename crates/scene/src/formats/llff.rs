//! LLFF: `poses_bounds.npy` and a folder of photos, matched by order: row i belongs to the i-th
//! name in byte order.
//!
//! One row of 17 f64 per camera: a 3×5 matrix, row by row, then near and far depth. The columns of
//! the matrix are the camera's axes in world coordinates [down, right, backwards], its centre, and
//! (height, width, focal length) of the full-size photos (LLFF's README, "Using your own poses").
//! OpenCV's axes are [right, down, −backwards]. The principal point is the image centre.
//!
//! The photos are usually downscaled copies; intrinsics are scaled to their actual size. Depth
//! ranges are the stored bounds.

use std::path::Path;

use glam::{DMat3, DVec3};
use ndarray::ArrayView2;

use crate::photos::{PhotoLookup, list_photos};
use crate::scene_file::{pixels, read};
use crate::{DeclaredView, DeclaredViews, Distortion, Photo, PhotoList, PhotoSource, SceneError, SceneOptions};
use liveview::geometry::{Intrinsics, Size};
use liveview_files::npy;

/// Photo folders, in order of precedence.
const FOLDERS: [&str; 4] = ["images_8", "images_4", "images_2", "images"];

pub(super) fn open(root: &Path, photos: &dyn PhotoSource, options: &SceneOptions) -> Result<DeclaredViews, SceneError> {
    let path = root.join("poses_bounds.npy");
    let rows = parse(&path, &read(&path)?)?;
    let list = list_photos(root, photos, options.images.as_deref(), &FOLDERS)?;
    if list.names.len() != rows.len() {
        let folder = list.folder.map_or_else(|| root.to_owned(), |folder| root.join(folder));
        let what = format!("{} poses, but {} holds {} images", rows.len(), folder.display(), list.names.len());
        return Err(SceneError::malformed(path, what, "one pose per image"));
    }
    views(&rows, &list, PhotoLookup::new(photos, &path))
}

/// The rows of the file; their heights and widths are whole numbers of pixels.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<[f64; 17]>, SceneError> {
    const EXPECTED: &str = "a float64 array of N rows with 17 numbers";
    let array: ArrayView2<'_, f64> = npy::view(bytes).map_err(|what| SceneError::malformed(path, what, EXPECTED))?;
    if array.ncols() != 17 {
        return Err(SceneError::malformed(path, format!("the array has shape {:?}", array.shape()), EXPECTED));
    }
    let rows: Vec<[f64; 17]> = array.rows().into_iter().map(|row| std::array::from_fn(|i| row[i])).collect();
    for (index, row) in rows.iter().enumerate() {
        for (name, value) in [("height", row[4]), ("width", row[9])] {
            if pixels(value).is_none() {
                let what = format!("row {index}: {name} is {value}");
                return Err(SceneError::malformed(path, what, "a whole number of pixels"));
            }
        }
    }
    Ok(rows)
}

/// Views of the listed photos, one for each row of the file.
pub(super) fn views(
    rows: &[[f64; 17]],
    list: &PhotoList,
    mut lookup: PhotoLookup<'_>,
) -> Result<DeclaredViews, SceneError> {
    for (row, name) in rows.iter().zip(&list.names) {
        let photo = lookup.find(&list.with_folder(name))?;
        lookup.views.extend(photo.map(|photo| view(row, photo)));
    }
    let mut found = lookup.finish()?;
    found.notes.extend(list.folder.iter().map(|folder| format!("photos are read from {folder}")));
    Ok(found)
}

fn view(row: &[f64; 17], photo: Photo) -> DeclaredView {
    let column = |i: usize| DVec3::new(row[i], row[5 + i], row[10 + i]);
    let (down, right, backwards, centre) = (column(0), column(1), column(2), column(3));
    let (height, width, focal) = (row[4], row[9], row[14]);
    let rotation = DMat3::from_rows(right, down, -backwards);
    DeclaredView {
        photo,
        intrinsics: Intrinsics { fx: focal, fy: focal, cx: 0.5 * width, cy: 0.5 * height, skew: 0.0 },
        size: Size::new(width as usize, height as usize),
        may_be_resampled: true,
        rotation,
        translation: -(rotation * centre),
        distortion: Distortion::default(),
        depth_range: Some((row[15], row[16])),
    }
}
