//! Output of the program: results on stdout, notes and errors on stderr, a progress bar on a
//! terminal.

use std::fmt::Display;
use std::io::Write;
use std::path::Path;

use indicatif::{ProgressBar, ProgressStyle};
use liveview::network::NetworkError;
use liveview_scene::SceneError;
use liveview_synthesizer::SynthesisError;

use crate::ort_wheel;

/// What a command prints on stdout.
#[derive(Debug)]
pub(crate) struct Output {
    /// What is printed without `--json`.
    pub(crate) text: String,
    /// What is printed with it.
    pub(crate) json: serde_json::Value,
}

/// The text of an error and of its causes, without repetitions, and advice on which option helps.
pub(crate) fn full_text(error: &anyhow::Error) -> String {
    let causes = error.chain().map(ToString::to_string);
    let text = causes.reduce(|text, cause| if text.contains(&cause) { text } else { format!("{text}: {cause}") });
    let text = text.unwrap_or_default();
    let of_scene = error.chain().filter_map(|cause| cause.downcast_ref()).find_map(|error| match error {
        SceneError::Oriented { .. } => Some("Give --exif-rotate".to_owned()),
        SceneError::NoPoses { .. } => Some("`liveview poses PHOTOS -o SCENE` finds them".to_owned()),
        _ => None,
    });
    match error.downcast_ref::<SynthesisError>().and_then(advice).or(of_scene) {
        Some(advice) => format!("{text}. {advice}"),
        None => text,
    }
}

/// The option or command that helps with an error.
pub(crate) fn advice(error: &SynthesisError) -> Option<String> {
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
        SynthesisError::Threads { .. } => Some("Give --threads".to_owned()),
        SynthesisError::Network(NetworkError::Unfit { field, .. }) if field.contains("recommended_layers") => {
            Some("Or give --layers".to_owned())
        }
        _ => None,
    }
}

/// A path as text for JSON; serialising a path that is not UTF-8 would panic.
pub(crate) fn path_text(path: &Path) -> String {
    path.display().to_string()
}

/// A number of things: "1 layer", "2 layers".
pub(crate) fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// The text with its control characters escaped: it may contain names from files, and a terminal
/// would interpret them.
pub(crate) fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_control() { escaped.extend(c.escape_default()) } else { escaped.push(c) }
    }
    escaped
}

/// Prints a line on stderr; `eprintln` would panic if stderr is closed.
pub(crate) fn print_message(kind: &str, what: impl Display) {
    let _ = writeln!(std::io::stderr(), "{kind}: {}", escaped(&what.to_string()));
}

/// Prints a note on stderr.
pub(crate) fn print_note(note: &str) {
    print_message("note", note);
}

/// Prints the notes of a scene on stderr.
pub(crate) fn print_notes(notes: &[String]) {
    notes.iter().for_each(|note| print_note(note));
}

/// A progress bar on stderr that counts its prefix (such as pictures); hidden unless stderr is a
/// terminal.
pub(crate) fn progress() -> anyhow::Result<ProgressBar> {
    let template = "{bar:40} {prefix} {pos} of {len}, {elapsed}, {eta} left {msg}";
    Ok(ProgressBar::new(0).with_style(ProgressStyle::with_template(template)?))
}
