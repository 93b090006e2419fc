//! Reading and writing videos through the ffmpeg program.

mod decoder;
mod encoder;

use std::path::PathBuf;
use std::process::Command;

pub(crate) use decoder::{Decoder, Running};
pub(crate) use encoder::{Encoder, is_video};

/// The program, if it is on the PATH.
fn program() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let name = format!("ffmpeg{}", std::env::consts::EXE_SUFFIX);
    std::env::split_paths(&folders).map(|folder| folder.join(&name)).find(|file| file.is_file())
}

/// Puts a program to be started into a process group of its own, so that a Ctrl-C at the terminal does not end it: it ends with its
/// input, or when it is killed.
fn detach(command: &mut Command) {
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command, 0);
    #[cfg(not(unix))]
    let _ = command;
}
