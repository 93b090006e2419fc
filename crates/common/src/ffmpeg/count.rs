//! Counts the frames of a video.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;

use anyhow::{Result, anyhow};

use super::process::{Process, command};

/// The number of frames of a video. ffmpeg reads its packets and decodes none.
///
/// # Errors
///
/// If ffmpeg is not installed or cannot read the file, which the error names.
pub fn count_frames(path: &Path) -> Result<usize> {
    let at = path.display();
    let mut command = command(&format!("{at}: videos are read by ffmpeg, which is not on the PATH"))?;
    // Absolute: ffmpeg takes a name before a colon for a protocol.
    command.arg("-i").arg(std::path::absolute(path)?).args(["-map", "0:v:0", "-c", "copy", "-f", "framecrc", "-"]);
    let mut process = Process::start(command.stdin(Stdio::null()).stdout(Stdio::piped()), None)?;
    let mut lines = BufReader::new(process.with_child(|child| child.stdout.take()).expect("piped"));
    // One line for each packet, which holds a frame, and comments.
    let (mut count, mut line) = (0, String::new());
    // Line by line, so that the check for a hanging ffmpeg sees each of them.
    while process.waiting(|| lines.read_line(&mut line))? > 0 {
        count += usize::from(!line.starts_with('#'));
        line.clear();
    }
    if process.wait()?.success() { Ok(count) } else { Err(anyhow!("{at}: {}", process.failure())) }
}
