//! A running ffmpeg: what it says, how it ends, and its end where it hangs.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{JoinHandle, sleep};
use std::time::Duration;

use anyhow::{Result, anyhow};

use super::program::program;
use crate::interrupt;

/// How long ffmpeg may do nothing while it is waited for …
const LIMIT: Duration = Duration::from_secs(60);
/// … and after an interrupt.
const LIMIT_INTERRUPTED: Duration = Duration::from_secs(10);
/// Interval at which that is looked at. Intervals are counted, not the time: that goes on where the program itself is suspended.
const TICK: Duration = Duration::from_millis(50);
/// Bytes kept of what ffmpeg says.
const SAID: u64 = 2000;

/// ffmpeg with standard error read, and killed where it hangs.
#[derive(Debug)]
pub struct Process {
    running: Running,
    messages: Option<JoinHandle<String>>,
    watch: Arc<Watch>,
}

/// What the thread sees that looks whether ffmpeg hangs.
#[derive(Debug, Default)]
struct Watch {
    /// Whether it is waited for.
    waiting: AtomicBool,
    /// Times that it was.
    waits: AtomicU64,
    hung: AtomicBool,
    over: AtomicBool,
}

impl Process {
    /// Starts it. Writing to `file` counts as doing something.
    pub fn start(command: &mut Command, file: Option<&Path>) -> Result<Self> {
        Self::start_with(command, file, LIMIT)
    }

    fn start_with(command: &mut Command, file: Option<&Path>, limit: Duration) -> Result<Self> {
        let program = command.get_program().to_owned();
        let mut child = command
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| anyhow!("{}: cannot be started: {error}", program.display()))?;
        let pipe = child.stderr.take().expect("piped");
        let messages = Some(std::thread::spawn(move || messages(pipe)));
        let (running, watch) = (Running(Arc::new(Mutex::new(child))), Arc::<Watch>::default());
        let (watched, seen, file) = (running.clone(), Arc::clone(&watch), file.map(Path::to_owned));
        std::thread::spawn(move || seen.end_if_it_hangs(&watched, file, limit));
        Ok(Self { running, messages, watch })
    }

    /// A handle with which another thread can end it.
    pub fn running(&self) -> Running {
        self.running.clone()
    }

    /// Gives access to the process.
    pub fn with_child<T>(&self, work: impl FnOnce(&mut Child) -> T) -> T {
        self.running.with(work)
    }

    /// Does what waits for ffmpeg, and ends that where it hangs.
    pub fn waiting<T>(&self, work: impl FnOnce() -> T) -> T {
        self.watch.waits.fetch_add(1, Ordering::Relaxed);
        self.watch.waiting.store(true, Ordering::Relaxed);
        let done = work();
        self.watch.waiting.store(false, Ordering::Relaxed);
        done
    }

    /// Waits for its end.
    pub fn wait(&self) -> std::io::Result<ExitStatus> {
        self.waiting(|| {
            loop {
                // Not held while waiting: it may have to be killed.
                if let Some(status) = self.with_child(Child::try_wait)? {
                    return Ok(status);
                }
                sleep(Duration::from_millis(2));
            }
        })
    }

    /// Waits for its end; how it ended and what it said.
    pub fn failure(&mut self) -> String {
        let status = self.wait();
        let said = self.messages.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        let status = status.map_or_else(|error| error.to_string(), |status| status.to_string());
        if self.watch.hung.load(Ordering::Relaxed) {
            return format!("ffmpeg did nothing for too long, and was ended {said}").trim_end().to_owned();
        }
        format!("ffmpeg failed ({status}): {said}")
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.watch.over.store(true, Ordering::Relaxed);
        self.running.end();
    }
}

impl Watch {
    fn end_if_it_hangs(&self, running: &Running, file: Option<PathBuf>, limit: Duration) {
        let written = || file.as_ref().and_then(|file| Some(file.metadata().ok()?.len()));
        let (mut before, mut idle) = (None, Duration::ZERO);
        while !self.over.load(Ordering::Relaxed) {
            sleep(TICK);
            let now = Some((self.waits.load(Ordering::Relaxed), written()));
            let hangs = self.waiting.load(Ordering::Relaxed) && now == before;
            idle = if hangs { idle + TICK } else { Duration::ZERO };
            before = now;
            if idle > if interrupt::requested() { limit.min(LIMIT_INTERRUPTED) } else { limit } {
                self.hung.store(true, Ordering::Relaxed);
                return running.end();
            }
        }
    }
}

/// A handle to the running ffmpeg process.
#[derive(Debug, Clone)]
pub struct Running(Arc<Mutex<Child>>);

impl Running {
    /// Kills it.
    pub fn end(&self) {
        self.with(|child| {
            let _ = child.kill();
            let _ = child.wait();
        });
    }

    fn with<T>(&self, work: impl FnOnce(&mut Child) -> T) -> T {
        work(&mut self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
    }
}

/// The first of what it says, in one line; the rest is read, that it does not wait for a reader.
fn messages(mut pipe: ChildStderr) -> String {
    let mut said = Vec::new();
    // Where its message cannot be read, the error goes without it.
    let _ = pipe.by_ref().take(SAID).read_to_end(&mut said);
    let _ = std::io::copy(&mut pipe, &mut std::io::sink());
    let said = String::from_utf8_lossy(&said);
    said.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join("; ")
}

/// ffmpeg, or an error that says what it is needed for.
pub fn command(what: &str) -> Result<Command> {
    let program = program().ok_or_else(|| anyhow!("{what}"))?;
    let mut command = Command::new(program);
    command.args(["-v", "error", "-nostdin"]);
    Ok(command)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn shell(script: &str) -> Command {
        let mut command = Command::new("/bin/sh");
        command.args(["-c", script]);
        command
    }

    #[test]
    fn what_it_says_and_how_it_ended_are_told() {
        let script = "echo first >&2; echo; echo ' second ' >&2; exit 3";
        let said = Process::start(&mut shell(script), None).unwrap().failure();
        assert_eq!(said, "ffmpeg failed (exit status: 3): first; second");
        let much = Process::start(&mut shell("/usr/bin/yes >&2 | /usr/bin/head -c 9"), None).unwrap();
        much.running().end();
    }

    #[test]
    fn one_that_hangs_is_ended_and_one_that_writes_is_not() {
        let limit = Duration::from_millis(300);
        let mut hangs = Process::start_with(&mut shell("exec /bin/sleep 60"), None, limit).unwrap();
        assert_eq!(hangs.failure(), "ffmpeg did nothing for too long, and was ended");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a");
        let script = format!("for i in 1 2 3 4 5 6 7 8; do /bin/sleep 0.1; echo >> {}; done", file.display());
        assert!(Process::start_with(&mut shell(&script), Some(&file), limit).unwrap().wait().unwrap().success());
        // Not waited for: it is the program that takes its time.
        let idle = Process::start_with(&mut shell("exec /bin/sleep 1"), None, limit).unwrap();
        sleep(3 * limit);
        assert!(idle.wait().unwrap().success());
    }
}
