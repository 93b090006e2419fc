//! The text of a record: JSON that grows by a line.

use serde_json::{Map, Value, json};

/// How the file ends after the last picture.
pub(super) const END: &str = "\n}}\n";

/// A record of these members, and of the pictures that are done.
pub(super) fn whole(members: &[(&str, Value)], done: &Map<String, Value>) -> String {
    let members: String = members.iter().map(|(name, value)| format!("{}: {value:#},\n", json!(name))).collect();
    let lines: Vec<String> = done.iter().map(|(name, entry)| line(name, entry)).collect();
    format!("{{{members}\"done\": {{\n{}{END}", lines.join(",\n"))
}

/// The line of a picture.
pub(super) fn line(name: &str, entry: &Value) -> String {
    format!("{}: {entry}", json!(name))
}

/// A record; of one whose last line was cut short, without it.
pub(crate) fn parse(text: &[u8]) -> serde_json::Result<Value> {
    /// Lines that the end may take from one that is cut short.
    const LOST: usize = 3;
    let mut found = serde_json::from_slice(text);
    let ends = text.iter().enumerate().rev().filter(|(_, byte)| **byte == b'\n');
    for (end, _) in ends.take(LOST) {
        found = found.or_else(|error| {
            let whole = text[..end].strip_suffix(b",").unwrap_or(&text[..end]);
            serde_json::from_slice(&[whole, END.as_bytes()].concat()).map_err(|_| error)
        });
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_that_was_cut_short_is_read_as_far_as_it_goes() {
        let entries = ["a", "b", "c"].map(|name| line(name, &json!({ "files": [name] })));
        let start = format!("{{\"job\": {{}},\n\"done\": {{\n{},\n{}", entries[0], entries[1]);
        let (old, new) = (format!("{start}{END}"), format!("{start},\n{}{END}", entries[2]));
        for written in start.len()..=new.len() {
            // What was there is written over.
            let text = [&new[..written], old.get(written..).unwrap_or_default()].concat();
            let found = parse(text.as_bytes()).unwrap_or_else(|error| panic!("{text}: {error}"));
            let done: Vec<_> = found["done"].as_object().unwrap().keys().collect();
            assert!(!done.is_empty() && (done.len() > 1 || written < old.len()), "{text}: {done:?}");
        }
        assert!(parse(b"{").is_err() && parse(b"").is_err());
    }
}
