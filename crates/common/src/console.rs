//! Output of the program: results on stdout, notes and errors on stderr, a progress bar on a terminal.

use std::fmt::Display;
use std::io::Write;
use std::path::Path;

use indicatif::{ProgressBar, ProgressStyle};
use liveview::SynthesisError;
use liveview::network::NetworkError;

use crate::ort_wheel;

/// What a command prints on stdout.
#[derive(Debug)]
pub struct Output {
    /// What is printed without `--json`.
    pub text: String,
    /// What is printed with it.
    pub json: serde_json::Value,
}

/// The text of an error, with those of its causes that it does not contain itself, and with advice on what to type.
pub fn full_text(error: &anyhow::Error) -> String {
    let causes = error.chain().map(ToString::to_string);
    let text = causes.reduce(|text, cause| if text.contains(&cause) { text } else { format!("{text}: {cause}") });
    let text = text.unwrap_or_default();
    match error.downcast_ref::<SynthesisError>().and_then(advice) {
        Some(advice) => format!("{text}. {advice}"),
        None => text,
    }
}

/// Which option or command helps with an error.
pub fn advice(error: &SynthesisError) -> Option<String> {
    match error {
        SynthesisError::UnknownDepth { near, far, .. } => {
            let options = match (near, far) {
                (true, true) => "--near and --far",
                (true, false) => "--near",
                _ => "--far",
            };
            Some(format!("Give {options} (`liveview inspect` shows the size of the rig)"))
        }
        SynthesisError::Library(error) => ort_wheel::advice(error),
        SynthesisError::Network(NetworkError::Threads { .. }) => Some("Give --threads".to_owned()),
        _ => None,
    }
}

/// A path as text for JSON: serialising a path that is not UTF-8 would panic.
pub fn shown(path: &Path) -> String {
    path.display().to_string()
}

/// The text with its control characters escaped: names come from files, and a terminal would obey what is in them.
pub fn escaped(text: &str) -> String {
    escaped_but(text, None)
}

/// As [`escaped`], in lines.
pub fn escaped_lines(text: &str) -> String {
    escaped_but(text, Some('\n'))
}

fn escaped_but(text: &str, kept: Option<char>) -> String {
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_control() && Some(c) != kept { shown.extend(c.escape_default()) } else { shown.push(c) }
    }
    shown
}

/// Prints a line on stderr; `eprintln` would panic if stderr is closed.
pub fn print_message(kind: &str, what: impl Display) {
    let _ = writeln!(std::io::stderr(), "{kind}: {}", escaped(&what.to_string()));
}

/// Prints the notes of a scene on stderr: what was skipped or assumed when it was read.
pub fn print_notes(notes: &[String]) {
    notes.iter().for_each(|note| print_message("note", note));
}

/// Sends a line of JSON to the process that started this one.
pub fn send_line(line: &serde_json::Value) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}")?;
    Ok(out.flush()?)
}

/// A progress bar that counts `what` (such as layers), on stderr; hidden unless that is a terminal.
pub fn progress(what: &str) -> anyhow::Result<ProgressBar> {
    let template = format!("{{bar:40}} {{pos}}/{{len}} {what} {{elapsed}} {{msg}}");
    Ok(ProgressBar::new(0).with_style(ProgressStyle::with_template(&template)?))
}
