//! The file of `--done`: a line of JSON for each command that has run.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use liveview::fs::bounded;
use serde_json::Value;

const EXPECTED: &str = "expected a file of an earlier run of `liveview batch`, or no file";

/// The file, open for appending.
pub(super) struct DoneFile {
    path: PathBuf,
    file: File,
    /// The output files of each rendered command.
    rendered: HashMap<Vec<String>, Vec<String>>,
}

impl DoneFile {
    /// Opens or creates the file; an error if it is not one of an earlier run.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let at = path.display();
        let text = match bounded::read_regular(path, bounded::MAX_BYTES) {
            Err(error) if error.kind() == ErrorKind::NotFound => Vec::new(),
            text => text.with_context(|| format!("--done {at}: cannot be read"))?,
        };
        let (all, text) = (text.len(), bounded::without_byte_order_mark(&text));
        let mark = all - text.len();
        let mut rendered = HashMap::new();
        // An incomplete last line is overwritten, but only if it starts as one of this program.
        let complete = text.iter().rposition(|&byte| byte == b'\n').map_or(0, |at| at + 1);
        let (tail, start) = (&text[complete..], b"{\"command\":");
        let length = tail.len().min(start.len());
        if tail[..length] != start[..length] {
            bail!("--done {at}: {EXPECTED}");
        }
        let lines = text[..complete].split(|&byte| byte == b'\n').enumerate();
        for (index, line) in lines.filter(|(_, line)| !line.is_empty()) {
            let found: Option<Value> = serde_json::from_slice(line).ok().filter(|found: &Value| found["line"].is_u64());
            let Some(found) = found else { bail!("--done {at}: line {}: {EXPECTED}", index + 1) };
            let texts = |list: &Value| list.as_array().into_iter().flatten().filter_map(text_of).collect::<Vec<_>>();
            let result = &found["result"];
            let mut files: Vec<String> =
                result["targets"].as_array().into_iter().flatten().flat_map(|target| texts(&target["files"])).collect();
            files.extend(text_of(&result["video"]));
            if result.is_object() {
                rendered.insert(texts(&found["command"]), files);
            }
        }
        let file = OpenOptions::new().append(true).create(true).open(path).and_then(|file| {
            if complete < text.len() {
                file.set_len((mark + complete) as u64)?;
            }
            Ok(file)
        });
        Ok(Self { path: path.to_owned(), file: file.map_err(|error| write_error(path, &error))?, rendered })
    }

    /// Whether a command was rendered, and its output files still exist.
    pub(super) fn lists(&self, command: &Vec<String>) -> bool {
        self.rendered.get(command).is_some_and(|files| files.iter().all(|file| Path::new(file).exists()))
    }

    /// Appends the result of a command.
    pub(super) fn add(&mut self, line: &Value) -> Result<()> {
        self.file.write_all(format!("{line}\n").as_bytes()).map_err(|error| write_error(&self.path, &error))
    }
}

fn text_of(value: &Value) -> Option<String> {
    value.as_str().map(str::to_owned)
}

fn write_error(path: &Path, error: &std::io::Error) -> anyhow::Error {
    anyhow!("--done {}: cannot be written: {error}", path.display())
}
