//! Live video: the synchronised frames of a camera rig become the frames of a moving viewpoint.
//!
//! A [`LiveSession`] takes the photos of one time step and a target camera, and returns a
//! [`LiveFrame`]. Its [`Policy`] says what a frame reuses of earlier ones: the paper's planes,
//! selected once; the surface of the last frame, propagated to the next as long as the photos agree
//! with it; the depth of each camera's photo, where the photo stays the same. Memory does not grow
//! with the length of the video.

mod camera_depths;
mod error;
mod frame;
mod policy;
mod session;
mod settings;
mod step;

pub use error::LiveError;
pub use frame::{LiveFrame, LiveTimes};
pub use liveview_synthesizer::LayerSource;
pub use policy::Policy;
pub use session::LiveSession;
pub use settings::LiveSettings;
