//! The photos of a scene: which exist, their sizes, their pixels; and how the entries of a pose file are matched
//! with them.
//!
//! A scene's poses are read from files; its photos need not be. [`Scene::open`](crate::Scene::open)
//! uses [`PhotoFolder`](crate::PhotoFolder). For photos from elsewhere (the frames of a camera rig,
//! an archive, memory), pass your own source to [`Scene::open_with`](crate::Scene::open_with).
//!
//! Files are not trusted: their memory is checked before it is allocated, and damaged JPEG data is refused.
//! JPEG data has no checksum, and decoders make a picture of nearly any data. The strict decoder refuses files that
//! are cut and undefined codes that it meets; it misses most damage within the data (docs/design-log.md).

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::fmt::Debug;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};

use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

use crate::scene_file::{abbreviated, safe_name};
use crate::{DeclaredView, DeclaredViews, Format, SceneError};
use liveview::geometry::Size;
use liveview::image::{ImageError, ImageRgb, decode, encode, read_size};
use liveview_files::{atomic, bounded, memory};

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
        let folder = self.folder.as_ref().filter(|folder| !folder.is_empty());
        folder.map_or_else(|| name.to_owned(), |folder| format!("{folder}/{name}"))
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
    /// [`SceneError::MissingImage`] if the photo does not exist, [`SceneError::Image`] if it cannot be
    /// read: its entry is skipped with a note, and the scene is refused if there is no other photo, or
    /// if most cannot be read. Any other error refuses the scene.
    fn find(&self, listed: &ListedPhoto<'_>) -> Result<Found, SceneError>;

    /// All photos of the first of these folders that holds any; `None` if none does. A source
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

/// Peak memory per pixel while a photo is decoded, converted to f32 and then undistorted, resized
/// or copied to a texture: two f32 RGB buffers and 8 bytes for the decoder.
const BYTES_PER_PIXEL: u64 = 32;

/// Decodes a picture file, transparent pixels on a background (RGB).
///
/// # Errors
///
/// [`SceneError::Malformed`] if it needs more memory than is available; [`SceneError::Image`] for a file that cannot be read, is too large, damaged, or
/// ends early.
pub fn load_photo(path: &Path, background: [f32; 3]) -> Result<ImageRgb, SceneError> {
    let size = read_size(path)?;
    let check = memory::check(BYTES_PER_PIXEL * size.pixels() as u64, 0);
    let refused = |error| SceneError::malformed(path, format!("the image is {size}, which {error}"), "a smaller image");
    check.map_err(refused)?;
    let bytes = bounded::read(path, bounded::MAX_BYTES);
    let bytes = bytes.map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
    if !bytes.starts_with(&[0xFF, 0xD8]) {
        return Ok(decode(path, &bytes, background)?);
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

/// The segments of a JPEG before its first scan, and that scan: marker, and where its content begins.
fn segments(bytes: &[u8]) -> impl Iterator<Item = (u8, usize)> {
    let mut at = 2; // past the start-of-image marker
    std::iter::from_fn(move || {
        let Some(&[0xFF, marker, high, low]) = bytes.get(at..at + 4) else { return None };
        let content = at + 4;
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
        Some((marker, content))
    })
}

/// Where the first scan of a JPEG begins.
pub(crate) fn scan_start(bytes: &[u8]) -> Option<usize> {
    segments(bytes).find(|&(marker, _)| marker == 0xDA).map(|(_, content)| content)
}

/// Whether a component is sampled more finely than the first one, on which the decoder panics.
fn is_sampled_finely(bytes: &[u8]) -> bool {
    let Some((_, segment)) = segments(bytes).find(|(marker, _)| matches!(marker, 0xC0..=0xC2)) else { return false };
    let count = bytes.get(segment + 5).copied().unwrap_or(0);
    let components = bytes.get(segment + 6..).unwrap_or_default().chunks_exact(3).take(count.into());
    let factors: Vec<(u8, u8)> = components.map(|component| (component[1] >> 4, component[1] & 15)).collect();
    factors.iter().any(|&(across, down)| across > factors[0].0 || down > factors[0].1)
}

/// Finds the photos of one pose file's entries, one by one, and collects their views.
pub(crate) struct PhotoLookup<'a> {
    pub(crate) photos: &'a dyn PhotoSource,
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
    /// Listed photos that do not exist or cannot be read, or whose pose is not usable, with their errors.
    left_out: Vec<(String, SceneError)>,
    /// Photos whose name is another than the listed one: which view they become, both names.
    renamed: Vec<(usize, String, String)>,
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
            Err(error @ (SceneError::MissingImage { .. } | SceneError::Image(_))) => {
                self.leave_out(name, error);
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
                // The extension may be missing.
                let rest = photo.name.strip_prefix(name.strip_prefix("./").unwrap_or(name));
                if !rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.')) {
                    self.notable.renamed.push((self.views.len(), photo.name.clone(), name.clone()));
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

    /// Leaves out an entry, whose photo or pose is not usable.
    pub(crate) fn leave_out(&mut self, name: &str, error: SceneError) {
        self.notable.left_out.push((name.to_owned(), error));
    }

    /// Adds a note on an entry; equal notes become one.
    pub(crate) fn note(&mut self, note: String) {
        self.notable.assumptions.insert(note);
    }

    /// The views, with notes on skipped entries and on ignored properties of photos.
    ///
    /// # Errors
    ///
    /// The first of the left-out entries if there are no views, or if more photos cannot be read than can.
    pub(crate) fn finish(self) -> Result<DeclaredViews, SceneError> {
        let Self { listed_in, mut views, notable, .. } = self;
        let Notable { assumptions, mut left_out, renamed, skipped, ignored } = notable;
        // A photo that an entry lists by its own name is not that of another entry.
        let is_renamed =
            |view: usize| renamed.iter().any(|(at, found, _)| (*at, found) == (view, &views[view].photo.name));
        let own = (0..views.len()).filter(|&view| !is_renamed(view)).map(|view| views[view].photo.name.clone());
        let own: HashSet<String> = own.collect();
        let (taken, renamed): (Vec<_>, Vec<_>) = renamed.into_iter().partition(|(_, found, _)| own.contains(found));
        for (view, found, name) in taken.into_iter().rev() {
            if views.get(view).is_some_and(|view| view.photo.name == found) {
                views.remove(view);
            }
            left_out
                .push((name.clone(), SceneError::MissingImage { path: name.into(), listed_in: listed_in.to_owned() }));
        }
        let is_missing = |(_, error): &(_, SceneError)| matches!(error, SceneError::MissingImage { .. });
        let (missing, unusable): (Vec<_>, Vec<_>) = left_out.into_iter().partition(is_missing);
        let mut notes: Vec<String> = assumptions.into_iter().chain(skipped).collect();
        notes.extend(note_left_out(unusable, views.len())?);
        let (missing, errors): (Vec<_>, Vec<_>) = missing.into_iter().unzip();
        if let Some(error) = errors.into_iter().next().filter(|_| views.is_empty()) {
            return Err(error);
        }
        if !missing.is_empty() {
            let names = abbreviated(&missing);
            notes.push(format!("{} of the listed photos are missing, skipped: {names}", missing.len()));
        }
        if let Some((_, found, name)) = renamed.first() {
            let count = renamed.len();
            notes.push(format!(
                "{count} photos are found under another name than the listed one, such as {found} for {name}"
            ));
        }
        notes.extend(ignored.into_iter().map(|(property, names)| format!("{property}: {}", abbreviated(&names))));
        Ok(DeclaredViews { cameras: listed_in.to_owned(), views, notes, ..DeclaredViews::default() })
    }
}

/// Notes on entries that are left out; the first one's error if they are more than those kept.
pub(crate) fn note_left_out(left_out: Vec<(String, SceneError)>, kept: usize) -> Result<Vec<String>, SceneError> {
    const SHOWN: usize = 3;
    let (count, mut notes) = (left_out.len(), Vec::new());
    for (name, error) in left_out {
        if count > kept {
            return Err(error);
        }
        notes.push(format!("{name} is left out: {error}"));
    }
    if count > SHOWN {
        notes.splice(SHOWN.., [format!("{} more photos are left out likewise", count - SHOWN)]);
    }
    Ok(notes)
}

/// The photos of the `requested` folder, or of the first of the usual ones that holds any: whichever format is read,
/// those of LLFF first where its file is.
pub(crate) fn list_photos(
    root: &Path,
    photos: &dyn PhotoSource,
    requested: Option<&str>,
) -> Result<PhotoList, SceneError> {
    let usual = match root.join("poses_bounds.npy").is_file() {
        true => ["images_8", "images_4", "images_2", "images", "input", "frames", ""],
        false => ["images", "images_2", "images_4", "images_8", "input", "frames", ""],
    };
    let found = match requested {
        // A source without folders cannot have the requested one.
        Some(name) => photos.list(&[&safe_name(root, name)?])?.filter(|list| list.folder.is_some()),
        None => photos.list(&usual)?,
    };
    let expected = requested.map_or_else(|| usual[..6].join(", ") + ", or photos beside", str::to_owned);
    found.ok_or_else(|| SceneError::malformed(root, "no photo folder", format!("one of: {expected}")))
}
