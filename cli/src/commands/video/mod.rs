//! `liveview video`: the frames of a camera rig become the video of a moving viewpoint.

mod arrivals;
mod feed;
mod frame_names;
mod gather;
mod governor;
mod options;
mod play;
mod played;
mod player;
mod rig;
mod scorer;
mod sink;
mod steps;
mod summary;
mod tally;
mod viewpoint;
mod writer;

pub(crate) use options::VideoArgs;
pub(crate) use play::run;
