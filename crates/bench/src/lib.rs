//! Benchmarks and comparisons with the Python reference.

#![allow(clippy::missing_errors_doc, reason = "errors name the option or the file, and what was expected of it")]

pub mod dump;
mod npz;
pub mod sweep;
