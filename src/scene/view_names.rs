//! Finds views by name.

use std::path::Path;

use super::error::SceneError;

/// Number of similar names that an error lists.
const LISTED_NAMES: usize = 8;

/// Index of the view with this name, file name, or file name without extension.
pub(super) fn index_of(views: &[&str], name: &str) -> Result<usize, SceneError> {
    let stem = |path: &str| Path::new(path).file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let file = |path: &str| Path::new(path).file_name().map(|file| file.to_string_lossy().into_owned());
    let criteria: [&dyn Fn(&str) -> bool; 3] =
        [&|view| view == name, &|view| file(view).as_deref() == Some(name), &|view| {
            stem(view).as_deref() == Some(name)
        }];
    let unknown =
        |reason, closest| SceneError::UnknownView { name: name.to_owned(), reason, count: views.len(), closest };
    for criterion in criteria {
        let matches: Vec<usize> = (0..views.len()).filter(|&view| criterion(views[view])).collect();
        match matches.as_slice() {
            [] => {}
            [index] => return Ok(*index),
            several => {
                let closest = several.iter().take(LISTED_NAMES).map(|&view| views[view].to_owned()).collect();
                return Err(unknown("several views are named", closest));
            }
        }
    }
    let mut closest: Vec<String> = views.iter().map(|&view| view.to_owned()).collect();
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
