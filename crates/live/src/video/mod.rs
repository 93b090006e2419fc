//! `liveview video`: the frames of a camera rig become the video of a moving viewpoint.

mod arrivals;
mod gather;
mod options;
mod play;
mod played;
mod player;
mod scorer;
mod sink;
mod summary;
mod tally;
mod viewpoint;
mod writer;

pub use options::VideoArgs;
pub use play::run;
