//! Writing videos through the ffmpeg program.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, Command, Stdio};

use anyhow::{Result, anyhow};
use liveview::ImageRgb;
use liveview::fs::atomic::AtomicFile;
use liveview::geometry::Size;

use super::process::{Process, command};
use super::program::detach;
use crate::args::frame_rate::FrameRate;
use crate::args::output::has_ending;
use crate::console::print_message;

/// An .mp4 or .gif being written. Dropped without [`Encoder::finish`] it is deleted.
#[derive(Debug)]
pub struct Encoder {
    path: PathBuf,
    rate: FrameRate,
    size: Size,
    running: Option<RunningEncoder>,
}

/// ffmpeg, its input, and the file that it writes under its temporary name, which is deleted after ffmpeg has ended.
#[derive(Debug)]
struct RunningEncoder {
    process: Process,
    input: Option<ChildStdin>,
    file: AtomicFile,
}

/// Whether a path names a video.
pub fn is_video(path: &Path) -> bool {
    !path.is_dir() && has_ending(path, &["mp4", "gif"])
}

impl Encoder {
    /// A video; an error if there is no ffmpeg.
    pub fn new(path: &Path, rate: FrameRate) -> Result<Self> {
        command_for(path)?;
        Ok(Self { path: path.to_owned(), rate, size: Size::default(), running: None })
    }

    /// The file that is written.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Sets the size of all frames, in pixels; before the first one.
    pub fn set_size(&mut self, size: Size) {
        self.size = size;
    }

    /// Writes a frame, of the size set.
    pub fn add(&mut self, picture: &ImageRgb) -> Result<()> {
        let running = match self.running.take() {
            Some(running) => running,
            None => self.start()?,
        };
        let RunningEncoder { process, input, .. } = self.running.insert(running);
        let bytes = picture.to_rgb8();
        match process
            .waiting(|| input.as_mut().map_or(Err(ErrorKind::BrokenPipe.into()), |pipe| pipe.write_all(&bytes)))
        {
            Ok(()) => Ok(()),
            Err(_) => Err(self.failure()),
        }
    }

    /// Waits for ffmpeg to finish, and gives the file its name.
    pub fn finish(mut self) -> Result<PathBuf> {
        if let Some(running) = &mut self.running {
            // ffmpeg ends when its input does.
            drop(running.input.take());
            if !running.process.wait()?.success() {
                return Err(self.failure());
            }
        }
        if let Some(RunningEncoder { process, file, .. }) = self.running.take() {
            drop(process);
            file.finish().map_err(|error| self.unwritten(&error))?;
        }
        Ok(self.path.clone())
    }

    fn unwritten(&self, error: &std::io::Error) -> anyhow::Error {
        anyhow!("-o {}: cannot be written: {error}", self.path.display())
    }

    fn start(&self) -> Result<RunningEncoder> {
        let file = AtomicFile::create(&self.path).map_err(|error| self.unwritten(&error))?;
        // Absolute: of a path that begins with a name and a colon ffmpeg would take the name for a protocol's.
        let temporary = std::path::absolute(file.temporary())?;
        let Size { width, height } = self.size;
        let gif = has_ending(&self.path, &["gif"]);
        let mut command = command_for(&self.path)?;
        command.args(["-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]);
        command.args(["-s", &format!("{width}x{height}"), "-r", &self.rate.to_string(), "-i", "pipe:0"]);
        if gif {
            command.args(["-vf", "split[a][b];[a]palettegen[p];[b][p]paletteuse", "-loop", "0"]);
        } else {
            // Players expect yuv420p, which needs even sides.
            if width % 2 + height % 2 > 0 {
                print_message(
                    "note",
                    format!("{width}x{height} is odd: the last row or column is left out of the video"),
                );
            }
            command.args([
                "-vf",
                "crop=trunc(iw/2)*2:trunc(ih/2)*2",
                "-c:v",
                "libx264",
                "-pix_fmt",
                "yuv420p",
                "-crf",
                "17",
            ]);
        }
        detach(&mut command);
        command.arg(&temporary).stdin(Stdio::piped()).stdout(Stdio::null());
        let process = Process::start(&mut command, Some(&temporary))?;
        let input = process.with_child(|child| child.stdin.take());
        Ok(RunningEncoder { process, input, file })
    }

    fn failure(&mut self) -> anyhow::Error {
        let failure = self.running.as_mut().map(|running| {
            drop(running.input.take());
            running.process.failure()
        });
        anyhow!("-o {}: {}", self.path.display(), failure.unwrap_or_default())
    }
}

fn command_for(path: &Path) -> Result<Command> {
    command(&format!(
        "-o {}: videos are made by ffmpeg, which is not on the PATH; expected ffmpeg, or a folder for the frames",
        path.display()
    ))
}
