//! Scene readers without a file system, for the fuzz targets (`tests/fuzz`): every photo that a
//! file names exists and is 64×48 pixels.

use std::path::Path;

use glam::DVec3;

use super::declared::DeclaredViews;
use super::error::SceneError;
use super::formats::colmap::model::Model;
use super::formats::{colmap, llff, ply, poses_bounds, realestate10k, spaces, transforms};
use super::options::SceneOptions;
use super::photos::source::{Found, ListedPhoto, Photo, PhotoList, PhotoSource};
use super::pose_file::safe_name;
use super::view::{self, View};
use crate::geometry::Size;
use crate::image::ImageRgb;

/// Views and notes, as [`super::Scene::open`] gets them from a scene's files.
pub type Opened = Result<(Vec<View>, Vec<String>), SceneError>;

/// A source that has every photo, 64×48 pixels.
#[derive(Debug)]
struct AnyPhoto;

impl PhotoSource for AnyPhoto {
    fn find(&self, listed: &ListedPhoto<'_>) -> Result<Found, SceneError> {
        let name = safe_name(Path::new("scene"), listed.name)?;
        let path = Path::new("scene").join(&name);
        Ok(Found::Photo(Photo { name, path, size: Size::new(64, 48), ignored: Vec::new() }))
    }

    fn list(&self, folders: &[&str]) -> Result<Option<PhotoList>, SceneError> {
        Ok(folders.first().map(|folder| photos(folder, 2)))
    }

    fn load(&self, _: &str) -> Result<ImageRgb, SceneError> {
        Ok(ImageRgb::new(64, 48, vec![0.5; 3 * 64 * 48])?)
    }
}

/// `1.png`, `2.png`, … in a folder.
fn photos(folder: &str, count: usize) -> PhotoList {
    PhotoList { folder: Some(folder.to_owned()), names: (1..=count).map(|number| format!("{number}.png")).collect() }
}

/// Reads a `transforms.json`.
pub fn transforms(bytes: &[u8]) -> Opened {
    finish(transforms::views(Path::new("scene/transforms.json"), bytes, &AnyPhoto)?)
}

/// Reads the points of a PLY file.
///
/// # Errors
///
/// The message says what is wrong and what was expected.
pub fn ply(bytes: &[u8]) -> Result<Vec<DVec3>, String> {
    ply::points(bytes)
}

/// Reads a `models.json`.
pub fn spaces(bytes: &[u8]) -> Opened {
    finish(spaces::views(Path::new("scene/models.json"), bytes, 0, &AnyPhoto)?)
}

/// Reads a `cameras.txt` with the photos 1 and 2.
pub fn realestate10k(bytes: &[u8]) -> Opened {
    finish(realestate10k::views(Path::new("scene/cameras.txt"), bytes, &photos("frames", 2), &AnyPhoto)?)
}

/// Reads a `poses_bounds.npy` with as many photos as it has rows.
pub fn llff(bytes: &[u8]) -> Opened {
    let path = Path::new("scene/poses_bounds.npy");
    let rows = poses_bounds::parse(path, bytes)?;
    let list = photos("images", rows.len());
    finish(llff::views(path, rows, &list, &AnyPhoto)?)
}

/// Reads `cameras`, `images` and `points3D`, binary or text.
pub fn colmap(binary: bool, [cameras, images, points]: [&[u8]; 3]) -> Opened {
    let format = if binary { colmap::binary::FORMAT } else { colmap::text::FORMAT };
    let mut model = Model::default();
    let listed_in = Path::new("scene/sparse/0/images");
    (format.cameras)(Path::new("scene/sparse/0/cameras"), cameras, &mut model)?;
    (format.images)(listed_in, images, &mut model)?;
    (format.points)(Path::new("scene/sparse/0/points3D"), points, &mut model)?;
    finish(colmap::views(listed_in, &model, &photos("images_2", 2), &AnyPhoto)?)
}

fn finish(found: DeclaredViews) -> Opened {
    view::from_declared(found, &SceneOptions { width: Some(32), ..SceneOptions::default() })
}
