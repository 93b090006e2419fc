//! The file of `--done`.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use liveview::fs::bounded;
use liveview_common::records::done_list::DoneList;
use serde_json::Value;

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
        let DoneList { rendered, complete_bytes } =
            DoneList::parse(&text).map_err(|error| anyhow!("--done {at}: {error}"))?;
        let file = OpenOptions::new().append(true).create(true).open(path).and_then(|file| {
            if complete_bytes < text.len() {
                file.set_len(complete_bytes as u64)?;
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

fn write_error(path: &Path, error: &std::io::Error) -> anyhow::Error {
    anyhow!("--done {}: cannot be written: {error}", path.display())
}
