//! The text of a record: JSON that can be extended by a line.

use liveview::fs::bounded;
use serde_json::{Map, Value, json};

/// The text after the last picture's entry.
pub const END: &str = "\n}}\n";

/// A record with these members and the entries of the finished pictures.
pub fn document(members: &[(&str, Value)], done: &Map<String, Value>) -> String {
    let members: String = members.iter().map(|(name, value)| format!("{}: {value:#},\n", json!(name))).collect();
    let lines: Vec<String> = done.iter().map(|(name, entry)| line(name, entry)).collect();
    format!("{{{members}\"done\": {{\n{}{END}", lines.join(",\n"))
}

/// The line of a picture.
pub fn line(name: &str, entry: &Value) -> String {
    format!("{}: {entry}", json!(name))
}

/// Parses a record; an incomplete last line is ignored.
pub fn parse(text: &[u8]) -> serde_json::Result<Value> {
    /// Line breaks that may follow the last complete line: its own, and those of [`END`].
    const MAX_LINE_BREAKS: usize = 3;
    let text = bounded::without_byte_order_mark(text);
    let mut record = serde_json::from_slice(text);
    let ends = text.iter().enumerate().rev().filter(|(_, byte)| **byte == b'\n');
    for (end, _) in ends.take(MAX_LINE_BREAKS) {
        record = record.or_else(|error| {
            let complete = text[..end].strip_suffix(b",").unwrap_or(&text[..end]);
            serde_json::from_slice(&[complete, END.as_bytes()].concat()).map_err(|_| error)
        });
    }
    record
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parse_reads_all_complete_lines_of_a_truncated_record() {
        let entries = ["a", "b", "c"].map(|name| line(name, &json!({ "files": [name] })));
        let start = format!("{{\"job\": {{}},\n\"done\": {{\n{},\n{}", entries[0], entries[1]);
        let (old, new) = (format!("{start}{END}"), format!("{start},\n{}{END}", entries[2]));
        for written in start.len()..=new.len() {
            // The new text overwrites the old one.
            let text = [&new[..written], old.get(written..).unwrap_or_default()].concat();
            let found = parse(text.as_bytes()).unwrap_or_else(|error| panic!("{text}: {error}"));
            let done: Vec<_> = found["done"].as_object().unwrap().keys().collect();
            assert!(!done.is_empty() && (done.len() > 1 || written < old.len()), "{text}: {done:?}");
        }
        assert!(parse(b"{").is_err() && parse(b"").is_err());
    }
}
