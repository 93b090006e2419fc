//! Writing videos through the ffmpeg program.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Result, anyhow};
use liveview::ImageRgb;
use liveview::fs::atomic::AtomicFile;
use liveview::geometry::Size;

use super::program::{detach, program};
use crate::args::output::has_ending;
use crate::console::print_message;

/// An .mp4 or .gif being written. Dropped without [`Encoder::finish`] it is deleted.
pub(crate) struct Encoder {
    path: PathBuf,
    ffmpeg: PathBuf,
    fps: usize,
    size: Size,
    /// ffmpeg, and the file that it writes under its temporary name.
    encoder: Option<(Child, AtomicFile)>,
}

/// Whether a path names a video.
pub(crate) fn is_video(path: &Path) -> bool {
    !path.is_dir() && has_ending(path, &["mp4", "gif"])
}

impl Encoder {
    /// A video of `fps` frames per second; an error if there is no ffmpeg.
    pub(crate) fn new(path: &Path, fps: usize) -> Result<Self> {
        let ffmpeg = program().ok_or_else(|| {
            anyhow!("-o {}: videos are made by ffmpeg, which is not on the PATH; expected ffmpeg, or a folder for the frames", path.display())
        })?;
        Ok(Self { path: path.to_owned(), ffmpeg, fps, size: Size::default(), encoder: None })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Sets the size of all frames, in pixels; before the first one.
    pub(crate) fn set_size(&mut self, size: Size) {
        self.size = size;
    }

    pub(crate) fn add(&mut self, picture: &ImageRgb) -> Result<()> {
        let encoder = match self.encoder.take() {
            Some(encoder) => encoder,
            None => self.start()?,
        };
        let pipe = self.encoder.insert(encoder).0.stdin.as_mut();
        match pipe.map(|pipe| pipe.write_all(&picture.to_rgb8())) {
            Some(Ok(())) => Ok(()),
            _ => Err(self.failure()),
        }
    }

    /// Waits for ffmpeg to finish, and gives the file its name.
    pub(crate) fn finish(mut self) -> Result<PathBuf> {
        let done = self.encoder.as_mut().map(|(encoder, _)| {
            // ffmpeg ends when its input does.
            drop(encoder.stdin.take());
            encoder.wait()
        });
        match (done, self.encoder.take()) {
            (Some(Ok(status)), Some((_, file))) if status.success() => {
                file.finish().map_err(|error| self.unwritten(&error))?;
            }
            (_, encoder) => {
                self.encoder = encoder;
                return Err(self.failure());
            }
        }
        Ok(self.path.clone())
    }

    fn unwritten(&self, error: &std::io::Error) -> anyhow::Error {
        anyhow!("-o {}: cannot be written: {error}", self.path.display())
    }

    fn start(&self) -> Result<(Child, AtomicFile)> {
        let file = AtomicFile::create(&self.path).map_err(|error| self.unwritten(&error))?;
        let Size { width, height } = self.size;
        let gif = has_ending(&self.path, &["gif"]);
        let mut command = Command::new(&self.ffmpeg);
        command.args(["-v", "error", "-nostdin", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]);
        command.args(["-s", &format!("{width}x{height}"), "-r", &self.fps.to_string(), "-i", "pipe:0"]);
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
        command.arg(file.temporary()).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let encoder =
            command.spawn().map_err(|error| anyhow!("{}: cannot be started: {error}", self.ffmpeg.display()))?;
        Ok((encoder, file))
    }

    fn failure(&mut self) -> anyhow::Error {
        let (mut message, mut status) = (String::new(), String::new());
        if let Some((encoder, _)) = &mut self.encoder {
            drop(encoder.stdin.take());
            // If ffmpeg's own message cannot be read, the error goes without it.
            let _ = encoder.stderr.take().map(|mut pipe| pipe.read_to_string(&mut message));
            let _ = encoder.wait().map(|ended| status = format!(" ({ended})"));
        }
        anyhow!("-o {}: ffmpeg failed{status}: {}", self.path.display(), message.trim())
    }
}

impl Drop for Encoder {
    fn drop(&mut self) {
        // Reached only after a failure that was reported. The file is deleted after the process that writes it has ended.
        if let Some((mut encoder, _file)) = self.encoder.take() {
            let _ = encoder.kill();
            let _ = encoder.wait();
        }
    }
}
