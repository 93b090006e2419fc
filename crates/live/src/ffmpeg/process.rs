//! A running ffmpeg process: reads its messages, and kills it if it hangs; and the videos that are read through one.

use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{JoinHandle, sleep};
use std::time::Duration;

use anyhow::{Context, Result, anyhow, bail};
use liveview::ImageRgb;
use liveview::geometry::{MAX_SIDE, Size};

use super::FrameRate;
use crate::interrupt;

/// How long ffmpeg may be idle while the program waits for it.
const MAX_IDLE: Duration = Duration::from_secs(60);
/// The same after an interrupt.
const MAX_IDLE_INTERRUPTED: Duration = Duration::from_secs(10);
/// Interval of the checks. Idle time is a number of intervals, not clock time, which passes while
/// the program is suspended.
const CHECK_INTERVAL: Duration = Duration::from_millis(50);
/// Bytes of ffmpeg's messages that are kept.
const MAX_MESSAGE_BYTES: u64 = 2000;

/// An ffmpeg process whose standard error is read, and which is killed if it hangs.
#[derive(Debug)]
pub(crate) struct Process {
    handle: ProcessHandle,
    messages: Option<JoinHandle<String>>,
    watchdog: Arc<Watchdog>,
}

/// State shared with the thread that kills ffmpeg if it hangs.
#[derive(Debug, Default)]
struct Watchdog {
    /// Whether the program is waiting for ffmpeg.
    waiting: AtomicBool,
    /// How often the program has waited.
    waits: AtomicU64,
    /// Whether ffmpeg was killed because it hung.
    hung: AtomicBool,
    /// Whether the thread should end.
    over: AtomicBool,
}

impl Process {
    /// Starts the process. It is not idle while `file` grows.
    pub(crate) fn start(command: &mut Command, file: Option<&Path>) -> Result<Self> {
        Self::start_with(command, file, MAX_IDLE)
    }

    fn start_with(command: &mut Command, file: Option<&Path>, max_idle: Duration) -> Result<Self> {
        // In a process group of its own if this program handles Ctrl-C, so that a Ctrl-C in the terminal does not end
        // ffmpeg as well: it exits at the end of its input, or is killed.
        #[cfg(unix)]
        if interrupt::flag().is_some() {
            std::os::unix::process::CommandExt::process_group(command, 0);
        }
        let program = command.get_program().to_owned();
        let mut child = command
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| anyhow!("{}: cannot be started: {error}", program.display()))?;
        let pipe = child.stderr.take().expect("piped");
        let messages = Some(std::thread::spawn(move || messages(pipe)));
        let (handle, watchdog) = (ProcessHandle(Arc::new(Mutex::new(child))), Arc::<Watchdog>::default());
        let (watched, shared, file) = (handle.clone(), Arc::clone(&watchdog), file.map(Path::to_owned));
        std::thread::spawn(move || shared.kill_if_it_hangs(&watched, file, max_idle));
        Ok(Self { handle, messages, watchdog })
    }

    /// A handle by which another thread can kill the process.
    pub(crate) fn handle(&self) -> ProcessHandle {
        self.handle.clone()
    }

    /// Gives access to the process.
    pub(crate) fn with_child<T>(&self, work: impl FnOnce(&mut Child) -> T) -> T {
        self.handle.with(work)
    }

    /// Runs `work`, which waits for ffmpeg; ffmpeg is killed if it hangs meanwhile.
    pub(crate) fn waiting<T>(&self, work: impl FnOnce() -> T) -> T {
        self.watchdog.waits.fetch_add(1, Ordering::Relaxed);
        self.watchdog.waiting.store(true, Ordering::Relaxed);
        let result = work();
        self.watchdog.waiting.store(false, Ordering::Relaxed);
        result
    }

    /// Waits for the process to exit.
    pub(crate) fn wait(&self) -> std::io::Result<ExitStatus> {
        self.waiting(|| {
            loop {
                // The lock is released between the checks, so that the process can be killed.
                if let Some(status) = self.with_child(Child::try_wait)? {
                    return Ok(status);
                }
                sleep(Duration::from_millis(2));
            }
        })
    }

    /// Waits for the process to exit. An error message if it failed or has printed a message: of a full disk ffmpeg
    /// prints an error, and may exit with 0.
    pub(crate) fn finish(&mut self) -> Result<(), String> {
        let status = self.wait();
        let messages = self.messages.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        if self.watchdog.hung.load(Ordering::Relaxed) {
            return Err(format!("ffmpeg was idle for too long and was killed {messages}").trim_end().to_owned());
        }
        if status.as_ref().is_ok_and(ExitStatus::success) && messages.is_empty() {
            return Ok(());
        }
        let status = status.map_or_else(|error| error.to_string(), |status| status.to_string());
        Err(format!("ffmpeg failed ({status}): {messages}"))
    }

    /// Waits for a process that failed to exit; returns its exit status and messages as an error message.
    pub(crate) fn failure(&mut self) -> String {
        self.finish().err().unwrap_or_else(|| "ffmpeg ended early".to_owned())
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.watchdog.over.store(true, Ordering::Relaxed);
        self.handle.kill();
    }
}

