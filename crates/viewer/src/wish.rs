//! What clients ask for, and what they are sent.

use std::sync::Arc;

use liveview::Camera;
use tokio::sync::oneshot;

/// From where, and when.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Moment {
    pub(crate) camera: Camera,
    /// The time step of a rig; 0 of a scene.
    pub(crate) step: usize,
}

/// What a client wishes to see.
#[derive(Debug, Clone)]
pub(crate) struct Wish {
    /// The client's number for it.
    pub(crate) id: u64,
    pub(crate) at: Moment,
    /// Whether the viewpoint moves, or time: then speed counts, else quality.
    pub(crate) moving: bool,
    /// Disparity in colour in place of the picture.
    pub(crate) depth: bool,
}

/// A file that is asked for.
#[derive(Debug)]
pub(crate) enum Asked {
    /// A picture at full quality, PNG.
    Picture(Moment),
    /// What a camera of a rig has at a time step, JPEG.
    Photo { view: usize, step: usize },
}

/// Its bytes, or why there is none.
pub(crate) type Answer = Result<Arc<[u8]>, String>;

/// What the renderer is to do next.
#[derive(Debug)]
pub(crate) enum Task {
    Frame {
        client: u64,
        wish: Wish,
    },
    File {
        asked: Asked,
        reply: oneshot::Sender<Answer>,
    },
    /// Nothing is wished for: time to prepare.
    Spare,
    Stop,
}

/// A message to a client.
#[derive(Debug, Clone)]
pub(crate) enum Message {
    /// A header in JSON and a picture.
    Frame(Arc<[u8]>),
    /// JSON.
    Text(String),
}
