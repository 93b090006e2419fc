//! `liveview video`: the frames of a camera rig become the video of a moving viewpoint.

mod feed;
mod gather;
mod governor;
mod options;
mod play;
mod rig;
mod sink;
mod tally;
mod told;

pub(super) use options::VideoArgs;
pub(super) use play::run;
