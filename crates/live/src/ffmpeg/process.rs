//! A running ffmpeg process: reads its messages, and kills it if it hangs; and the videos that are read through one.

use std::ffi::OsString;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
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
const MAX_MESSAGE_BYTES: usize = 2000;
/// Makes ffmpeg write the time of each frame among its messages, before the frame itself: frames without metadata are left out.
const PRINT_STAMPS: &str = "metadata=add:key=frame:value=0,metadata=print:file='pipe\\:2':direct=1";
/// How long a time stamp may take to arrive after its frame.
const STAMP_TIMEOUT: Duration = Duration::from_secs(1);

/// An ffmpeg process whose standard error is read, and which is killed if it hangs.
#[derive(Debug)]
pub(crate) struct Process {
    handle: ProcessHandle,
    messages: Option<JoinHandle<String>>,
    /// The time stamps of frames, seconds, if ffmpeg writes them.
    stamps: Receiver<f64>,
    watchdog: Arc<Watchdog>,
}

/// State shared with the thread that kills ffmpeg if it hangs.
#[derive(Debug, Default)]
struct Watchdog {
    /// How often the program has begun or ended to wait for ffmpeg: it waits while the number is odd.
    waits: AtomicU64,
    /// Whether ffmpeg was killed because it hung.
    hung: AtomicBool,
}

impl Process {
    /// Starts the process. It is not idle while `file` grows.
    pub(crate) fn start(command: &mut Command, file: Option<&Path>) -> Result<Self> {
        Self::start_with(command, file, MAX_IDLE)
    }

    fn start_with(command: &mut Command, file: Option<&Path>, max_idle: Duration) -> Result<Self> {
        // In a process group of its own, so that a Ctrl-C in the terminal does not end ffmpeg as well: it exits at the end of
        // its input, or is killed.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, 0);
        let program = command.get_program().to_owned();
        let mut child = command
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| anyhow!("{}: cannot be started: {error}", program.display()))?;
        let pipe = child.stderr.take().expect("piped");
        let (sender, stamps) = channel();
        let messages = Some(std::thread::spawn(move || messages(pipe, &sender)));
        let (handle, watchdog) = (ProcessHandle(Arc::new(Mutex::new(child))), Arc::<Watchdog>::default());
        let (watched, shared, file) = (handle.clone(), Arc::clone(&watchdog), file.map(Path::to_owned));
        std::thread::spawn(move || shared.kill_if_it_hangs(&watched, file, max_idle));
        Ok(Self { handle, messages, stamps, watchdog })
    }

    /// Gives access to the process.
    pub(crate) fn with_child<T>(&self, work: impl FnOnce(&mut Child) -> T) -> T {
        self.handle.with(work)
    }

    /// Runs `work`, which waits for ffmpeg; ffmpeg is killed if it hangs meanwhile.
    pub(crate) fn waiting<T>(&self, work: impl FnOnce() -> T) -> T {
        self.watchdog.waits.fetch_add(1, Ordering::Relaxed);
        let result = work();
        self.watchdog.waits.fetch_add(1, Ordering::Relaxed);
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
        self.handle.kill();
    }
}

