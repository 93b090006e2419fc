//! Reading videos through the ffmpeg program.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex};

use anyhow::{Context, Result, anyhow, bail};
use liveview::ImageRgb;
use liveview::geometry::{MAX_SIDE, Size};

use super::program::{detach, program};

/// A video being read: ffmpeg writes each frame as a portable pixmap, whose header holds its size.
pub(crate) struct Decoder {
    path: PathBuf,
    child: Running,
    pipe: BufReader<ChildStdout>,
}

impl Decoder {
    pub(crate) fn start(path: &Path) -> Result<Self> {
        let program = program()
            .ok_or_else(|| anyhow!("{}: videos are read by ffmpeg, which is not on the PATH", path.display()))?;
        let mut command = Command::new(&program);
        command.args(["-v", "error", "-nostdin", "-i"]).arg(path).args(["-an", "-f", "image2pipe", "-c:v", "ppm", "-"]);
        detach(&mut command);
        let mut child = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|error| anyhow!("{}: cannot be started: {error}", program.display()))?;
        let pipe = child.stdout.take().expect("piped");
        let child = Running(Arc::new(Mutex::new(child)));
        Ok(Self { path: path.to_owned(), child, pipe: BufReader::with_capacity(1 << 16, pipe) })
    }

    /// A handle with which another thread can end ffmpeg, while this one waits for a frame.
    pub(crate) fn running(&self) -> Running {
        self.child.clone()
    }

    /// Width and height of the next frame, whose pixels follow; `None` at the end.
    fn header(&mut self) -> Result<Option<Size>> {
        if self.pipe.fill_buf()?.is_empty() {
            return Ok(None);
        }
        let mut words = Vec::new();
        while words.len() < 4 {
            let mut line = String::new();
            if self.pipe.by_ref().take(64).read_line(&mut line)? == 0 {
                bail!("{}: ffmpeg stopped within a frame", self.path.display());
            }
            words.extend(line.split_whitespace().map(str::to_owned));
        }
        let side = |word: &str| word.parse().ok().filter(|side| (1..=MAX_SIDE).contains(side));
        match (words[0].as_str(), side(&words[1]), side(&words[2]), words[3].as_str()) {
            ("P6", Some(width), Some(height), "255") => Ok(Some(Size::new(width, height))),
            _ => bail!("{}: ffmpeg wrote {}; expected an 8-bit pixmap", self.path.display(), words.join(" ")),
        }
    }

    /// The next frame; `None` at the end.
    pub(crate) fn next(&mut self) -> Result<Option<ImageRgb>> {
        let Some(size) = self.header()? else { return Ok(None) };
        let mut bytes = vec![0; 3 * size.pixels()];
        self.pipe.read_exact(&mut bytes).with_context(|| format!("{}: cut short", self.path.display()))?;
        Ok(Some(ImageRgb::new(size.width, size.height, bytes.iter().map(|&byte| f32::from(byte) / 255.0).collect())?))
    }

    /// Skips a frame; whether there was one.
    pub(crate) fn skip(&mut self) -> Result<bool> {
        let Some(size) = self.header()? else { return Ok(false) };
        let size = 3 * size.pixels() as u64;
        Ok(std::io::copy(&mut self.pipe.by_ref().take(size), &mut std::io::sink())? == size)
    }
}

impl Drop for Decoder {
    fn drop(&mut self) {
        // ffmpeg still runs if reading stopped before the end of the video.
        self.child.end();
    }
}

/// A handle to the running ffmpeg process.
#[derive(Clone)]
pub(crate) struct Running(Arc<Mutex<Child>>);

impl Running {
    pub(crate) fn end(&self) {
        let mut child = self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let _ = child.kill();
        let _ = child.wait();
    }
}
