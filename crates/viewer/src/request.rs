//! What clients ask for, and what they are sent.

use std::sync::Arc;

use liveview::Camera;
use liveview_synthesizer::FoundDepth;
use tokio::sync::oneshot;

/// A camera, and a time step of a rig.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Viewpoint {
    pub(crate) camera: Camera,
    /// 0 for a scene of photos.
    pub(crate) step: usize,
}

/// A client's request for a picture.
#[derive(Debug, Clone)]
pub(crate) struct ViewRequest {
    /// The client's number of the request.
    pub(crate) id: u64,
    pub(crate) viewpoint: Viewpoint,
    /// Whether the viewpoint or the time is changing: speed then goes before quality.
    pub(crate) moving: bool,
    /// Disparity as colours instead of the picture.
    pub(crate) depth: bool,
}

/// A client's request for a file.
#[derive(Debug)]
pub(crate) enum FileRequest {
    /// A picture at full quality, as PNG.
    Picture(Viewpoint),
    /// A camera's photo at a time step, as JPEG.
    Photo { view: usize, step: usize },
}

/// The bytes of a file, or the reason why there are none.
pub(crate) type FileAnswer = Result<Arc<[u8]>, FileError>;

/// Why there is no file.
#[derive(Debug, PartialEq)]
pub(crate) enum FileError {
    /// Too many wait for depth.
    TooMany,
    /// The picture cannot be rendered, or the photo cannot be read.
    Failed(String),
}

/// The renderer's next task.
#[derive(Debug)]
pub(crate) enum Task {
    Frame {
        client: u64,
        request: ViewRequest,
    },
    File {
        request: FileRequest,
        reply: oneshot::Sender<FileAnswer>,
    },
    /// The depth of a view's photo; `None` if it could not be searched.
    Found {
        view: usize,
        found: Option<Box<FoundDepth>>,
    },
    /// No request is pending: time to load photos and search depth ahead.
    Prepare,
    Stop,
}

/// A message to a client.
#[derive(Debug, Clone)]
pub(crate) enum Message {
    /// A header in JSON, then a picture.
    Frame(Arc<[u8]>),
    /// JSON.
    Text(String),
}

#[cfg(test)]
impl Viewpoint {
    /// A viewpoint for tests.
    pub(crate) fn sample(step: usize) -> Self {
        use liveview::Intrinsics;
        use liveview::glam::{DMat3, DVec3};

        let k = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, skew: 0.0 };
        Self { camera: Camera::new(k, 64, 48, DMat3::IDENTITY, DVec3::ZERO).unwrap(), step }
    }
}
