//! RealEstate10K: a text file and a folder of photos named by timestamp: `cameras.txt` and `frames`, or both of the
//! data set's own name, such as `0a1b2c3d4e5f6a7b.txt`.
//!
//! The file is a camera file of the data set (google.github.io/realestate10k, "Camera format"). The
//! first line is the video's URL; a pose there is accepted as well. Each further line is `timestamp
//! fx fy cx cy 0 0` and a 3×4 `cam_from_world` row by row, OpenCV axes. Intrinsics are fractions of
//! the image's width (fx, cx) and height (fy, cy), so they are independent of its size. Timestamps
//! are in microseconds.

use std::collections::HashMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use crate::photos::{PhotoLookup, list_photos};
use crate::scene_file::{abbreviated, read, text};
use crate::{DeclaredView, DeclaredViews, PhotoList, SceneError, SceneOptions};
use liveview::geometry::Intrinsics;
use liveview_files::has_extension;

const LINE: &str = "timestamp fx fy cx cy 0 0 and 12 numbers of the pose";

/// Such a file in a folder; COLMAP's text files are named `cameras.txt` as well.
pub(super) fn file_in(root: &Path) -> Option<PathBuf> {
    let cameras = root.join("cameras.txt");
    if cameras.is_file() {
        return (!root.join("images.txt").is_file()).then_some(cameras);
    }
    let mut files = fs::read_dir(root).into_iter().flatten().flatten().map(|entry| entry.path());
    files.find(|path| has_extension(path, &["txt"]) && path.with_extension("").is_dir())
}

pub(super) fn open(options: &SceneOptions, lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
    let path = lookup.listed_in;
    // The folder of the photos, if it is named like the file.
    let folder = path.file_stem().and_then(OsStr::to_str).filter(|stem| *stem != "cameras");
    let list = list_photos(path.parent().unwrap_or(path), lookup.photos, options.images.as_deref().or(folder))?;
    views(&read(path)?, &list, lookup)
}

/// Views of the listed photos.
pub(super) fn views(bytes: &[u8], list: &PhotoList, mut lookup: PhotoLookup<'_>) -> Result<DeclaredViews, SceneError> {
    let path = lookup.listed_in;
    let text = text(path, bytes)?;
    let stem = |name: &'_ String| {
        let stem = name.rsplit_once('.').map_or("", |(stem, _)| stem);
        stem.strip_suffix("us").unwrap_or(stem).to_owned()
    };
    let by_stem: HashMap<String, &str> = list.names.iter().map(|name| (stem(name), name.as_str())).collect();
    let mut missing = Vec::new();
    let is_pose =
        |line: &str| line.trim().split_once(char::is_whitespace).is_some_and(|(_, n)| parse_numbers(n).is_ok());
    let starts_with_pose = text.lines().next().is_some_and(is_pose);
    let lines = text.lines().enumerate().skip(usize::from(!starts_with_pose));
    for (index, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let wrong = |what: String| SceneError::malformed(path, format!("line {}: {what}", index + 1), LINE);
        let (stamp, numbers) = line.trim().split_once(char::is_whitespace).ok_or_else(|| wrong("1 word".to_owned()))?;
        let numbers = parse_numbers(numbers).map_err(wrong)?;
        let Some(name) = by_stem.get(stamp) else {
            missing.push(stamp.to_owned());
            continue;
        };
        let Some(photo) = lookup.find(&list.with_folder(name))? else { continue };
        let size = photo.size;
        let (width, height) = (size.width as f64, size.height as f64);
        let [fx, fy, cx, cy, k1, k2, pose @ ..] = numbers;
        if k1 != 0.0 || k2 != 0.0 {
            return Err(wrong(format!("columns 6 and 7 are {k1} and {k2}")));
        }
        let row = |i: usize| DVec3::new(pose[4 * i], pose[4 * i + 1], pose[4 * i + 2]);
        let intrinsics = Intrinsics { fx: fx * width, fy: fy * height, cx: cx * width, cy: cy * height, skew: 0.0 };
        let pose = (DMat3::from_rows(row(0), row(1), row(2)), DVec3::new(pose[3], pose[7], pose[11]));
        lookup.views.push(DeclaredView::new(photo, (intrinsics, size), pose));
    }
    if lookup.views.is_empty() && missing.is_empty() {
        return Err(SceneError::malformed(path, "no camera after the first line", "a line for each photo"));
    }
    if lookup.views.is_empty() {
        let place = list.folder.as_ref().map(|folder| format!(" in {folder}")).unwrap_or_default();
        let what = format!("none of its {} timestamps has a photo{place}", missing.len());
        return Err(SceneError::malformed(path, what, "photos named by timestamp, such as 50016633.jpg"));
    }
    let mut found = lookup.finish()?;
    if starts_with_pose {
        found.notes.push("the first line is read as a pose, since it is not the video's URL".to_owned());
    }
    if !missing.is_empty() {
        let stamps = abbreviated(&missing);
        found.notes.push(format!("{} of the listed timestamps have no photo, skipped: {stamps}", missing.len()));
    }
    Ok(found)
}

fn parse_numbers(text: &str) -> Result<[f64; 18], String> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let number = |word: &&str| word.parse::<f64>().map_err(|_| format!("\"{word}\" is not a number"));
    let numbers = words.iter().map(number).collect::<Result<Vec<_>, _>>()?;
    numbers.try_into().map_err(|_| format!("{} words", words.len() + 1))
}
