//! Live video: the time steps of a rig of cameras, one after the other.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use liveview::ImageRgb;
use liveview_live::session::{self, LiveError, LiveSettings, Policy};
use liveview_synthesizer::LayerSpec;
use pyo3::prelude::*;

use crate::arguments::{Object, library, some, value};
use crate::camera::{camera, cameras};
use crate::engine::compute;
use crate::frame::{Frame, rendering};
use crate::scene::picture;
use crate::synthesizer::{check_views, model_options};

/// Renders the time steps of a rig of cameras, one after the other. What one has found the next
/// reuses: the depth of a photo where it stays the same, or the planes that were selected.
///
/// `near`, `far`: depth range, scene units. `views`, `layers`, `network`: as of `Synthesizer`.
/// `policy`: when layers are searched: "propagate", where the photos have changed; "each" step;
/// "every:5"; "once". By default "propagate", and "once" for planes.
#[pyclass(frozen, module = "liveview")]
pub(crate) struct LiveSession(Mutex<Steps>);

/// The session, and the number of steps rendered.
struct Steps {
    session: session::LiveSession,
    rendered: usize,
}

#[pymethods]
impl LiveSession {
    #[new]
    #[pyo3(signature = (cameras, near, far, *, views = None, layers = None, network = None, policy = None))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        cameras: &Object<'_>,
        near: f64,
        far: f64,
        views: Option<&Object<'_>>,
        layers: Option<&str>,
        network: Option<PathBuf>,
        policy: Option<&str>,
    ) -> PyResult<Self> {
        let cameras = self::cameras("cameras", cameras)?;
        let layers: Option<LayerSpec> = layers.map(str::parse).transpose().map_err(|error| value("layers", error))?;
        let policy: Option<Policy> = policy.map(str::parse).transpose().map_err(|error| value("policy", error))?;
        let options = model_options(py, views, network)?;
        let opened = compute(py, || options.open_renderer(layers.as_ref()).map_err(library))?;
        let (renderer, layers) = (opened.renderer, opened.layers);
        check_views(options.views, &renderer)?;
        let default = Policy::default_for(&layers);
        if policy == Some(Policy::Propagate) && default != Policy::Propagate {
            return Err(value("policy", format!("propagate: {layers} have no depth; expected each, every:N or once")));
        }
        let mut settings = LiveSettings::new(near, far);
        (settings.layers, settings.policy) = (layers, policy.unwrap_or(default));
        let session = session::LiveSession::new(cameras, vec![renderer], settings);
        let session = session.map_err(|error| value("near, far", error))?;
        Ok(Self(Mutex::new(Steps { session, rendered: 0 })))
    }

    /// The picture of a camera at the next time step; photos: of each camera in order [h, w, 3], as
    /// `Scene.from_arrays` takes them, or None where it has delivered nothing.
    fn render(&self, py: Python<'_>, photos: &Object<'_>, target: &Object<'_>) -> PyResult<Frame> {
        let target = camera("target", target)?;
        let photos = some("photos", photos)?;
        let photos = photos.iter().map(|(name, photo)| (!photo.is_none()).then(|| picture(name, photo)).transpose());
        let photos = photos.collect::<PyResult<Vec<_>>>()?;
        let (step, found) = compute(py, || {
            let photos: Vec<Option<&ImageRgb>> = photos.iter().map(Option::as_ref).collect();
            let mut steps = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let found = steps.session.render(&photos, &target).map_err(|error| match error {
                LiveError::Photos { .. } | LiveError::Size { .. } => value("photos", error),
                _ => library(error),
            })?;
            steps.rendered += 1;
            Ok((steps.rendered - 1, found))
        })?;
        let mut times = vec![("photos", found.times.photos), ("layers", found.times.layers)];
        times.extend(rendering(&found.frame));
        Frame::new(py, format!("frame_{step:04}"), found.frame, times)
    }

    /// Forgets what earlier steps have found: the next is rendered like the first.
    fn restart(&self, py: Python<'_>) -> PyResult<()> {
        compute(py, || {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).session.restart();
            Ok(())
        })
    }
}
