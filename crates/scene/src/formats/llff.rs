//! LLFF: `poses_bounds.npy` and a folder of photos, matched by order: row i belongs to the i-th
//! name in byte order.
//!
//! One row of 17 f64 per camera: a 3×5 matrix, row by row, then near and far depth. The columns of
//! the matrix are the camera's axes in world coordinates [down, right, backwards], its centre, and
//! (height, width, focal length) of the full-size photos (LLFF's README, "Using your own poses").
//! OpenCV's axes are [right, down, −backwards]. The principal point is the image centre.
//!
//! The photos are usually downscaled copies; intrinsics are scaled to their actual size. Depth
//! ranges are the stored bounds. The rows of NeX have 14 numbers, without the third group; its file `hwf_cxcy.npy`
//! `[2, 3]` holds height, width and fx, then cx, cy and fy, for all photos.

use std::path::Path;

use glam::{DMat3, DVec3};
use ndarray::Array2;

use crate::photos::{PhotoLookup, list_photos};
use crate::scene_file::{abbreviated, read};
use crate::view::seen_from;
use crate::{DeclaredView, DeclaredViews, Found, ListedPhoto, Photo, PhotoList, PhotoSource, SceneError, SceneOptions};
use liveview::geometry::{Intrinsics, Size};
use liveview_files::npy;

/// Height, width and fx; cx, cy and fy: pixels.
type Intrinsics23 = [f64; 6];

pub(super) fn open(options: &SceneOptions, lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
    let (path, photos) = (lookup.listed_in, lookup.photos);
    let root = path.parent().unwrap_or(path);
    let common = root.join("hwf_cxcy.npy");
    let common = if common.is_file() { Some(parse_common(&common, &read(&common)?)?) } else { None };
    let rows = parse(path, &read(path)?, common)?;
    let mut list = list_photos(root, photos, options.images.as_deref())?;
    let others = if list.names.len() > rows.len() { of_other_size(photos, &list, path) } else { Vec::new() };
    if list.names.len() == rows.len() + others.len() {
        list.names.retain(|name| !others.contains(name));
    }
    if list.names.len() != rows.len() {
        let folder = list.folder.map_or_else(|| root.to_owned(), |folder| root.join(folder));
        let names = abbreviated(&list.names);
        let what = format!("{} poses, but {} holds {} images: {names}", rows.len(), folder.display(), list.names.len());
        return Err(SceneError::malformed(path, what, "one pose per image, so delete the images without a pose"));
    }
    let mut found = views(&rows, common, &list, lookup)?;
    if !others.is_empty() {
        found.notes.push(format!("of another size than the photos, left out: {}", abbreviated(&others)));
    }
    Ok(found)
}

/// The pictures of other sizes than most, such as a thumbnail.
fn of_other_size(photos: &dyn PhotoSource, list: &PhotoList, listed_in: &Path) -> Vec<String> {
    let size = |name: &String| match photos.find(&ListedPhoto { name: &list.with_folder(name), listed_in }) {
        Ok(Found::Photo(photo) | Found::Shared(photo)) => Some(photo.size),
        _ => None,
    };
    let sizes: Vec<Option<Size>> = list.names.iter().map(size).collect();
    let count = |size: &&Option<Size>| sizes.iter().filter(|other| other == size).count();
    let usual = sizes.iter().max_by_key(count);
    list.names.iter().zip(&sizes).filter(|(_, size)| Some(*size) != usual).map(|(name, _)| name.clone()).collect()
}

fn array(path: &Path, bytes: &[u8], expected: &str) -> Result<Array2<f64>, SceneError> {
    let single = |what| npy::read(bytes).map(|array: Array2<f32>| array.mapv(f64::from)).map_err(|_| what);
    npy::read(bytes).or_else(single).map_err(|what| SceneError::malformed(path, what, expected))
}

fn parse_common(path: &Path, bytes: &[u8]) -> Result<Intrinsics23, SceneError> {
    const EXPECTED: &str = "an array [2, 3] of height, width and fx, cx, cy and fy";
    let array = array(path, bytes, EXPECTED)?;
    let numbers = array.iter().copied().collect::<Vec<_>>().try_into();
    numbers.map_err(|_| SceneError::malformed(path, format!("the array has shape {:?}", array.shape()), EXPECTED))
}

/// The rows of the file, with height, width and focal length `common` to all where they have none.
pub(super) fn parse(path: &Path, bytes: &[u8], common: Option<Intrinsics23>) -> Result<Vec<[f64; 17]>, SceneError> {
    const EXPECTED: &str = "an array, float64 or float32, of N rows with 17 numbers, or 14 with hwf_cxcy.npy beside it";
    let array = array(path, bytes, EXPECTED)?;
    let wrong = |what: String| SceneError::malformed(path, what, EXPECTED);
    let mut rows = Vec::with_capacity(array.nrows());
    for (index, row) in array.rows().into_iter().enumerate() {
        let row: [f64; 17] = match (row.len(), common) {
            (17, _) => std::array::from_fn(|i| row[i]),
            (14, Some(common)) => std::array::from_fn(|i| match (i, i % 5) {
                (15.., _) => row[i - 3],
                (_, 4) => common[i / 5],
                (_, column) => row[4 * (i / 5) + column],
            }),
            (14, None) => return Err(wrong("rows of 14 numbers lack size and focal length".to_owned())),
            _ => return Err(wrong(format!("the array has shape {:?}", array.shape()))),
        };
        for (name, value) in [("height", row[4]), ("width", row[9])] {
            if !(1.0..=1e9).contains(&value) {
                let what = format!("row {index}: {name} is {value}");
                return Err(SceneError::malformed(path, what, "a number of pixels"));
            }
        }
        rows.push(row);
    }
    Ok(rows)
}

/// Views of the listed photos, one for each row of the file.
pub(super) fn views(
    rows: &[[f64; 17]],
    common: Option<Intrinsics23>,
    list: &PhotoList,
    mut lookup: PhotoLookup<'_>,
) -> Result<DeclaredViews, SceneError> {
    for (row, name) in rows.iter().zip(&list.names) {
        let photo = lookup.find(&list.with_folder(name))?;
        lookup.views.extend(photo.map(|photo| view(row, common, photo)));
    }
    let mut found = lookup.finish()?;
    found.notes.extend(list.folder.iter().map(|folder| format!("photos are read from {folder}")));
    Ok(found)
}

fn view(row: &[f64; 17], common: Option<Intrinsics23>, photo: Photo) -> DeclaredView {
    let column = |i: usize| DVec3::new(row[i], row[5 + i], row[10 + i]);
    let (down, right, backwards, centre) = (column(0), column(1), column(2), column(3));
    let (height, width, focal) = (row[4], row[9], row[14]);
    let [.., fx, cx, cy, fy] = common.unwrap_or([height, width, focal, 0.5 * width, 0.5 * height, focal]);
    // Sizes may be fractions of pixels, of copies whose size was rounded.
    let (across, tall) = (width.round() / width, height.round() / height);
    let intrinsics = Intrinsics { fx: fx * across, fy: fy * tall, cx: cx * across, cy: cy * tall, skew: 0.0 };
    let size = Size::new(width.round() as usize, height.round() as usize);
    let pose = seen_from(DMat3::from_cols(right, down, -backwards), centre);
    DeclaredView { depth_range: Some((row[15], row[16])), ..DeclaredView::new(photo, (intrinsics, size), pose) }
}
