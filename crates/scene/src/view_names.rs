//! Finds views by name.

use std::ffi::OsStr;
use std::path::Path;

use super::{SceneError, View};

/// Number of similar names that an error lists.
const LISTED_NAMES: usize = 3;

/// Index of the view with this name, file name, or file name without extension.
pub(super) fn index_of(views: &[View], name: &str) -> Result<usize, SceneError> {
    let names: [fn(&Path) -> Option<&OsStr>; 3] = [|path| Some(path.as_os_str()), Path::file_name, Path::file_stem];
    let unknown = |reason: &str, closest: Vec<&str>| {
        let (count, closest) = (views.len(), closest.join(", "));
        SceneError::UnknownView(format!("{reason} \"{name}\" among the {count} views; closest: {closest}"))
    };
    for name_of in names {
        let is_named = |&view: &usize| name_of(views[view].name.as_ref()) == Some(name.as_ref());
        let matches: Vec<usize> = (0..views.len()).filter(is_named).collect();
        match matches.as_slice() {
            [] => {}
            [index] => return Ok(*index),
            several => {
                let closest = several.iter().take(LISTED_NAMES).map(|&view| views[view].name.as_str()).collect();
                return Err(unknown("several views are named", closest));
            }
        }
    }
    let mut closest: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
    closest.sort_by_key(|view| edit_distance(view, name));
    closest.truncate(LISTED_NAMES);
    Err(unknown("no view is named", closest))
}

/// Levenshtein distance, to suggest names similar to a misspelt one.
fn edit_distance(a: &str, b: &str) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.bytes().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.bytes().enumerate() {
            let above = row[j + 1];
            row[j + 1] = (diagonal + usize::from(x != y)).min(above + 1).min(row[j] + 1);
            diagonal = above;
        }
    }
    row[b.len()]
}
