//! From the names in a pose file to photos of a source.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use super::error::SceneError;
use super::photo_source::{Found, ListedPhoto, Photo, PhotoList, PhotoSource};
use super::pose_file::{safe_name, some_of};

/// The photos of one pose file's entries, found one after the other.
pub(super) struct PhotoLookup<'a> {
    photos: &'a dyn PhotoSource,
    listed_in: &'a Path,
    any_extension: bool,
    /// Names of the photos found so far that have many names.
    taken: HashSet<String>,
    /// Of entries left out.
    notes: Vec<String>,
    /// What is not used of which photos.
    ignored: BTreeMap<&'static str, Vec<String>>,
}

impl<'a> PhotoLookup<'a> {
    pub(super) fn new(photos: &'a dyn PhotoSource, listed_in: &'a Path) -> Self {
        Self {
            photos,
            listed_in,
            any_extension: false,
            taken: HashSet::new(),
            notes: Vec::new(),
            ignored: BTreeMap::new(),
        }
    }

    /// Photos may have another image extension than the one listed.
    pub(super) fn any_extension(self, any_extension: bool) -> Self {
        Self { any_extension, ..self }
    }

    /// The photo of an entry; `None` if the entry is to be left out.
    pub(super) fn find(&mut self, name: &str) -> Result<Option<Photo>, SceneError> {
        let listed = ListedPhoto { name, listed_in: self.listed_in, any_extension: self.any_extension };
        let found = self.photos.find(&listed)?;
        if let Found::Photo(photo) | Found::OneOfMany(photo) = &found {
            for what in &photo.ignored {
                self.ignored.entry(what).or_default().push(photo.name.clone());
            }
        }
        Ok(match found {
            Found::Photo(photo) => Some(photo),
            Found::OneOfMany(photo) => self.taken.insert(photo.name.clone()).then_some(photo),
            Found::LeftOut(note) => {
                self.notes.push(note);
                None
            }
        })
    }

    /// What is to be told about entries left out, and about what is not used of photos.
    pub(super) fn into_notes(self) -> Vec<String> {
        let Self { mut notes, ignored, .. } = self;
        notes.extend(ignored.into_iter().map(|(what, names)| format!("{what}: {}", some_of(&names))));
        notes
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
