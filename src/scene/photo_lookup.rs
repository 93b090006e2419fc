//! From the names in a pose file to photos of a source.

use std::collections::HashSet;
use std::path::Path;

use super::error::SceneError;
use super::photo_source::{Found, ListedPhoto, Photo, PhotoList, PhotoSource};
use super::pose_file::safe_name;

/// The photos of one pose file's entries, found one after the other.
pub(super) struct PhotoLookup<'a> {
    photos: &'a dyn PhotoSource,
    listed_in: &'a Path,
    any_extension: bool,
    /// Names of the photos found so far that have many names.
    taken: HashSet<String>,
    /// Of entries left out.
    notes: Vec<String>,
}

impl<'a> PhotoLookup<'a> {
    pub(super) fn new(photos: &'a dyn PhotoSource, listed_in: &'a Path) -> Self {
        Self { photos, listed_in, any_extension: false, taken: HashSet::new(), notes: Vec::new() }
    }

    /// Photos may have another image extension than the one listed.
    pub(super) fn any_extension(self, any_extension: bool) -> Self {
        Self { any_extension, ..self }
    }

    /// The photo of an entry; `None` if the entry is to be left out.
    pub(super) fn find(&mut self, name: &str) -> Result<Option<Photo>, SceneError> {
        let listed = ListedPhoto { name, listed_in: self.listed_in, any_extension: self.any_extension };
        Ok(match self.photos.find(&listed)? {
            Found::Photo(photo) => Some(photo),
            Found::OneOfMany(photo) => self.taken.insert(photo.name.clone()).then_some(photo),
            Found::LeftOut(note) => {
                self.notes.push(note);
                None
            }
        })
    }

    /// What is to be told about entries left out.
    pub(super) fn into_notes(self) -> Vec<String> {
        self.notes
    }
}

/// The photos of the first of the `usual` folders that the source has, or of the one asked for.
pub(super) fn list_photos(
    root: &Path,
    photos: &dyn PhotoSource,
    asked: Option<&str>,
    usual: &[&str],
) -> Result<PhotoList, SceneError> {
    let found = match asked {
        // A source without folders does not have this one.
        Some(name) => photos.list(&[&safe_name(root, name)?])?.filter(|list| list.folder.is_some()),
        None => photos.list(usual)?,
    };
    let wanted = asked.map_or_else(|| usual.join(", "), str::to_owned);
    found.ok_or_else(|| SceneError::malformed(root, "no folder of photos", format!("one of: {wanted}")))
}
