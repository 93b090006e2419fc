//! Why a scene could not be opened or rendered.

use std::io;
use std::path::PathBuf;

use liveview::geometry::TooFewViews;
use liveview::layers::LayersError;
use liveview::network::{NetworkError, OrtLibraryError};
use liveview::render::RenderError;
use liveview_scene::SceneError;
use liveview_scene::cameras::CameraPathError;

/// Why a scene could not be opened or rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SynthesisError {
    /// The scene's folder, or a photo in it, cannot be used.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Too few views face a target's direction.
    #[error("{target}: {source}")]
    Views {
        /// Name of the target.
        target: String,
        /// How many views are needed, and how many face that direction.
        source: TooFewViews,
    },
    /// Neither the scene nor the options set the depth range, and the photos show none: all cameras
    /// are in one place.
    #[error(
        "{}: the scene has no depth range, and its cameras are in one place; expected {}, in scene units",
        scene.display(),
        match (near, far) { (true, true) => "near and far", (true, false) => "near", _ => "far" }
    )]
    UnknownDepth {
        /// Folder of the scene.
        scene: PathBuf,
        /// Whether the nearest depth is unknown.
        near: bool,
        /// Whether the farthest depth is unknown.
        far: bool,
    },
    /// Invalid layers, or not 0 < near < far.
    #[error(transparent)]
    Layers(#[from] LayersError),
    /// The folder where depth is kept cannot be written to.
    #[error("{}: files cannot be written there: {source}; expected a folder for depth maps", folder.display())]
    Cache {
        /// The folder.
        folder: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The search for the depth of photos was ended by its callback
    /// ([`crate::ScenePhotos::on_depth_search`]).
    #[error("the search for the depth of the photos was cancelled")]
    Cancelled,
    /// There is no path around the views.
    #[error(transparent)]
    Path(#[from] CameraPathError),
    /// There is no model for that number of views.
    #[error("{0}")]
    Model(String),
    /// ONNX Runtime cannot be used.
    #[error(transparent)]
    Library(#[from] OrtLibraryError),
    /// The threads to run a model on cannot be started.
    #[error("{}: cannot be run: {reason}", path.display())]
    Threads {
        /// The model file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The model file is not a LiveView model, or does not fit the options.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// A target, or the search for a photo's depth, needs more memory than is available.
    #[error("{0}")]
    Memory(String),
    /// The network failed.
    #[error(transparent)]
    Render(#[from] RenderError),
}
