//! Runs ffmpeg, and writes videos through it.

mod count;
mod encoder;
mod process;
mod program;

pub use count::count_frames;
pub use encoder::{Encoder, is_video};
pub use process::{Process, ProcessHandle, command};
pub use program::detach;
