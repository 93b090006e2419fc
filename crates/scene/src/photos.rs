//! The photos of a scene: which exist, their sizes, their pixels; in its folder or from any other source; and
//! how the entries of a pose file are matched with them.
//!
//! A scene's poses are read from files; its photos need not be. [`Scene::open`](crate::Scene::open)
//! uses [`PhotoFolder`]. For photos from elsewhere (the frames of a camera rig,
//! an archive, memory), pass your own source to [`Scene::open_with`](crate::Scene::open_with).
//!
//! Files are not trusted: their memory is checked before it is allocated, and damaged JPEG data is refused.
//! JPEG data has no checksum, and decoders make a picture of nearly any data. The strict decoder refuses files that
//! are cut and undefined codes that it meets; it misses most damage within the data (docs/design-log.md).

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::fmt::Debug;
use std::fs;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};

use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

use crate::scene_file::{abbreviated, below_root, safe_name};
use crate::{DeclaredView, DeclaredViews, Format, SceneError};
use liveview::geometry::Size;
use liveview::image::{Header, ImageError, ImageRgb, decode, encode, read_header, read_size};
use liveview_files::{atomic, bounded, has_extension, memory};

/// A photo that exists.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Photo {
    /// Its name in the source, unique there, with `/` between folders. Views are named after it.
    pub name: String,
    /// The file it comes from, for messages and to protect it from being overwritten by outputs.
    pub path: PathBuf,
    /// Size in pixels.
    pub size: Size,
    /// Properties of the file that are ignored, such as its alpha channel, as text for the scene's
    /// notes.
    pub ignored: Vec<&'static str>,
}

/// A photo as a pose file lists it.
#[derive(Debug, Clone, Copy)]
pub struct ListedPhoto<'a> {
    /// The name as the pose file writes it, with `/` between folders, or the folder and name from
    /// [`PhotoSource::list`].
    pub name: &'a str,
    /// The pose file, for messages.
    pub listed_in: &'a Path,
}

/// The result of looking up a listed photo.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Found {
    /// The photo, which no other entry lists.
    Photo(Photo),
    /// A photo that several entries may list, such as a camera's current frame listed by all names
    /// of its frames. The first such entry becomes a view; the others are skipped without a note.
    Shared(Photo),
    /// The entry is skipped; the text becomes one of the scene's notes.
    Skipped(String),
}

/// Photos of formats that match them by order or by file name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PhotoList {
    /// The folder that holds them; `None` if the source has no folders.
    pub folder: Option<String>,
    /// Their names inside that folder, in byte order.
    pub names: Vec<String>,
}

impl PhotoList {
    /// The name, preceded by the folder.
    pub(crate) fn with_folder(&self, name: &str) -> String {
        self.folder.as_ref().map_or_else(|| name.to_owned(), |folder| format!("{folder}/{name}"))
    }
}

/// Photos by name.
pub trait PhotoSource: Debug + Send + Sync {
    /// Whether a scene of this format can use these photos; otherwise its files are not read.
    fn supports(&self, format: Format) -> bool {
        let _ = format;
        true
    }