impl Watchdog {
    fn kill_if_it_hangs(&self, handle: &ProcessHandle, file: Option<PathBuf>, max_idle: Duration) {
        let written = || file.as_ref().and_then(|file| Some(file.metadata().ok()?.len()));
        let (mut before, mut idle) = (None, Duration::ZERO);
        while !self.over.load(Ordering::Relaxed) {
            sleep(CHECK_INTERVAL);
            let now = Some((self.waits.load(Ordering::Relaxed), written()));
            let is_idle = self.waiting.load(Ordering::Relaxed) && now == before;
            idle = if is_idle { idle + CHECK_INTERVAL } else { Duration::ZERO };
            before = now;
            if idle > if interrupt::requested() { max_idle.min(MAX_IDLE_INTERRUPTED) } else { max_idle } {
                self.hung.store(true, Ordering::Relaxed);
                return handle.kill();
            }
        }
    }
}

/// A handle to the running ffmpeg process.
#[derive(Debug, Clone)]
pub struct ProcessHandle(Arc<Mutex<Child>>);

impl ProcessHandle {
    /// Kills the process.
    pub fn kill(&self) {
        self.with(|child| {
            let _ = child.kill();
            let _ = child.wait();
        });
    }

    fn with<T>(&self, work: impl FnOnce(&mut Child) -> T) -> T {
        work(&mut self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
    }
}

/// The start of the messages, in one line. The rest is read and discarded, so that the process does
/// not block on a full pipe.
fn messages(mut pipe: ChildStderr) -> String {
    let mut start = Vec::new();
    // If the messages cannot be read, the error is reported without them.
    let _ = pipe.by_ref().take(MAX_MESSAGE_BYTES).read_to_end(&mut start);
    let _ = std::io::copy(&mut pipe, &mut std::io::sink());
    let start = String::from_utf8_lossy(&start);
    start.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join("; ")
}

/// A command for ffmpeg; the error `missing` if it is not installed.
pub(crate) fn command(missing: &str) -> Result<Command> {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let name = format!("ffmpeg{}", std::env::consts::EXE_SUFFIX);
    let mut programs = std::env::split_paths(&folders).map(|folder| folder.join(&name)).filter(|file| file.is_file());
    let mut command = Command::new(programs.next().ok_or_else(|| anyhow!("{missing}"))?);
    command.args(["-v", "error", "-nostdin"]);
    Ok(command)
}

/// A video that is being read. ffmpeg writes each frame as a portable pixmap (PPM), whose header holds the size.
#[derive(Debug)]
pub(crate) struct Decoder {
    path: PathBuf,
    process: Process,
    pipe: BufReader<ChildStdout>,
}

impl Decoder {
    /// Starts ffmpeg, to read every frame, or with a rate the frame at each of its times.
    pub(crate) fn start(path: &Path, rate: Option<FrameRate>) -> Result<Self> {
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
    pub(crate) fn rate(path: &Path) -> Result<FrameRate> {
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
    pub(crate) fn handle(&self) -> ProcessHandle {
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
    pub(crate) fn next(&mut self) -> Result<Option<ImageRgb>> {
        let Some(size) = self.header()? else { return Ok(None) };
        let mut bytes = vec![0; 3 * size.pixels()];
        let read = self.reading(|pipe| pipe.read_exact(&mut bytes));
        read.with_context(|| format!("{}: cut short", self.path.display()))?;
        Ok(Some(ImageRgb::new(size.width, size.height, bytes.iter().map(|&byte| f32::from(byte) / 255.0).collect())?))
    }

    /// Skips a frame; false at the end.
    pub(crate) fn skip(&mut self) -> Result<bool> {
        let Some(size) = self.header()? else { return Ok(false) };
        let size = 3 * size.pixels() as u64;
        Ok(self.reading(|pipe| io::copy(&mut pipe.by_ref().take(size), &mut io::sink()))? == size)
    }
}

#[cfg(unix)]
#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Command {
        let mut command = Command::new("/bin/sh");
        command.args(["-c", script]);
        command
    }

    #[test]
    fn failure_reports_exit_status_and_messages() {
        let script = "echo first >&2; echo; echo ' second ' >&2; exit 3";
        let message = Process::start(&mut shell(script), None).unwrap().failure();
        assert_eq!(message, "ffmpeg failed (exit status: 3): first; second");
        let finished = |script: &str| Process::start(&mut shell(script), None).unwrap().finish();
        assert_eq!(finished("exit 0"), Ok(()));
        assert_eq!(finished("echo full >&2"), Err("ffmpeg failed (exit status: 0): full".to_owned()));
        let endless = Process::start(&mut shell("/usr/bin/yes >&2 | /usr/bin/head -c 9"), None).unwrap();
        endless.handle().kill();
    }

    #[test]
    fn idle_process_is_killed_unless_it_writes_or_is_not_waited_for() {
        let max_idle = Duration::from_millis(300);
        let mut hangs = Process::start_with(&mut shell("exec /bin/sleep 60"), None, max_idle).unwrap();
        assert_eq!(hangs.failure(), "ffmpeg was idle for too long and was killed");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a");
        let script = format!("for i in 1 2 3 4 5 6 7 8; do /bin/sleep 0.1; echo >> {}; done", file.display());
        assert!(Process::start_with(&mut shell(&script), Some(&file), max_idle).unwrap().wait().unwrap().success());
        // It is idle, but the program is busy and does not wait for it.
        let idle = Process::start_with(&mut shell("exec /bin/sleep 1"), None, max_idle).unwrap();
        sleep(3 * max_idle);
        assert!(idle.wait().unwrap().success());
    }
}
