//! The photos in a scene's folder: found where a pose file lists them, or by the end of their path.

use std::cmp::Reverse;
use std::collections::{BTreeSet, HashMap};
use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use percent_encoding::percent_decode_str;
use unicode_normalization::UnicodeNormalization;

use crate::photos::{Found, ListedPhoto, Photo, PhotoList, PhotoSource, load_photo, scan_start};
use crate::scene_file::below_root;
use crate::{SceneError, SceneOptions};
use liveview::geometry::Size;
use liveview::image::{Header, ImageError, ImageRgb, WHITE, read_header};
use liveview_files::{bounded, has_extension};

/// Levels of nested folders in which photos are searched.
const MAX_DEPTH: usize = 4;

/// Folders of reduced copies of the photos in `images`, the largest first.
const REDUCED: [&str; 3] = ["images_2", "images_4", "images_8"];

/// Names of folders that hold no photos begin with these.
const OTHER_MAPS: [&str; 4] = ["mask", "depth", "normal", "segm"];

/// Extensions of photos. Where a name is listed without one, the first is taken: beside a JPEG, a PNG of that name is
/// a mask or a depth.
pub(crate) const EXTENSIONS: [&str; 11] =
    ["jpg", "jpeg", "jfif", "png", "webp", "tif", "tiff", "bmp", "heic", "heif", "avif"];

/// Of [`Photo::ignored`], a photo with an alpha channel.
pub(crate) const TRANSPARENT: &str = "transparent pixels composited on the background";
/// Of [`Photo::ignored`], a photo that its EXIF orientation turns.
pub(crate) const ORIENTED: &str =
    "EXIF orientation ignored, poses are assumed to belong to the pixels as stored (exif_rotate turns them)";
const TWIN: &str = "other files of the same name beside these photos are not read (masks or depths)";

/// Pictures in a folder, named by their path relative to it. A photo that a pose file lists is looked for by its path,
/// also without its percent-encoding; then, in the listed folder if there is one and else in all, by the end of its
/// path, since folders are moved, with any extension, case and normal form of Unicode. The photos may lie beside the
/// folder if it holds none itself.
#[derive(Debug, Clone)]
pub struct PhotoFolder {
    root: PathBuf,
    background: [f32; 3],
    turns: bool,
    index: Arc<OnceLock<Index>>,
}

/// The photos of a folder.
#[derive(Debug, Default)]
struct Index {
    /// By the [`key`] of their file names without extension.
    by_stem: HashMap<String, Vec<String>>,
    /// The folders that hold them, and those above these.
    folders: BTreeSet<String>,
}

impl PhotoFolder {
    /// The photos in this folder and its subfolders.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into(), background: WHITE, turns: false, index: Arc::default() }
    }

    /// The photos in this folder, with the options' background and turned as they say.
    pub(crate) fn with_options(root: impl Into<PathBuf>, options: &SceneOptions) -> Self {
        let background = options.background.unwrap_or(WHITE);
        Self { background, turns: options.exif_rotate, ..Self::new(root) }
    }

    fn index(&self) -> &Index {
        self.index.get_or_init(|| {
            let mut names = Vec::new();
            // Folders that cannot be read hold no photo.
            let _ = collect(&self.root, "", MAX_DEPTH, &mut names);
            if names.is_empty() {
                let _ = collect(&self.root.join(".."), "../", 1, &mut names);
            }
            let mut index = Index::default();
            for name in names {
                let (folder, file) = split(&name);
                if folder.split('/').any(|part| OTHER_MAPS.iter().any(|other| key(part).starts_with(other))) {
                    continue;
                }
                index.folders.extend(folder.match_indices('/').map(|(at, _)| folder[..at].to_owned()));
                index.folders.insert(folder.to_owned());
                index.by_stem.entry(key(stem(file))).or_default().push(name);
            }
            index
        })
    }

    /// The photo of a listed name, and whether there are others of this name beside it.
    fn existing(&self, listed: &str) -> Option<(String, bool)> {
        let name = simplified(listed);
        // Of what lies outside the folder, only what lies beside it.
        if !name.starts_with("../..") && !name.is_empty() && self.root.join(&name).is_file() {
            return Some((name, false));
        }
        let (home, file) = split(name.trim_start_matches("../"));
        let index = self.index();
        let names = if has_extension(file.as_ref(), &EXTENSIONS) { [stem(file), file] } else { [file, stem(file)] };
        let mut candidates = names.iter().find_map(|name| index.by_stem.get(&key(name)))?.clone();
        if !home.is_empty() && index.folders.contains(home) {
            candidates.retain(|name| name.strip_prefix(home).is_some_and(|rest| rest.starts_with('/')));
        }
        let rank = |name: &String| {
            let folder = split(name).0;
            let tail = folder.rsplit('/').zip(home.rsplit('/')).take_while(|(a, b)| key(a) == key(b)).count();
            let top = folder.trim_start_matches("../").split('/').next();
            let reduced = REDUCED.iter().position(|reduced| top == Some(reduced)).map(|at| at + 2);
            (Reverse(tail), reduced.unwrap_or(usize::from(top != Some("images"))))
        };
        let extension =
            |name: &String| EXTENSIONS.iter().position(|extension| has_extension(name.as_ref(), &[extension]));
        let has_same = |name: &String| key(split(name).1) == key(file);
        candidates.sort_by_cached_key(|name| (rank(name), !has_same(name), extension(name)));
        let best = candidates.first()?.clone();
        let equal = candidates[1..].iter().filter(|other| rank(other) == rank(&best));
        let (beside, elsewhere): (Vec<_>, Vec<_>) = equal.partition(|other| split(other).0 == split(&best).0);
        // Photos of one name in several folders cannot be told apart.
        elsewhere.is_empty().then_some((best, !beside.is_empty() && names[0] == file))
    }
}

