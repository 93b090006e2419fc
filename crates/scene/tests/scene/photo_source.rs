//! Scenes whose photos come from another source than the scene folder.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use liveview::geometry::Size;
use liveview::image::ImageRgb;
use liveview_scene::{Format, Found, ListedPhoto, Photo, PhotoList, PhotoSource, Scene, SceneError, SceneOptions};
use tempfile::tempdir;

use crate::scene_common::{Colmap, LLFF_ROW, assert_says, notes, poses_bounds, transforms, write};

/// Grey photos of 64×48: `a.png` to `c.png`, and `d`, which every name in a folder `d` shares.
#[derive(Debug)]
struct Grey {
    folder: Option<&'static str>,
}

impl PhotoSource for Grey {
    fn supports(&self, format: Format) -> bool {
        format != Format::Spaces
    }

    fn find(&self, listed: &ListedPhoto<'_>) -> Result<Found, SceneError> {
        let photo = |name: &str| Photo {
            name: name.into(),
            path: PathBuf::from("memory"),
            size: Size::new(64, 48),
            ignored: Vec::new(),
        };
        let file = listed.name.rsplit('/').next().unwrap_or_default();
        Ok(match file {
            "a.png" | "b.png" | "c.png" => Found::Photo(photo(listed.name)),
            _ if listed.name.contains("d/") => Found::Shared(photo("d")),
            "lost.png" => {
                let (path, listed_in) = (PathBuf::from("lost"), listed.listed_in.to_owned());
                return Err(SceneError::MissingImage { path, listed_in });
            }
            _ => Found::Skipped(format!("{file} does not exist")),
        })
    }

    fn list(&self, folders: &[&str]) -> Result<Option<PhotoList>, SceneError> {
        let names = ["a.png", "b.png", "c.png"].map(str::to_owned).to_vec();
        let folder = self.folder.filter(|folder| folders.contains(folder)).map(str::to_owned);
        Ok((folder.is_some() || self.folder.is_none()).then_some(PhotoList { folder, names }))
    }

    fn load(&self, name: &str) -> Result<ImageRgb, SceneError> {
        Ok(ImageRgb::new(64, 48, vec![if name == "d" { 0.25 } else { 0.5 }; 3 * 64 * 48])?)
    }
}

fn open(root: &Path, folder: Option<&'static str>) -> Result<Scene, SceneError> {
    Scene::open_with(root, Arc::new(Grey { folder }), &SceneOptions::default())
}

fn names(scene: &Scene) -> Vec<&str> {
    scene.views.iter().map(|view| view.name.as_str()).collect()
}

/// Writes a `transforms.json` with these entries.
fn write_entries(root: &Path, entries: &[&str]) {
    let pose = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]";
    let frame = |entry: &&str| format!("{{\"file_path\": \"{entry}\", \"transform_matrix\": {pose}}}");
    let frames = entries.iter().map(frame).collect::<Vec<_>>().join(", ");
    write(&root.join("transforms.json"), format!("{{\"fl_x\": 50, \"w\": 64, \"h\": 48, \"frames\": [{frames}]}}"));
}

#[test]
fn entries_are_found_shared_skipped_or_errors_as_the_source_decides() {
    let root = tempdir().unwrap();
    write_entries(root.path(), &["a.png", "d/7.png", "../d/8.png", "other.png", "b.png"]);
    let scene = open(root.path(), None).unwrap();
    assert_eq!(names(&scene), ["a.png", "b.png", "d"]);
    assert_eq!(scene.notes, ["other.png does not exist"]);
    assert_eq!(scene.load_image(2).unwrap().pixel(3, 3), [0.25; 3]);
    assert_eq!(scene.views[2].image_path(), Path::new("memory"));
    // An unshared photo must not be listed twice.
    write_entries(root.path(), &["a.png", "a.png"]);
    assert_eq!(open(root.path(), None).unwrap().notes, ["listed twice with the same pose, read once: a.png"]);
    write_entries(root.path(), &["a.png", "lost.png"]);
    assert_eq!(open(root.path(), None).unwrap().notes, ["1 of the listed photos are missing, skipped: lost.png"]);
    write_entries(root.path(), &["lost.png"]);
    assert_says(&open(root.path(), None).unwrap_err().to_string(), &["lost: missing image, listed in"]);
    write_entries(root.path(), &["other.png"]);
    assert_says(&open(root.path(), None).unwrap_err().to_string(), &["no views; expected at least one"]);
}

