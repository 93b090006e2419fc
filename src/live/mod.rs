//! Live: the synchronised frames of a camera rig become the frames of a moving viewpoint.
//!
//! A [`LiveSession`] takes the photos of one time step and a target camera, and returns a [`LiveFrame`]. What it knows from
//! the frames before, it uses by its [`Policy`]: the paper's planes, chosen once, or the surface that the last frame found,
//! carried to the next as long as the photos agree with it. It holds one frame, whatever the length of the video.

mod dirty_tiles;
mod policy;
mod propagate;
mod session;

pub use policy::{LayerSource, Policy};
pub use session::{LiveError, LiveFrame, LiveSession, LiveSettings, LiveTimes};