impl Watchdog {
    fn kill_if_it_hangs(&self, handle: &ProcessHandle, file: Option<PathBuf>, max_idle: Duration) {
        let written = || file.as_ref().and_then(|file| Some(file.metadata().ok()?.len()));
        let (mut before, mut idle) = (None, Duration::ZERO);
        while handle.with(|child| matches!(child.try_wait(), Ok(None))) {
            sleep(CHECK_INTERVAL);
            let now = Some((self.waits.load(Ordering::Relaxed), written()));
            let is_idle = now.is_some_and(|(waits, _)| waits % 2 == 1) && now == before;
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
struct ProcessHandle(Arc<Mutex<Child>>);

impl ProcessHandle {
    /// Kills the process.
    fn kill(&self) {
        self.with(|child| {
            let _ = child.kill();
            let _ = child.wait();
        });
    }

    fn with<T>(&self, work: impl FnOnce(&mut Child) -> T) -> T {
        work(&mut lock(&self.0))
    }
}

/// Whether no more is to be read, and the processes that read videos and cameras.
static READING: Mutex<(bool, Vec<ProcessHandle>)> = Mutex::new((false, Vec::new()));

/// Ends all processes that read videos and cameras, also those that are started later.
pub fn end_reading() {
    let mut reading = lock(&READING);
    reading.0 = true;
    reading.1.iter().for_each(ProcessHandle::kill);
}

/// Whether nothing more is read ([`end_reading`]).
pub(crate) fn has_ended() -> bool {
    lock(&READING).0
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The start of the messages, in one line; time stamps are passed on. The rest is read and discarded, so that the process does
/// not block on a full pipe.
fn messages(pipe: ChildStderr, stamps: &Sender<f64>) -> String {
    let (mut pipe, mut start) = (BufReader::new(pipe), String::new());
    loop {
        let mut line = Vec::new();
        // If the messages cannot be read, the error is reported without them.
        if pipe.by_ref().take(MAX_MESSAGE_BYTES as u64).read_until(b'\n', &mut line).unwrap_or(0) == 0 {
            return start;
        }
        let line = String::from_utf8_lossy(&line);
        if let Some((_, stamp)) = line.split_once("pts_time:") {
            let _ = stamps.send(stamp.trim().parse().unwrap_or(f64::NAN));
        } else if !line.trim().is_empty() && !line.starts_with("frame=") && start.len() < MAX_MESSAGE_BYTES {
            start = [start.as_str(), line.trim()].join(if start.is_empty() { "" } else { "; " });
        }
    }
}

/// Whether this is the address of a stream, such as `rtsp://camera/1`, and no file.
pub fn is_address(path: &Path) -> bool {
    let scheme = path.to_str().and_then(|text| text.split_once("://")).map_or("", |(scheme, _)| scheme);
    !scheme.is_empty() && scheme.bytes().all(|byte| byte.is_ascii_alphanumeric())
}

/// Options with which ffmpeg opens an address, a camera of this machine, or a file.
fn input(path: &Path) -> io::Result<Vec<OsString>> {
    let device: &[&str] = if path.to_string_lossy().starts_with("/dev/video") { &["-f", "v4l2"] } else { &[] };
    // Absolute: ffmpeg takes a name before a colon for a protocol.
    let name = if is_address(path) { path.to_owned() } else { std::path::absolute(path)? };
    Ok(device.iter().chain(&["-i"]).map(OsString::from).chain([name.into()]).collect())
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
        Self::start_with(path, &[], &options, MAX_IDLE)
    }

    /// Starts ffmpeg on a camera that runs, or on a file that grows: to read each frame when it comes, and its time stamp.
    pub(crate) fn live(path: &Path, max_idle: Duration) -> Result<Self> {
        // Threads, a buffer, a long look at the stream or a fixed rate would hold frames back.
        let mut before =
            vec!["-fflags", "nobuffer", "-flags", "low_delay", "-threads", "1", "-analyzeduration", "1000000"];
        before.extend(path.is_file().then_some(["-follow", "1"]).into_iter().flatten());
        let options = ["-copyts", "-vf", PRINT_STAMPS, "-fps_mode", "passthrough", "-pix_fmt", "rgb24"];
        Self::start_with(path, &before, &[&options[..], &["-f", "image2pipe", "-c:v", "ppm"]].concat(), max_idle)
    }

    fn start_with(path: &Path, before: &[&str], options: &[&str], max_idle: Duration) -> Result<Self> {
        let mut command = command(&format!("{}: videos are read by ffmpeg, which is not on the PATH", path.display()))?;
        command.args(before).args(input(path)?).arg("-an").args(options).arg("-");
        let command = command.stdin(Stdio::null()).stdout(Stdio::piped());
        let process = Process::start_with(command, None, max_idle)?;
        let mut reading = lock(&READING);
        reading.1.retain(|reading| reading.with(|child| matches!(child.try_wait(), Ok(None))));
        reading.1.push(process.handle.clone());
        // Of a process that is killed nothing can be read.
        if reading.0 {
            process.handle.kill();
        }
        drop(reading);
        let pipe = process.with_child(|child| child.stdout.take()).expect("piped");
        Ok(Self { path: path.to_owned(), process, pipe: BufReader::with_capacity(1 << 16, pipe) })
    }

    /// The frame rate of a video.
    pub(crate) fn rate(path: &Path) -> Result<FrameRate> {
        // The y4m header holds the rate; the pixels are not read.
        let options = ["-frames:v", "1", "-pix_fmt", "gray", "-f", "yuv4mpegpipe"];
        let mut decoder = Self::start_with(path, &[], &options, MAX_IDLE)?;
        let mut header = String::new();
        let _ = decoder.reading(|pipe| pipe.by_ref().take(256).read_line(&mut header));
        let rate = header.split_whitespace().find_map(|word| word.strip_prefix('F')?.replace(':', "/").parse().ok());
        match rate {
            Some(rate) => Ok(rate),
            None if header.is_empty() => Err(decoder.failed()),
            None => bail!("{}: ffmpeg reports no frame rate", path.display()),
        }
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

    /// Time stamps of frames, seconds, NaN where the stream has none: that of the next frame, or of all that ffmpeg has come to.
    pub(crate) fn stamps(&self, of_next: bool) -> Vec<f64> {
        let stamps = &self.process.stamps;
        if of_next { stamps.recv_timeout(STAMP_TIMEOUT).into_iter().collect() } else { stamps.try_iter().collect() }
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
        endless.handle.kill();
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