impl PhotoSource for PhotoFolder {
    fn find(&self, listed: &ListedPhoto<'_>) -> Result<Found, SceneError> {
        let name = below_root(listed.name);
        let decoded = percent_decode_str(name).decode_utf8().ok();
        let found = self.existing(name).or_else(|| self.existing(&decoded.filter(|decoded| decoded != name)?));
        let Some((name, has_twin)) = found else {
            let (path, listed_in) = (self.root.join(listed.name), listed.listed_in.to_owned());
            return Err(SceneError::MissingImage { path, listed_in });
        };
        let path = self.root.join(&name);
        bounded::check_regular(&path).map_err(|source| ImageError::Read { path: path.clone(), source })?;
        let Header { mut size, orientation, alpha, .. } = read_header(&path)?;
        check_end(&path)?;
        if self.turns && orientation > 4 {
            size = Size::new(size.height, size.width);
        }
        let ignored = [(orientation > 1 && !self.turns, ORIENTED), (alpha, TRANSPARENT), (has_twin, TWIN)];
        let ignored = ignored.into_iter().filter_map(|(is_there, what)| is_there.then_some(what)).collect();
        Ok(Found::Photo(Photo { name, path, size, ignored }))
    }

    fn list(&self, folders: &[&str]) -> Result<Option<PhotoList>, SceneError> {
        for &folder in folders.iter().filter(|folder| self.root.join(folder).is_dir()) {
            let mut names = Vec::new();
            collect(&self.root.join(folder), "", MAX_DEPTH, &mut names)?;
            names.sort();
            if !names.is_empty() {
                return Ok(Some(PhotoList { folder: Some(folder.to_owned()), names }));
            }
        }
        Ok(None)
    }

    fn load(&self, name: &str) -> Result<ImageRgb, SceneError> {
        let path = self.root.join(name);
        let photo = load_photo(&path, self.background)?;
        Ok(if self.turns { photo.turned(read_header(&path)?.orientation) } else { photo })
    }
}

/// A path without `.`, and without `..` but at its beginning.
fn simplified(path: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split('/').filter(|part| !matches!(*part, "" | ".")) {
        match (part, parts.last()) {
            ("..", Some(&last)) if last != ".." => drop(parts.pop()),
            _ => parts.push(part),
        }
    }
    parts.join("/")
}

/// Folder and file name.
fn split(path: &str) -> (&str, &str) {
    path.rsplit_once('/').unwrap_or(("", path))
}

fn stem(file: &str) -> &str {
    file.rsplit_once('.').map_or(file, |(stem, _)| stem)
}

/// A name in lower case and in one normal form: macOS writes another than most programs.
pub(crate) fn key(name: &str) -> String {
    name.nfc().flat_map(char::to_lowercase).collect()
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
        } else if has_extension(&path, &EXTENSIONS) {
            names.push(format!("{prefix}{name}"));
        }
    }
    Ok(())
}

/// The end marker of a JPEG.
const END: [u8; 2] = [0xFF, 0xD9];

/// Refuses a JPEG or PNG file without its end marker. What follows that, such as the video of a phone, is allowed.
fn check_end(path: &Path) -> Result<(), ImageError> {
    let failed = |source| ImageError::Read { path: path.to_owned(), source };
    let mut ends = [[0; 8]; 2];
    let mut file = File::open(path).map_err(failed)?;
    let read = file.read_exact(&mut ends[0]).and_then(|()| file.seek(SeekFrom::End(-8)));
    read.and_then(|_| file.read_exact(&mut ends[1])).map_err(failed)?;
    let all = || bounded::read(path, bounded::MAX_BYTES).map_err(failed);
    let is_whole = match ends {
        [[0xFF, 0xD8, ..], [.., end, mark]] if [end, mark] != END => {
            let bytes = all()?;
            scan_start(&bytes).is_some_and(|start| bytes[start..].windows(2).any(|pair| pair == END))
        }
        [[0x89, b'P', ..], end] if !end.starts_with(b"IEND") => all()?.windows(4).any(|four| four == b"IEND"),
        _ => true,
    };
    let reason = "the file ends before its end marker: it was not copied whole".to_owned();
    if is_whole { Ok(()) } else { Err(ImageError::Decode { path: path.to_owned(), reason }) }
}
