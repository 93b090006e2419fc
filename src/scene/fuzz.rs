//! The readers without a file system, for the fuzz targets (`tests/fuzz`): every photo that a file names exists, 64×48.

use std::path::Path;

use super::colmap::{self, Model};
use super::draft::{self, Drafts};
use super::files::{Photo, safe_name};
use super::{SceneError, SceneOptions, View, colmap_binary, colmap_text, llff, poses_bounds};
use super::{realestate10k, spaces, transforms};

/// What [`super::Scene::open`] makes of a scene's files.
pub type Opened = Result<(Vec<View>, Vec<String>), SceneError>;

/// Names of the photos of formats that go by what lies in the folder.
const NAMES: [&str; 2] = ["1.png", "2.png"];

/// `transforms.json`.
pub fn transforms(bytes: &[u8]) -> Opened {
    finish(transforms::drafts(Path::new("scene/transforms.json"), bytes, &photo)?)
}

/// `models.json`.
pub fn spaces(bytes: &[u8]) -> Opened {
    finish(spaces::drafts(Path::new("scene/models.json"), bytes, 0, &photo)?)
}

/// `cameras.txt`, beside the pictures 1 and 2.
pub fn realestate10k(bytes: &[u8]) -> Opened {
    let names = NAMES.map(str::to_owned);
    finish(realestate10k::drafts(Path::new("scene/cameras.txt"), bytes, "frames", &names, &photo)?)
}

/// `poses_bounds.npy`, beside as many photos as it has rows.
pub fn llff(bytes: &[u8]) -> Opened {
    let path = Path::new("scene/poses_bounds.npy");
    let rows = poses_bounds::parse(path, bytes)?;
    let names: Vec<String> = (0..rows.len()).map(|row| format!("{row}.png")).collect();
    finish(llff::drafts(path, rows, "images", &names, &photo)?)
}

/// `cameras`, `images` and `points3D`, binary or text.
pub fn colmap(binary: bool, [cameras, images, points]: [&[u8]; 3]) -> Opened {
    let format = if binary { colmap_binary::FORMAT } else { colmap_text::FORMAT };
    let mut model = Model::default();
    let listed_in = Path::new("scene/sparse/0/images");
    (format.cameras)(Path::new("scene/sparse/0/cameras"), cameras, &mut model)?;
    (format.images)(listed_in, images, &mut model)?;
    (format.points)(Path::new("scene/sparse/0/points3D"), points, &mut model)?;
    finish(colmap::drafts(listed_in, &model, "images_2", &photo)?)
}

fn photo(name: &str) -> Result<Photo, SceneError> {
    Ok(Photo { name: safe_name(Path::new("scene"), name)?, width: 64, height: 48 })
}

fn finish(found: Drafts) -> Opened {
    draft::finish(Path::new("scene"), found, &SceneOptions { width: Some(32), ..SceneOptions::default() })
}
