//! Live: the synchronised frames of a camera rig become the frames of a moving viewpoint.
//!
//! A [`LiveSession`] takes the photos of one time step and a target camera, and returns a [`LiveFrame`]. What it reuses from the frames
//! before is its [`Policy`]: the paper's planes, selected once; the surface of the last frame, propagated to the next as long as
//! the photos agree with it; the depth of each camera's photo, as far as that stays the same. Memory does not grow with the length of the video.

mod camera_depths;
mod dirty_tiles;
mod error;
mod frame;
mod history;
mod policy;
mod propagate;
mod session;
mod settings;
mod step;

pub use error::LiveError;
pub use frame::{LiveFrame, LiveTimes};
pub use policy::{LayerSource, Policy};
pub use session::LiveSession;
pub use settings::LiveSettings;
