//! Live pictures from a camera rig: its frames, and the session that renders its time steps; and ffmpeg.

#![allow(clippy::missing_errors_doc, reason = "errors name the option or the file, and what was expected of it")]

pub mod ffmpeg;
pub mod interrupt;
pub mod rig;
pub mod session;

pub use ffmpeg::FrameRate;

/// Peak memory of the process in bytes; `None` if not on Linux.
pub fn peak_memory() -> Option<u64> {
    status("VmHWM:")
}

/// Current memory of the process in bytes; `None` if not on Linux.
pub fn resident_memory() -> Option<u64> {
    status("VmRSS:")
}

/// A field of the process status, in bytes.
fn status(field: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kilobytes = status.lines().find_map(|line| line.strip_prefix(field)?.trim().strip_suffix(" kB"))?;
    Some(1024 * kilobytes.trim().parse::<u64>().ok()?)
}
