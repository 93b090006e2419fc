//! Finds the ffmpeg program.

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

/// Puts a process into its own process group if this program handles Ctrl-C, so that a Ctrl-C in
/// the terminal does not end the process as well: it exits at the end of its input, or is killed.
pub fn detach(command: &mut Command) {
    #[cfg(unix)]
    if interrupt::is_watched() {
        std::os::unix::process::CommandExt::process_group(command, 0);
    }
    #[cfg(not(unix))]
    let _ = command;
}
