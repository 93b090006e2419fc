//! `liveview video`: renders the video of a moving viewpoint from the frames of a camera rig.

mod arrivals;
mod gather;
mod options;
mod play;
mod player;
mod results;
mod scorer;
mod sink;
mod summary;
mod tally;
mod viewpoint;
mod writer;

pub use options::VideoArgs;
pub use play::run;