    /// Looks up the photo of an entry, without reading its pixels.
    ///
    /// # Errors
    ///
    /// [`SceneError::MissingImage`] if the photo does not exist: its entry is skipped with a note,
    /// and the scene is refused if no other photo exists either. Any other error refuses the scene:
    /// [`SceneError::Malformed`] for a name that points outside the source; [`SceneError::Image`] if
    /// the photo's size cannot be read.
    fn find(&self, listed: &ListedPhoto<'_>) -> Result<Found, SceneError>;

    /// All photos of the first of these folders that exists; `None` if none exists. A source
    /// without folders lists all its photos.
    ///
    /// # Errors
    ///
    /// [`SceneError::Read`] if a folder cannot be read.
    fn list(&self, folders: &[&str]) -> Result<Option<PhotoList>, SceneError>;

    /// Decodes a photo, given the [`Photo::name`] that [`PhotoSource::find`] returned.
    ///
    /// # Errors
    ///
    /// [`SceneError::Image`] if it is damaged, [`SceneError::Read`] if it cannot be read.
    fn load(&self, name: &str) -> Result<ImageRgb, SceneError>;
}

/// Levels of nested folders in which photos are searched.
const MAX_DEPTH: usize = 4;

/// Folders of reduced copies of the photos in `images`, the largest first.
const REDUCED: [&str; 3] = ["images_2", "images_4", "images_8"];

/// PNG and JPEG files in a folder, named by their path relative to it. A photo that a pose file
/// lists is looked for by its path; by shorter and shorter ends of it, since folders are moved; with
/// another extension; and, where there is no folder `images`, in `images_2`, `images_4` or
/// `images_8`. Always inside the folder: a path with `..` is refused.
#[derive(Debug, Clone)]
pub struct PhotoFolder {
    root: PathBuf,
}

impl PhotoFolder {
    /// The photos in this folder and its subfolders.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The photo of that name, or with another extension, or in a folder of reduced copies.
    fn existing(&self, name: &str) -> Option<String> {
        let rest = name.strip_prefix("images/").filter(|_| !self.root.join("images").is_dir());
        let reduced = rest.map(|rest| REDUCED.map(|folder| format!("{folder}/{rest}")));
        let folders = std::iter::once(name.to_owned()).chain(reduced.into_iter().flatten());
        let mut names = folders.flat_map(|name| [vec![name.clone()], other_extensions(&name)].concat());
        names.find(|name| self.root.join(name).is_file())
    }
}

impl PhotoSource for PhotoFolder {
    fn find(&self, listed: &ListedPhoto<'_>) -> Result<Found, SceneError> {
        let name = safe_name(listed.listed_in, below_root(listed.name))?;
        // Poses may have been estimated in another folder: then the end of the path names the photo.
        let ends = name.rmatch_indices('/').take(MAX_DEPTH + 1).map(|(at, _)| &name[at + 1..]);
        let ends: Vec<&str> = ends.collect();
        let mut names = std::iter::once(&*name).chain(ends.into_iter().rev());
        let Some(name) = names.find_map(|name| self.existing(name)) else {
            let (path, listed_in) = (self.root.join(listed.name), listed.listed_in.to_owned());
            return Err(SceneError::MissingImage { path, listed_in });
        };
        let path = self.root.join(&name);
        let Header { size, oriented, alpha, .. } = read_header(&path)?;
        let orientation =
            oriented.then_some("EXIF orientation ignored, poses are assumed to belong to the pixels as stored");
        let alpha = alpha.then_some("alpha channel dropped, colours used as stored");
        let ignored = orientation.into_iter().chain(alpha).collect();
        Ok(Found::Photo(Photo { name, path, size, ignored }))
    }

    fn list(&self, folders: &[&str]) -> Result<Option<PhotoList>, SceneError> {
        let Some(&folder) = folders.iter().find(|folder| self.root.join(folder).is_dir()) else { return Ok(None) };
        let mut names = Vec::new();
        collect(&self.root.join(folder), "", MAX_DEPTH, &mut names)?;
        names.sort();
        Ok(Some(PhotoList { folder: Some(folder.to_owned()), names }))
    }

    fn load(&self, name: &str) -> Result<ImageRgb, SceneError> {
        load_photo(&self.root.join(name))
    }
}

/// `name` with an extension added, then with its extension replaced.
fn other_extensions(name: &str) -> Vec<String> {
    let stem = match name.rsplit_once('.') {
        Some((stem, extension)) if !extension.contains('/') => stem,
        _ => name,
    };
    let endings = ["png", "jpg", "jpeg", "PNG", "JPG", "JPEG"];
    [name, stem].iter().flat_map(|base| endings.map(|ending| format!("{base}.{ending}"))).collect()
}

/// Adds the names of the photos in `folder` and its subfolders, each preceded by `prefix`.
fn collect(folder: &Path, prefix: &str, depth: usize, names: &mut Vec<String>) -> Result<(), SceneError> {
    let failed = |source| SceneError::Read { path: folder.to_owned(), source };
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        // No scene file can list a name that is not UTF-8.
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
        if name.starts_with('.') {
            continue;
        }
        if path.is_dir() {
            if depth > 0 {
                collect(&path, &format!("{prefix}{name}/"), depth - 1, names)?;
            }
        } else if has_extension(&path, &["png", "jpg", "jpeg"]) {
            names.push(format!("{prefix}{name}"));
        }
    }
    Ok(())
}

