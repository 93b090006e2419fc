//! Processes that answer JSON lines: those of `liveview sweep`, and the Python references.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::{Context, Result, bail};
use serde_json::Value;

/// The program and arguments of a command line without quotes.
pub(crate) fn words(command: &str) -> Vec<String> {
    command.split_whitespace().map(str::to_owned).collect()
}

/// A process that renders one configuration whenever it is asked; ended when dropped.
pub(crate) struct WorkerProcess {
    process: Child,
    to: Option<ChildStdin>,
    from: BufReader<ChildStdout>,
    name: String,
}

impl WorkerProcess {
    /// Starts a command, hands it its job if it takes one, and waits until it is ready; what it says of itself. Errors call it
    /// by its name.
    pub(crate) fn start(name: &str, command: &[String], job: Option<&Value>) -> Result<(Self, Value)> {
        let (program, args) =
            command.split_first().map_or(("", [].as_slice()), |(program, args)| (program.as_str(), args));
        let mut command = Command::new(program);
        command.args(args).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut process = command.spawn().with_context(|| format!("{program}: cannot be started"))?;
        let (Some(to), Some(from)) = (process.stdin.take(), process.stdout.take()) else { unreachable!("both piped") };
        let mut worker = Self { process, to: Some(to), from: BufReader::new(from), name: name.to_owned() };
        if let Some(job) = job {
            worker.say(job)?;
        }
        let ready = worker.listen()?;
        Ok((worker, ready))
    }

    /// Says something and waits for the answer.
    pub(crate) fn ask(&mut self, line: &Value) -> Result<Value> {
        self.say(line)?;
        self.listen()
    }

    fn say(&mut self, line: &Value) -> Result<()> {
        let Some(to) = &mut self.to else { unreachable!("closed only when dropped") };
        let said = writeln!(to, "{line}").and_then(|()| to.flush());
        said.with_context(|| format!("{}: ended before its time", self.name))
    }

    fn listen(&mut self) -> Result<Value> {
        let mut line = String::new();
        if self.from.read_line(&mut line)? == 0 {
            bail!("{}: ended before its time", self.name);
        }
        let told: Value =
            serde_json::from_str(&line).with_context(|| format!("{}: said {:?}", self.name, line.trim()))?;
        match told["error"].as_str() {
            Some(error) => bail!("{}: {error}", self.name),
            None => Ok(told),
        }
    }
}

impl Drop for WorkerProcess {
    /// It ends with its input; one that does not is ended.
    fn drop(&mut self) {
        self.to = None;
        if self.process.wait().is_err() {
            let _ = self.process.kill();
        }
    }
}

/// A line of JSON for whoever started this process.
pub(crate) fn say(line: &Value) -> Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}")?;
    Ok(out.flush()?)
}
