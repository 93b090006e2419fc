//! Finds the photos that a pose file names.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use super::error::SceneError;
use super::photo_source::{Found, ListedPhoto, Photo, PhotoList, PhotoSource};
use super::pose_file::{abbreviated, safe_name};

/// Finds the photos of one pose file's entries, one by one.
pub(super) struct PhotoLookup<'a> {
    photos: &'a dyn PhotoSource,
    listed_in: &'a Path,
    any_extension: bool,
    /// Names of the shared photos found so far.
    shared: HashSet<String>,
    /// One note per skipped entry.
    notes: Vec<String>,
    /// Names of the photos by the property of theirs that is ignored.
    ignored: BTreeMap<&'static str, Vec<String>>,
}

impl<'a> PhotoLookup<'a> {
    pub(super) fn new(photos: &'a dyn PhotoSource, listed_in: &'a Path) -> Self {
        Self {
            photos,
            listed_in,
            any_extension: false,
            shared: HashSet::new(),
            notes: Vec::new(),
            ignored: BTreeMap::new(),
        }
    }

    /// Whether a photo may have another image extension than the listed one.
    pub(super) fn any_extension(self, any_extension: bool) -> Self {
        Self { any_extension, ..self }
    }

    /// The photo of an entry; `None` if the entry is skipped.
    pub(super) fn find(&mut self, name: &str) -> Result<Option<Photo>, SceneError> {
        let listed = ListedPhoto { name, listed_in: self.listed_in, any_extension: self.any_extension };
        let found = self.photos.find(&listed)?;
        if let Found::Photo(photo) | Found::Shared(photo) = &found {
            for property in &photo.ignored {
                self.ignored.entry(property).or_default().push(photo.name.clone());
            }
        }
        Ok(match found {
            Found::Photo(photo) => Some(photo),
            Found::Shared(photo) => self.shared.insert(photo.name.clone()).then_some(photo),
            Found::Skipped(note) => {
                self.notes.push(note);
                None
            }
        })
    }

    /// The scene's notes on skipped entries and on ignored properties of photos.
    pub(super) fn into_notes(self) -> Vec<String> {
        let Self { mut notes, ignored, .. } = self;
        notes.extend(ignored.into_iter().map(|(property, names)| format!("{property}: {}", abbreviated(&names))));
        notes
    }
}

/// The photos of the `requested` folder, or of the first of the `usual` ones that the source has.
pub(super) fn list_photos(
    root: &Path,
    photos: &dyn PhotoSource,
    requested: Option<&str>,
    usual: &[&str],
) -> Result<PhotoList, SceneError> {
    let found = match requested {
        // A source without folders cannot have the requested one.
        Some(name) => photos.list(&[&safe_name(root, name)?])?.filter(|list| list.folder.is_some()),
        None => photos.list(usual)?,
    };
    let expected = requested.map_or_else(|| usual.join(", "), str::to_owned);
    found.ok_or_else(|| SceneError::malformed(root, "no photo folder", format!("one of: {expected}")))
}
