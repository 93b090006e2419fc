//! Live video from a camera rig: its frames, the session that renders its time steps, the governor of quality, the
//! video of a moving viewpoint; and ffmpeg.

#![allow(clippy::missing_errors_doc, reason = "errors name the option or the file, and what was expected of it")]

pub mod agreement;
pub mod ffmpeg;
pub mod governor;
pub mod interrupt;
pub mod memory;
pub mod rig;
pub mod session;
pub mod video;

pub use ffmpeg::FrameRate;
