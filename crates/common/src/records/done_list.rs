//! The contents of the file of `batch --done`: a line of JSON for each command that has run.

use std::collections::HashMap;

use anyhow::{Result, bail};
use liveview::fs::bounded;
use serde_json::Value;

const EXPECTED: &str = "expected a file of an earlier run of `liveview batch`, or no file";

/// The commands that were rendered.
#[derive(Debug)]
pub struct DoneList {
    /// The output files of each rendered command.
    pub rendered: HashMap<Vec<String>, Vec<String>>,
    /// Bytes of the complete lines, from the start of the file. An incomplete last line is
    /// overwritten.
    pub complete_bytes: usize,
}

impl DoneList {
    /// Parses a list; an error if it is not one of an earlier run.
    pub fn parse(bytes: &[u8]) -> Result<Self> {
        let text = bounded::without_byte_order_mark(bytes);
        // An incomplete last line is only overwritten if it starts as one of this program.
        let complete = text.iter().rposition(|&byte| byte == b'\n').map_or(0, |at| at + 1);
        let (tail, start) = (&text[complete..], b"{\"command\":");
        let length = tail.len().min(start.len());
        if tail[..length] != start[..length] {
            bail!("{EXPECTED}");
        }
        let mut rendered = HashMap::new();
        let lines = text[..complete].split(|&byte| byte == b'\n').enumerate();
        for (index, line) in lines.filter(|(_, line)| !line.is_empty()) {
            let found: Option<Value> = serde_json::from_slice(line).ok().filter(|found: &Value| found["line"].is_u64());
            let Some(found) = found else { bail!("line {}: {EXPECTED}", index + 1) };
            let texts = |list: &Value| list.as_array().into_iter().flatten().filter_map(text_of).collect::<Vec<_>>();
            let result = &found["result"];
            let mut files: Vec<String> =
                result["targets"].as_array().into_iter().flatten().flat_map(|target| texts(&target["files"])).collect();
            files.extend(text_of(&result["video"]));
            if result.is_object() {
                rendered.insert(texts(&found["command"]), files);
            }
        }
        Ok(Self { rendered, complete_bytes: bytes.len() - tail.len() })
    }
}

fn text_of(value: &Value) -> Option<String> {
    value.as_str().map(str::to_owned)
}
