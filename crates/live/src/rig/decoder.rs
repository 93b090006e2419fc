//! Reading videos through the ffmpeg program.

use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{ChildStdout, Stdio};

use anyhow::{Context, Result, anyhow, bail};
use liveview::ImageRgb;
use liveview::geometry::{MAX_SIDE, Size};

use crate::ffmpeg::{FrameRate, Process, ProcessHandle, command};

/// A video that is being read. ffmpeg writes each frame as a portable pixmap (PPM), whose header holds the size.
#[derive(Debug)]
pub(super) struct Decoder {
    path: PathBuf,
    process: Process,
    pipe: BufReader<ChildStdout>,
}

impl Decoder {
    /// Starts ffmpeg, to read every frame, or with a rate the frame at each of its times.
    pub(super) fn start(path: &Path, rate: Option<FrameRate>) -> Result<Self> {
        let filter = rate.map(|rate| format!("fps={rate}"));
        let mut options = vec!["-pix_fmt", "rgb24"];
        options.extend(filter.iter().flat_map(|filter| ["-vf", filter]));
        options.extend(["-f", "image2pipe", "-c:v", "ppm"]);
        Self::start_with(path, &options)
    }

    fn start_with(path: &Path, options: &[&str]) -> Result<Self> {
        let mut command = command(&format!("{}: videos are read by ffmpeg, which is not on the PATH", path.display()))?;
        // Absolute: ffmpeg takes a name before a colon for a protocol.
        command.arg("-i").arg(std::path::absolute(path)?).arg("-an").args(options).arg("-");
        let process = Process::start(command.stdin(Stdio::null()).stdout(Stdio::piped()), None)?;
        let pipe = process.with_child(|child| child.stdout.take()).expect("piped");
        Ok(Self { path: path.to_owned(), process, pipe: BufReader::with_capacity(1 << 16, pipe) })
    }

    /// The frame rate of a video.
    pub(super) fn rate(path: &Path) -> Result<FrameRate> {
        // The y4m header holds the rate; the pixels are not read.
        let mut decoder = Self::start_with(path, &["-frames:v", "1", "-pix_fmt", "gray", "-f", "yuv4mpegpipe"])?;
        let mut header = String::new();
        let _ = decoder.reading(|pipe| pipe.by_ref().take(256).read_line(&mut header));
        let rate = header.split_whitespace().find_map(|word| word.strip_prefix('F')?.replace(':', "/").parse().ok());
        match rate {
            Some(rate) => Ok(rate),
            None if header.is_empty() => Err(decoder.failed()),
            None => bail!("{}: ffmpeg reports no frame rate", path.display()),
        }
    }

    /// A handle with which another thread can end ffmpeg while this one waits for a frame.
    pub(super) fn handle(&self) -> ProcessHandle {
        self.process.handle()
    }

    fn reading<T>(&mut self, read: impl FnOnce(&mut BufReader<ChildStdout>) -> io::Result<T>) -> io::Result<T> {
        let Self { process, pipe, .. } = self;
        process.waiting(|| read(pipe))
    }

    fn failed(&mut self) -> anyhow::Error {
        anyhow!("{}: {}", self.path.display(), self.process.failure())
    }

    /// The size of the next frame, whose pixels follow; `None` at the end.
    fn header(&mut self) -> Result<Option<Size>> {
        if self.reading(|pipe| pipe.fill_buf().map(<[u8]>::is_empty))? {
            return if self.process.wait()?.success() { Ok(None) } else { Err(self.failed()) };
        }
        let mut words = Vec::new();
        while words.len() < 4 {
            let mut line = String::new();
            if self.reading(|pipe| pipe.by_ref().take(64).read_line(&mut line))? == 0 {
                bail!("{}: ffmpeg ended within a frame", self.path.display());
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
    pub(super) fn next(&mut self) -> Result<Option<ImageRgb>> {
        let Some(size) = self.header()? else { return Ok(None) };
        let mut bytes = vec![0; 3 * size.pixels()];
        let read = self.reading(|pipe| pipe.read_exact(&mut bytes));
        read.with_context(|| format!("{}: cut short", self.path.display()))?;
        Ok(Some(ImageRgb::new(size.width, size.height, bytes.iter().map(|&byte| f32::from(byte) / 255.0).collect())?))
    }

    /// Skips a frame; false at the end.
    pub(super) fn skip(&mut self) -> Result<bool> {
        let Some(size) = self.header()? else { return Ok(false) };
        let size = 3 * size.pixels() as u64;
        Ok(self.reading(|pipe| io::copy(&mut pipe.by_ref().take(size), &mut io::sink()))? == size)
    }
}