/// Peak memory per pixel while a photo is decoded, converted to f32 and then undistorted, resized
/// or copied to a texture: two f32 RGB buffers and 8 bytes for the decoder.
const BYTES_PER_PIXEL: u64 = 32;

/// Decodes a PNG or JPEG file.
///
/// # Errors
///
/// [`SceneError::PhotoMemory`]; [`SceneError::Image`] for a file that cannot be read, is too large, damaged, or
/// ends early.
pub fn load_photo(path: &Path) -> Result<ImageRgb, SceneError> {
    let size = read_size(path)?;
    let check = memory::check(BYTES_PER_PIXEL * size.pixels() as u64);
    check.map_err(|source| SceneError::PhotoMemory { path: path.to_owned(), size, source })?;
    let bytes = bounded::read(path, bounded::MAX_BYTES);
    let bytes = bytes.map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
    if !bytes.starts_with(&[0xFF, 0xD8]) {
        return Ok(decode(path, &bytes)?);
    }
    if is_sampled_finely(&bytes) {
        let reason = "a JPEG component is sampled more finely than the first one".to_owned();
        return Err(ImageError::Decode { path: path.to_owned(), reason }.into());
    }
    // If the decoder panics on other damage, the error names the file; none of its state outlives the call.
    let decoded = catch_unwind(|| decode_jpeg(&bytes, size)).unwrap_or_else(|_| Err("the decoder failed".to_owned()));
    Ok(decoded.map_err(|reason| ImageError::Decode { path: path.to_owned(), reason })?)
}

/// Writes a complete picture or no file, as JPEG if the name ends in .jpg or .jpeg, else as PNG.
///
/// # Errors
///
/// Those of [`ImageRgb::save`].
pub fn save_picture(picture: &ImageRgb, path: &Path) -> Result<(), ImageError> {
    let failed = |source| ImageError::Write { path: path.to_owned(), source };
    atomic::write(path, &encode(path, picture)?).map_err(failed)
}

fn decode_jpeg(bytes: &[u8], size: Size) -> Result<ImageRgb, String> {
    let options = DecoderOptions::default().set_strict_mode(true).set_max_width(size.width);
    let options = options.set_max_height(size.height).jpeg_set_out_colorspace(ColorSpace::RGB);
    let rgb = JpegDecoder::new_with_options(ZCursor::new(bytes), options).decode();
    let rgb = rgb.map_err(|error| format!("damaged JPEG data: {error:?}"))?;
    let values = rgb.into_iter().map(|value| f32::from(value) / 255.0).collect();
    ImageRgb::new(size.width, size.height, values).map_err(|error| error.to_string())
}

/// Whether a component is sampled more finely than the first one, on which the decoder panics.
fn is_sampled_finely(bytes: &[u8]) -> bool {
    let mut at = 2; // past the start-of-image marker
    while let Some(&[0xFF, marker, high, low]) = bytes.get(at..at + 4) {
        let segment = at + 4;
        if matches!(marker, 0xC0..=0xC2) {
            let count = bytes.get(segment + 5).copied().unwrap_or(0);
            let components = bytes.get(segment + 6..).unwrap_or_default().chunks_exact(3).take(count.into());
            let factors: Vec<(u8, u8)> = components.map(|component| (component[1] >> 4, component[1] & 15)).collect();
            return factors.iter().any(|&(across, down)| across > factors[0].0 || down > factors[0].1);
        }
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
    }
    false
}

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
