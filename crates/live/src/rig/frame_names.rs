//! The photos in a camera's folder, by the numbers in their names.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::ffmpeg::has_extension;
use anyhow::{Context, Result, bail};

const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];
/// Largest number of a frame: nanoseconds of 290 years.
const MAX_NUMBER: usize = i64::MAX as usize;
/// Most decimals of a time stamp in seconds: nanoseconds.
const MAX_DECIMALS: usize = 9;

/// Photos of a camera, by the numbers in their names or by time step.
pub(super) type Photos = BTreeMap<usize, PathBuf>;

/// The photos of a folder: by the last number in their names if these all differ, else by their order.
///
/// # Errors
/// The folder cannot be read, or a number is too large.
pub(super) fn photos_in(folder: &Path) -> Result<Photos> {
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<_>>>()?;
    paths.retain(|path| {
        let hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        !hidden && has_extension(path, &EXTENSIONS) && !path.is_dir()
    });
    paths.sort();
    let mut numbered = BTreeMap::new();
    for path in &paths {
        let Some(digits) = last_number(path) else { break };
        let Some(number) = digits.parse().ok().filter(|&number: &usize| number <= MAX_NUMBER) else {
            bail!("{}: the number in its name is larger than {MAX_NUMBER}", path.display());
        };
        numbered.insert(number, path.clone());
    }
    Ok(if numbered.len() == paths.len() { numbered } else { paths.into_iter().enumerate().collect() })
}

/// The digits of the last number in a name; a time stamp in seconds, such as `1305031102.175304`, is converted to nanoseconds.
fn last_number(path: &Path) -> Option<String> {
    let stem = path.file_stem()?.to_str()?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    if let Some((seconds, decimals)) = stem.split_once('.')
        && (3..=MAX_DECIMALS).contains(&decimals.len())
        && digits(seconds)
        && digits(decimals)
    {
        return Some(format!("{seconds}{decimals:0<MAX_DECIMALS$}"));
    }
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end]
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |at| at + stem[at..].chars().next().map_or(1, char::len_utf8));
    Some(stem[start..end].to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        names.iter().for_each(|name| std::fs::write(folder.path().join(name), "").unwrap());
        folder
    }

    fn names(folder: &tempfile::TempDir) -> Vec<(usize, String)> {
        let photos = photos_in(folder.path()).unwrap().into_iter();
        photos.map(|(number, path)| (number, path.file_name().unwrap().to_str().unwrap().into())).collect()
    }

    #[test]
    fn photos_are_keyed_by_number_or_by_order() {
        let numbered = ["f2_10.jpg", "f2_9.jpg", "f2_12.PNG", "notes.txt", ".f2_1.jpg"];
        let expected = [(9, "f2_9.jpg"), (10, "f2_10.jpg"), (12, "f2_12.PNG")].map(|(k, n)| (k, n.to_owned()));
        assert_eq!(names(&folder(&numbered)), expected);
        let by_order = names(&folder(&[&numbered[..], &["last.png"]].concat()));
        assert_eq!((by_order.len(), by_order[3].clone()), (4, (3, "last.png".to_owned())));
    }

    #[test]
    fn time_stamps_in_seconds_become_nanoseconds() {
        let found = names(&folder(&["1700000000.900000.png", "1700000001.000000.png"]));
        let numbers: Vec<usize> = found.iter().map(|(number, _)| *number).collect();
        assert_eq!(numbers, [1_700_000_000_900_000_000, 1_700_000_001_000_000_000]);
    }

    #[test]
    fn too_large_number_is_refused() {
        for name in ["18446744073709551615.png", "9223372036854775808.png", "99999999999999999999999.png"] {
            let error = photos_in(folder(&["1.png", name]).path()).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("larger than 9223372036854775807"), "{error}");
        }
        assert_eq!(names(&folder(&["9223372036854775807.png"])).len(), 1);
    }
}
