//! Code that the commands of the `liveview` program share.

#![allow(clippy::missing_errors_doc, reason = "errors name the option or the file, and what was expected of it")]

pub mod agreement;
pub mod args;
pub mod console;
pub mod ffmpeg;
pub mod interrupt;
pub mod job;
pub mod measure;
pub mod ort_wheel;
pub mod outputs;
pub mod statistics;
