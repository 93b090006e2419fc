//! Scene readers without a file system, for the fuzz targets (`tests/fuzz`): every photo that a
//! file names exists and is 64×48 pixels.

#![expect(clippy::missing_errors_doc, reason = "one error, the reader's")]

use std::path::Path;

use crate::formats::colmap::Model;
use crate::formats::{
    Views, colmap, gaussians, llff, metashape, opensfm, realestate10k, realitycapture, spaces, transforms,
};
use crate::photos::PhotoLookup;
use crate::scene_file::{self, safe_name};
use crate::{DeclaredViews, Found, ListedPhoto, Photo, PhotoList, PhotoSource, SceneError, SceneOptions, View, view};
use liveview::geometry::Size;
use liveview::image::ImageRgb;

/// Views and notes, as [`crate::Scene::open`] gets them from a scene's files.
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
    let path = Path::new("scene/transforms.json");
    finish(transforms::views(&scene_file::parse(path, bytes)?, None, PhotoLookup::new(&AnyPhoto, path))?)
}

/// Reads a `models.json`.
pub fn spaces(bytes: &[u8]) -> Opened {
    alone(spaces::views, "models.json", bytes)
}

/// Reads a `cameras.json` of 3D Gaussian Splatting.
pub fn gaussians(bytes: &[u8]) -> Opened {
    alone(gaussians::views, "cameras.json", bytes)
}

/// Reads the cameras that Metashape exports.
pub fn metashape(bytes: &[u8]) -> Opened {
    alone(metashape::views, "cameras.xml", bytes)
}

/// Reads the camera parameters that RealityCapture exports.
pub fn realitycapture(bytes: &[u8]) -> Opened {
    alone(realitycapture::views, "cameras.csv", bytes)
}

/// Reads a `reconstruction.json` of OpenSfM.
pub fn opensfm(bytes: &[u8]) -> Opened {
    alone(opensfm::views, "reconstruction.json", bytes)
}

/// Reads a file that is all that its format has.
fn alone(views: Views, name: &str, bytes: &[u8]) -> Opened {
    let path = Path::new("scene").join(name);
    finish(views(bytes, &SceneOptions::default(), PhotoLookup::new(&AnyPhoto, &path))?)
}

/// Reads a `cameras.txt` with the photos 1 and 2.
pub fn realestate10k(bytes: &[u8]) -> Opened {
    let lookup = PhotoLookup::new(&AnyPhoto, Path::new("scene/cameras.txt"));
    finish(realestate10k::views(bytes, &photos("frames", 2), lookup)?)
}

/// Reads a `poses_bounds.npy` with as many photos as it has rows.
pub fn llff(bytes: &[u8]) -> Opened {
    let path = Path::new("scene/poses_bounds.npy");
    let rows = llff::parse(path, bytes, None)?;
    let list = photos("images", rows.len());
    finish(llff::views(&rows, None, &list, PhotoLookup::new(&AnyPhoto, path))?)
}

/// Reads `cameras`, `images` and `points3D`, binary or text.
pub fn colmap(binary: bool, [cameras, images, points]: [&[u8]; 3]) -> Opened {
    let format = if binary { colmap::binary::FORMAT } else { colmap::text::FORMAT };
    let mut model = Model::default();
    let listed_in = Path::new("scene/sparse/0/images");
    (format.cameras)(Path::new("scene/sparse/0/cameras"), cameras, &mut model)?;
    (format.images)(listed_in, images, &mut model)?;
    (format.points)(Path::new("scene/sparse/0/points3D"), points, &mut model)?;
    finish(colmap::views(&model, &photos("images_2", 2), PhotoLookup::new(&AnyPhoto, listed_in))?)
}

fn finish(found: DeclaredViews) -> Opened {
    view::from_declared(found, &SceneOptions { width: Some(32), ..SceneOptions::default() }, false)
}
