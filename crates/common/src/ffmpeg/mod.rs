//! Runs ffmpeg, and writes videos through it.

mod count;
mod encoder;
mod process;

pub use count::count_frames;
pub use encoder::{Encoder, is_video};
pub use process::{Process, ProcessHandle, command};
