//! Running the ffmpeg program, and writing videos through it.

mod encoder;
mod process;
mod program;

pub use encoder::{Encoder, is_video};
pub use process::{Process, Running, command};
pub use program::detach;
