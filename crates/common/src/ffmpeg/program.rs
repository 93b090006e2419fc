//! The ffmpeg program.

use std::path::PathBuf;
use std::process::Command;

#[cfg(unix)]
use crate::interrupt;

/// The program, if it is on the PATH.
pub(super) fn program() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let name = format!("ffmpeg{}", std::env::consts::EXE_SUFFIX);
    std::env::split_paths(&folders).map(|folder| folder.join(&name)).find(|file| file.is_file())
}

/// Where the program ends in its own time at a Ctrl-C, puts one to be started into a process group of its own, so that a Ctrl-C at the
/// terminal does not end it: it ends with its input, or when it is killed.
pub fn detach(command: &mut Command) {
    #[cfg(unix)]
    if interrupt::is_watched() {
        std::os::unix::process::CommandExt::process_group(command, 0);
    }
    #[cfg(not(unix))]
    let _ = command;
}
