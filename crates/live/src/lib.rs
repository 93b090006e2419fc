//! Live video from a camera rig, and the `liveview video` command.

#![allow(clippy::missing_errors_doc, reason = "errors name the option or the file, and what was expected of it")]

pub mod governor;
pub mod rig;
pub mod video;
