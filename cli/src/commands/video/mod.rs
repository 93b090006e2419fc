//! `liveview video`: the frames of a camera rig become the video of a moving viewpoint.

mod arrivals;
mod decoder;
mod feed;
mod gather;
mod governor;
mod options;
mod play;
mod rig;
mod scorer;
mod sink;
mod tally;
mod told;
mod writer;

pub(super) use options::VideoArgs;
pub(super) use play::run;
