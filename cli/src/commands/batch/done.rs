//! The file of what is done, a line of JSON for each command.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use liveview::fs::bounded;
use liveview_common::args::output::refuse_stdout;
use serde_json::Value;

const EXPECTED: &str = "expected what an earlier run of `liveview batch` has written, or no file";

/// The file, and the files of each command that it lists as rendered.
pub(super) struct DoneFile {
    path: PathBuf,
    file: File,
    rendered: HashMap<Vec<String>, Vec<String>>,
}

impl DoneFile {
    /// Opens it, to be added to; an error if it is not what an earlier run has written.
    pub(super) fn open(path: &Path, list: &Path) -> Result<Self> {
        let at = path.display();
        refuse_stdout("--done", path)?;
        let real = |path: &Path| path.canonicalize().ok();
        if real(path).is_some_and(|path| Some(path) == real(list)) {
            bail!("--done {at}: is the list itself; expected another file");
        }
        let text = match bounded::read(path, bounded::MAX_BYTES) {
            Err(error) if error.kind() == ErrorKind::NotFound => Vec::new(),
            text => text.with_context(|| format!("--done {at}: cannot be read"))?,
        };
        let mut rendered = HashMap::new();
        // The last line may have been cut short: it is written over.
        let whole = text.iter().rposition(|&byte| byte == b'\n').map_or(0, |at| at + 1);
        // As the program writes it, keys in order: any other text would be lost.
        let (tail, begun) = (&text[whole..], b"{\"command\":");
        let length = tail.len().min(begun.len());
        if tail[..length] != begun[..length] {
            bail!("--done {at}: {EXPECTED}");
        }
        for (index, line) in text[..whole].split(|&byte| byte == b'\n').enumerate().filter(|(_, line)| !line.is_empty())
        {
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
            file.set_len(whole as u64)?;
            Ok(file)
        });
        Ok(Self { path: path.to_owned(), file: file.map_err(|error| unwritten(path, &error))?, rendered })
    }

    /// Whether a command was rendered, and its files still exist.
    pub(super) fn lists(&self, command: &Vec<String>) -> bool {
        self.rendered.get(command).is_some_and(|files| files.iter().all(|file| Path::new(file).exists()))
    }

    /// Adds what is told of a command.
    pub(super) fn add(&mut self, line: &Value) -> Result<()> {
        self.file.write_all(format!("{line}\n").as_bytes()).map_err(|error| unwritten(&self.path, &error))
    }
}

fn text_of(value: &Value) -> Option<String> {
    value.as_str().map(str::to_owned)
}

fn unwritten(path: &Path, error: &std::io::Error) -> anyhow::Error {
    anyhow!("--done {}: cannot be written: {error}", path.display())
}
