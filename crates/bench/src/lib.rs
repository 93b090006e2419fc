//! Benchmarks: `liveview sweep`.

#![allow(clippy::missing_errors_doc, reason = "errors name the option or the file, and what was expected of it")]

pub mod sweep;
mod worker_process;
