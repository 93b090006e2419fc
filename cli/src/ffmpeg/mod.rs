//! Reading and writing videos through the ffmpeg program.

mod decoder;
mod encoder;
mod program;

pub(crate) use decoder::{Decoder, Running};
pub(crate) use encoder::{Encoder, is_video};
