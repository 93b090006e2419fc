//! Views named by their text or their index.

use liveview_scene::Scene;
use pyo3::prelude::*;

use crate::error::{kind, library, value};

/// Index of the view that an argument names, or is the index of.
pub(crate) fn view_index(scene: &Scene, name: &str, argument: &Bound<'_, PyAny>) -> PyResult<usize> {
    if let Ok(text) = argument.extract::<String>() {
        return scene.view_index(&text).map_err(library);
    }
    let count = scene.views.len();
    let index: isize = argument.extract().map_err(|_| kind(name, "expected the name of a view, or its index"))?;
    let found = if index < 0 { index + count as isize } else { index };
    let found = usize::try_from(found).ok().filter(|&found| found < count);
    found.ok_or_else(|| value(name, format!("there is no view {index}; expected one of {count}")))
}
