//! Finds the photos that a pose file names.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::Path;

use super::source::{Found, ListedPhoto, Photo, PhotoList, PhotoSource};
use crate::pose_file::{abbreviated, safe_name};
use crate::{DeclaredView, DeclaredViews, SceneError};

/// Finds the photos of one pose file's entries, one by one, and collects their views.
pub(crate) struct PhotoLookup<'a> {
    photos: &'a dyn PhotoSource,
    /// The pose file.
    pub(crate) listed_in: &'a Path,
    pub(crate) views: Vec<DeclaredView>,
    /// Names of the shared photos found so far.
    shared: HashSet<String>,
    notable: Notable,
}

/// What the scene's notes tell of the entries and their photos.
#[derive(Default)]
struct Notable {
    /// Notes on what the entries say, each once.
    assumptions: BTreeSet<String>,
    /// Listed photos that do not exist, with their errors.
    missing: Vec<(String, SceneError)>,
    /// Photos whose name is another than the listed one: both.
    renamed: Vec<String>,
    /// One note per skipped entry.
    skipped: Vec<String>,
    /// Names of the photos by the property of theirs that is ignored.
    ignored: BTreeMap<&'static str, Vec<String>>,
}

impl<'a> PhotoLookup<'a> {
    pub(crate) fn new(photos: &'a dyn PhotoSource, listed_in: &'a Path) -> Self {
        Self { photos, listed_in, views: Vec::new(), shared: HashSet::new(), notable: Notable::default() }
    }

    /// The photo of an entry; `None` if the entry is skipped.
    pub(crate) fn find(&mut self, name: &str) -> Result<Option<Photo>, SceneError> {
        // Windows writes `\` between folders.
        let name = &name.replace('\\', "/");
        let found = match self.photos.find(&ListedPhoto { name, listed_in: self.listed_in }) {
            Err(error @ SceneError::MissingImage { .. }) => {
                self.notable.missing.push((name.clone(), error));
                return Ok(None);
            }
            found => found?,
        };
        if let Found::Photo(photo) | Found::Shared(photo) = &found {
            for property in &photo.ignored {
                self.notable.ignored.entry(property).or_default().push(photo.name.clone());
            }
        }
        Ok(match found {
            Found::Photo(photo) => {
                if !is_listed_as(&photo.name, name) {
                    self.notable.renamed.push(format!("{} for {name}", photo.name));
                }
                Some(photo)
            }
            Found::Shared(photo) => self.shared.insert(photo.name.clone()).then_some(photo),
            Found::Skipped(note) => {
                self.notable.skipped.push(note);
                None
            }
        })
    }

    /// Adds a note on an entry; equal notes become one.
    pub(crate) fn note(&mut self, note: String) {
        self.notable.assumptions.insert(note);
    }

    /// The views, with notes on skipped entries and on ignored properties of photos.
    ///
    /// # Errors
    ///
    /// [`SceneError::MissingImage`] if there are no views and photos are missing.
    pub(crate) fn finish(self) -> Result<DeclaredViews, SceneError> {
        let Self { listed_in, views, notable, .. } = self;
        let Notable { assumptions, missing, renamed, skipped, ignored } = notable;
        let (missing, errors): (Vec<_>, Vec<_>) = missing.into_iter().unzip();
        if let Some(error) = errors.into_iter().next().filter(|_| views.is_empty()) {
            return Err(error);
        }
        let mut notes: Vec<String> = assumptions.into_iter().chain(skipped).collect();
        if !missing.is_empty() {
            let names = abbreviated(&missing);
            notes.push(format!("{} of the listed photos are missing, skipped: {names}", missing.len()));
        }
        if let Some(first) = renamed.first() {
            notes.push(format!(
                "{} photos are found under another name than the listed one, such as {first}",
                renamed.len()
            ));
        }
        notes.extend(ignored.into_iter().map(|(property, names)| format!("{property}: {}", abbreviated(&names))));
        Ok(DeclaredViews { cameras: listed_in.to_owned(), views, notes })
    }
}

/// Whether a photo's name is the listed one, of which an extension may be missing.
fn is_listed_as(name: &str, listed: &str) -> bool {
    let listed = listed.strip_prefix("./").unwrap_or(listed);
    name.strip_prefix(listed).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

/// The photos of the `requested` folder, or of the first of the `usual` ones that the source has.
pub(crate) fn list_photos(
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
