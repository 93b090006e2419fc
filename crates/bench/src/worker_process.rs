//! Worker processes that answer requests in lines of JSON: those of `liveview sweep`, and the Python implementations.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

use anyhow::{Context, Result, bail};
use serde_json::Value;

/// A path as text for a worker; JSON holds only UTF-8.
pub(crate) fn text_of(path: &Path) -> Result<&str> {
    path.to_str().with_context(|| format!("{}: cannot be sent to a worker; expected a path in UTF-8", path.display()))
}

/// A process that answers requests. Dropping it waits for its end.
pub(crate) struct WorkerProcess {
    process: Child,
    from: BufReader<ChildStdout>,
    name: String,
}

impl WorkerProcess {
    /// Starts a command, sends it its job if there is one, and waits until it is ready. Returns also its first line, which describes
    /// it. `name` is for errors.
    pub(crate) fn start(name: &str, command: &[OsString], job: Option<&Value>) -> Result<(Self, Value)> {
        let (program, args) = command.split_first().context("expected a command")?;
        let mut command = Command::new(program);
        command.args(args).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut process = command.spawn().with_context(|| format!("{}: cannot be started", program.display()))?;
        let from = BufReader::new(process.stdout.take().expect("piped"));
        let mut worker = Self { process, from, name: name.to_owned() };
        if let Some(job) = job {
            worker.send(job)?;
        }
        let ready = worker.receive()?;
        Ok((worker, ready))
    }

    /// Sends a request and waits for the answer.
    pub(crate) fn ask(&mut self, line: &Value) -> Result<Value> {
        self.send(line)?;
        self.receive()
    }

    fn send(&mut self, line: &Value) -> Result<()> {
        let to = self.process.stdin.as_mut().expect("piped");
        let sent = writeln!(to, "{line}").and_then(|()| to.flush());
        sent.with_context(|| format!("{}: ended unexpectedly", self.name))
    }

    fn receive(&mut self) -> Result<Value> {
        let mut line = String::new();
        if self.from.read_line(&mut line)? == 0 {
            bail!("{}: ended unexpectedly", self.name);
        }
        let answer: Value = serde_json::from_str(&line)
            .with_context(|| format!("{}: answered {:?}; expected a line of JSON", self.name, line.trim()))?;
        match answer["error"].as_str() {
            Some(error) => bail!("{}: {error}", self.name),
            None => Ok(answer),
        }
    }
}

impl Drop for WorkerProcess {
    /// Waits, which closes the process's input and so ends it; if waiting fails, kills it.
    fn drop(&mut self) {
        if self.process.wait().is_err() {
            let _ = self.process.kill();
        }
    }
}
