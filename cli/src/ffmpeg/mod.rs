//! Reading and writing videos through the ffmpeg program.

mod decoder;
mod encoder;
mod process;
mod program;

pub(crate) use decoder::Decoder;
pub(crate) use encoder::{Encoder, is_video};
pub(crate) use process::Running;
