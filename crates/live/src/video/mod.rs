//! Renders the video of a moving viewpoint from the frames of a camera rig.

mod arrivals;
mod gather;
mod play;
mod player;
mod sink;
mod summary;
mod tally;
mod viewpoint;

pub use play::{Rendered, Video, VideoSettings};
pub use player::Progress;
pub use sink::{FRAME_PREFIX, Sink, frame_file};
pub use viewpoint::Viewpoint;