#[test]
fn skipped_entry_is_not_validated() {
    let root = tempdir().unwrap();
    for (name, refused) in [("other.png", false), ("b.png", true)] {
        transforms(root.path(), "\"frames\": [", &format!("\"frames\": [{{\"file_path\": \"{name}\", \"k4\": 1}},"));
        match open(root.path(), None) {
            Ok(scene) => assert!(!refused && names(&scene) == ["a.png"], "{name}"),
            Err(error) => assert!(refused && error.to_string().contains("k4 = 1 is not supported"), "{error}"),
        }
    }
}

#[test]
fn llff_photos_come_from_the_sources_folder_or_from_all_its_photos() {
    let root = tempdir().unwrap();
    poses_bounds(&root.path().join("poses_bounds.npy"), &[LLFF_ROW; 3]);
    let scene = open(root.path(), Some("images_4")).unwrap();
    assert_eq!(
        (names(&scene), scene.notes.as_slice()),
        (vec!["a.png", "b.png", "c.png"], &["photos are read from images_4".to_owned()][..])
    );
    let scene = open(root.path(), None).unwrap();
    assert_eq!((scene.views.len(), scene.notes.len()), (3, 0));
    assert_says(
        &open(root.path(), Some("elsewhere")).unwrap_err().to_string(),
        &["no photo folder; expected one of: images_8"],
    );
    let options = SceneOptions { images: Some("images".to_owned()), ..SceneOptions::default() };
    let error = Scene::open_with(root.path(), Arc::new(Grey { folder: None }), &options).unwrap_err().to_string();
    assert_says(&error, &["no photo folder; expected one of: images"]);
    poses_bounds(&root.path().join("poses_bounds.npy"), &[LLFF_ROW; 2]);
    let error = open(root.path(), None).unwrap_err().to_string();
    assert_says(&error, &["2 poses, but", &format!("{} holds 3 images", root.path().display())]);
}

#[test]
fn colmap_names_have_no_folder_in_a_source_without_folders() {
    let root = tempdir().unwrap();
    Colmap { camera: Colmap::PINHOLE, names: &["b.png", "d/2.png"] }.write_text(&root.path().join("sparse/0"));
    let scene = open(root.path(), None).unwrap();
    assert_eq!(names(&scene), ["b.png", "d"]);
    assert_says(&notes(&scene), &["2 photos were not registered by COLMAP, skipped: a.png, c.png"]);
}

#[test]
fn format_that_the_source_does_not_support_is_not_read() {
    let root = tempdir().unwrap();
    write(&root.path().join("models.json"), "[]");
    assert_says(&open(root.path(), None).unwrap_err().to_string(), &["no scene found"]);
    Colmap { camera: Colmap::PINHOLE, names: &["b.png"] }.write_text(&root.path().join("sparse/0"));
    let scene = open(root.path(), None).unwrap();
    assert!(scene.format == Format::Colmap && !scene.notes.iter().any(|note| note.contains("Spaces")));
}

#[test]
fn photos_in_memory_are_those_of_a_folder() {
    let root = tempdir().unwrap();
    transforms(root.path(), "", "");
    let options = SceneOptions { width: Some(20), ..SceneOptions::default() };
    let folder = Scene::open(root.path(), &options).unwrap();
    let photo = ImageRgb::from(&image::open(root.path().join("images/a.png")).unwrap().to_rgb8());
    let camera = folder.views[0].native_camera().clone();
    let scene = Scene::in_memory([("a.png".to_owned(), photo, camera)], &options).unwrap();
    assert_eq!((scene.format, names(&scene)), (Format::Memory, names(&folder)));
    assert_eq!(scene.views[0].camera, folder.views[0].camera);
    assert_eq!(scene.load_image(0).unwrap(), folder.load_image(0).unwrap());
}

#[test]
fn invalid_photos_in_memory_are_errors() {
    let root = tempdir().unwrap();
    transforms(root.path(), "", "");
    let camera = open(root.path(), None).unwrap().views[0].camera.clone();
    let photo = |width, value| ImageRgb::new(width, 48, vec![value; 3 * 48 * width]).unwrap();
    let refused = |photos: &[(&str, ImageRgb)]| {
        let photos = photos.iter().map(|(name, photo)| ((*name).to_owned(), photo.clone(), camera.clone()));
        Scene::in_memory(photos, &SceneOptions::default()).unwrap_err().to_string()
    };
    assert_says(&refused(&[]), &["memory: no views; expected at least one"]);
    assert_says(&refused(&[("a", photo(64, 0.5)), ("a", photo(64, 0.5))]), &["\"a\" is listed twice"]);
    assert_says(&refused(&[("a", photo(60, 0.5))]), &["a: the image is 60x48", "declares 64x48"]);
    assert_says(&refused(&[("a", photo(64, 255.0))]), &["a: a value of the photo is 255; expected values in [0, 1]"]);
    assert_says(&refused(&[("a", photo(64, f32::NAN))]), &["a: a value of the photo is NaN"]);
}
