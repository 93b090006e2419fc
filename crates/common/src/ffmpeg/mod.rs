//! Runs ffmpeg, and writes videos through it.

mod encoder;
mod process;
mod program;

pub use encoder::{Encoder, is_video};
pub use process::{Process, ProcessHandle, command};
pub use program::detach;
