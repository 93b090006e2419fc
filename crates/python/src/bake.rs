//! A scene as a page.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use liveview_synthesizer::{ScenePhotos, SceneViews, SynthesisError};
use pyo3::prelude::*;

use crate::arguments::{Error, Object, expect, some, view_index};
use crate::engine::run;
use crate::scene::Scene;

/// Writes a scene as one page that opens in any browser, without a server; returns what was left
/// out, a line each. `max_mb`: its largest size in millions of bytes. `held_out`: views to compare
/// with, by name or index. `near`, `far`: depth range, scene units, by default the scene's.
#[pyfunction]
#[pyo3(signature = (scene, path, *, max_mb = 8.0, held_out = None, near = None, far = None))]
pub(crate) fn bake(
    py: Python<'_>,
    scene: Py<Scene>,
    path: PathBuf,
    max_mb: f64,
    held_out: Option<&Object<'_>>,
    near: Option<f64>,
    far: Option<f64>,
) -> PyResult<Vec<String>> {
    let scene = &scene.get().0;
    let held_out = held_out.map(|views| some("held_out", views)).transpose()?.unwrap_or_default();
    let held_out: Vec<usize> =
        held_out.iter().map(|(name, view)| view_index(scene, name, view)).collect::<PyResult<_>>()?;
    let held_out = scene.with_held_out(held_out);
    expect("max_mb", max_mb, max_mb > 0.0 && max_mb <= 4000.0, "above 0, at most 4000")?;
    let ended = AtomicBool::new(false);
    run(
        py,
        || ended.store(true, Ordering::Relaxed),
        || {
            let mut photos = ScenePhotos::new(SceneViews::new(scene.clone(), near, far));
            let baked = liveview_viewer::bake(&mut photos, &held_out, (1e6 * max_mb) as usize, |_| {
                if ended.load(Ordering::Relaxed) { Err(SynthesisError::Cancelled.into()) } else { Ok(()) }
            });
            let baked = baked.map_err(|error: anyhow::Error| Error::new_err(format!("{error:#}")))?;
            liveview_files::atomic::write(&path, baked.html.as_bytes())
                .map_err(|error| Error::new_err(format!("{}: cannot be written: {error}", path.display())))?;
            Ok(baked.notes)
        },
    )
}
