//! Photos in memory.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::source::{Found, ListedPhoto, Photo, PhotoList, PhotoSource};
use crate::image::ImageRgb;
use crate::scene::error::SceneError;

/// Photos in memory, by name.
#[derive(Debug)]
pub(in crate::scene) struct MemoryPhotos {
    photos: BTreeMap<String, ImageRgb>,
}

impl MemoryPhotos {
    pub(in crate::scene) fn new(photos: BTreeMap<String, ImageRgb>) -> Self {
        Self { photos }
    }
}

impl PhotoSource for MemoryPhotos {
    fn find(&self, listed: &ListedPhoto<'_>) -> Result<Found, SceneError> {
        let (name, path) = (listed.name.to_owned(), PathBuf::from(listed.name));
        let Some(photo) = self.photos.get(listed.name) else {
            return Err(SceneError::MissingImage { path, listed_in: listed.listed_in.to_owned() });
        };
        Ok(Found::Photo(Photo { name, path, size: photo.size(), ignored: Vec::new() }))
    }

    fn list(&self, _: &[&str]) -> Result<Option<PhotoList>, SceneError> {
        Ok(Some(PhotoList { folder: None, names: self.photos.keys().cloned().collect() }))
    }

    fn load(&self, name: &str) -> Result<ImageRgb, SceneError> {
        let missing = || SceneError::MissingImage { path: name.into(), listed_in: "memory".into() };
        self.photos.get(name).cloned().ok_or_else(missing)
    }
}
