//! Runs ffmpeg: writes videos through it, and counts their frames.

mod process;

use std::fmt;
use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, Command, Stdio};
use std::str::FromStr;

use anyhow::{Result, anyhow, bail};
use liveview::ImageRgb;
use liveview::geometry::Size;
use liveview_files::atomic::{AtomicFile, is_special};
use liveview_files::has_extension;

pub(crate) use process::{Decoder, Process, command, has_ended};
pub use process::{end_reading, is_address};

/// Writes an .mp4 or .gif, or sends the video to an address; the file is deleted if it is dropped without [`Encoder::finish`].
#[derive(Debug)]
pub struct Encoder {
    path: PathBuf,
    rate: FrameRate,
    /// Takes notes for the user.
    note: fn(&str),
    running: Option<RunningEncoder>,
}

/// ffmpeg, its input, and the temporary file that it writes. The fields are dropped in this order:
/// the file is deleted after ffmpeg has ended.
#[derive(Debug)]
struct RunningEncoder {
    process: Process,
    input: Option<ChildStdin>,
    /// `None` for an address.
    file: Option<AtomicFile>,
    /// Number of frames written to ffmpeg.
    frames: usize,
}

/// Whether a path names a video.
pub fn is_video(path: &Path) -> bool {
    !path.is_dir() && has_extension(path, &["mp4", "gif"])
}

impl Encoder {
    /// An encoder for a file; an error if ffmpeg is not installed. The file is created by the first
    /// frame.
    pub fn new(path: &Path, rate: FrameRate, note: fn(&str)) -> Result<Self> {
        command_for(path)?;
        Ok(Self { path: path.to_owned(), rate, note, running: None })
    }

    /// The file to write.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes a frame; all have the size of the first.
    pub fn add(&mut self, picture: &ImageRgb) -> Result<()> {
        let running = match self.running.take() {
            Some(running) => running,
            None => self.start(picture.size())?,
        };
        let RunningEncoder { process, input, frames, .. } = self.running.insert(running);
        *frames += 1;
        let bytes = picture.to_rgb8();
        let written =
            process.waiting(|| input.as_mut().map_or(Err(ErrorKind::BrokenPipe.into()), |pipe| pipe.write_all(&bytes)));
        if written.is_err() {
            // ffmpeg exits at the end of its input.
            *input = None;
            bail!("-o {}: {}", self.path.display(), process.failure());
        }
        Ok(())
    }

    /// Waits for ffmpeg to finish, checks the file and renames it.
    pub fn finish(mut self) -> Result<PathBuf> {
        let Some(RunningEncoder { mut process, input, file, frames }) = self.running.take() else {
            return Ok(self.path);
        };
        let at = self.path.display();
        // ffmpeg exits at the end of its input.
        drop(input);
        process.finish().map_err(|failure| anyhow!("-o {at}: {failure}"))?;
        let Some(file) = file else { return Ok(self.path) };
        if !is_special(&self.path) {
            let found = count_frames(file.temporary());
            let found =
                found.map_err(|error| anyhow!("-o {at}: the video that ffmpeg wrote cannot be read: {error}"))?;
            if found != frames {
                bail!("-o {at}: ffmpeg wrote {found} frames; expected {frames}");
            }
        }
        file.finish().map_err(|error| self.write_error(&error))?;
        Ok(self.path)
    }

    fn write_error(&self, error: &std::io::Error) -> anyhow::Error {
        anyhow!("-o {}: cannot be written: {error}", self.path.display())
    }

    fn start(&self, size: Size) -> Result<RunningEncoder> {
        let create = || AtomicFile::create(&self.path).map_err(|error| self.write_error(&error));
        let file = if is_address(&self.path) { None } else { Some(create()?) };
        // Absolute, because ffmpeg takes a relative path such as `a:b` for a protocol and an
        // address.
        let temporary = file.as_ref().map(|file| std::path::absolute(file.temporary())).transpose()?;
        let Size { width, height } = size;
        let gif = has_extension(&self.path, &["gif"]);
        let mut command = command_for(&self.path)?;
        command.args(["-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]);
        command.args(["-s", &format!("{width}x{height}"), "-r", &self.rate.to_string(), "-i", "pipe:0"]);
        if gif {
            command.args(["-vf", "split[a][b];[a]palettegen[p];[b][p]paletteuse", "-loop", "0"]);
        } else {
            // Players expect yuv420p, which needs even dimensions.
            if width % 2 + height % 2 > 0 {
                (self.note)(&format!(
                    "{width}x{height} has an odd side: the last row or column is cropped from the video"
                ));
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
        if file.is_none() {
            let format = if self.path.starts_with("rtsp:") { "rtsp" } else { "mpegts" };
            command.args(["-preset", "ultrafast", "-tune", "zerolatency", "-f", format]);
        }
        let temporary = temporary.as_deref();
        command.arg(temporary.unwrap_or(&self.path)).stdin(Stdio::piped()).stdout(Stdio::null());
        let process = Process::start(&mut command, temporary)?;
        let input = process.with_child(|child| child.stdin.take());
        Ok(RunningEncoder { process, input, file, frames: 0 })
    }
}

fn command_for(path: &Path) -> Result<Command> {
    command(&format!("-o {}: ffmpeg is not on the PATH; expected ffmpeg, or a folder for the frames", path.display()))
}

/// The number of frames of a video. ffmpeg reads its packets and decodes none.
///
/// # Errors
///
/// If ffmpeg is not installed or cannot read the file, which the error names.
pub(crate) fn count_frames(path: &Path) -> Result<usize> {
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

/// Frames per second, as a fraction: 30, 29.97 or 30000/1001.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRate {
    /// Numerator, in lowest terms.
    pub frames: u32,
    /// Denominator, in lowest terms.
    pub seconds: u32,
}

impl FrameRate {
    /// The lowest of these.
    pub(crate) fn lowest(rates: impl Iterator<Item = Self>) -> Option<Self> {
        rates.min_by(|a, b| a.per_second().total_cmp(&b.per_second()))
    }

    /// The rate as a number.
    pub fn per_second(self) -> f64 {
        f64::from(self.frames) / f64::from(self.seconds)
    }
}

impl FromStr for FrameRate {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
        let number = |text: &str| text.parse::<u32>().ok().filter(|&number| number > 0 && digits(text));
        let parts = match (text.split_once('/'), text.split_once('.')) {
            (Some((frames, seconds)), _) => number(frames).zip(number(seconds)),
            (None, Some((_, decimals))) if (1..=6).contains(&decimals.len()) => {
                number(&text.replacen('.', "", 1)).zip(Some(10_u32.pow(decimals.len() as u32)))
            }
            _ => number(text).zip(Some(1)),
        };
        let (frames, seconds) = parts.ok_or(())?;
        let (mut divisor, mut rest) = (frames, seconds);
        while rest > 0 {
            (divisor, rest) = (rest, divisor % rest);
        }
        Ok(Self { frames: frames / divisor, seconds: seconds / divisor })
    }
}

/// In ffmpeg's notation.
impl fmt::Display for FrameRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.seconds {
            1 => write!(f, "{}", self.frames),
            seconds => write!(f, "{}/{seconds}", self.frames),
        }
    }
}
