//! What the program says: results on stdout, notes and errors on stderr, a progress bar on a terminal.

use std::fmt::Display;
use std::io::Write;
use std::path::Path;

use indicatif::{ProgressBar, ProgressStyle};
use liveview::SynthesisError;

use crate::ort_wheel;

/// What a command prints on stdout.
pub(crate) struct Output {
    pub(crate) text: String,
    pub(crate) json: serde_json::Value,
}

/// An error with those of its causes that it does not tell itself, and with what to type about it.
pub(crate) fn in_full(error: &anyhow::Error) -> String {
    let causes = error.chain().map(ToString::to_string);
    let text = causes.reduce(|text, cause| if text.contains(&cause) { text } else { format!("{text}: {cause}") });
    let text = text.unwrap_or_default();
    match error.downcast_ref::<SynthesisError>().and_then(advice) {
        Some(advice) => format!("{text}. {advice}"),
        None => text,
    }
}

/// Which option or command helps.
pub(crate) fn advice(error: &SynthesisError) -> Option<String> {
    match error {
        SynthesisError::UnknownDepth { near, far, .. } => {
            let options = match (near, far) {
                (true, true) => "--near and --far",
                (true, false) => "--near",
                _ => "--far",
            };
            Some(format!("{options} give it (`liveview inspect` shows the size of the rig)"))
        }
        SynthesisError::Library(error) => ort_wheel::advice(error),
        _ => None,
    }
}

/// A path as JSON can hold it: serialising one that is not UTF-8 would panic.
pub(crate) fn shown(path: &Path) -> String {
    path.display().to_string()
}

/// A line on stderr; `println` would panic where nobody listens.
pub(crate) fn tell(kind: &str, what: impl Display) {
    let _ = writeln!(std::io::stderr(), "{kind}: {what}");
}

/// What was skipped or assumed when a scene was read, on stderr.
pub(crate) fn tell_notes(notes: &[String]) {
    notes.iter().for_each(|note| tell("note", note));
}

/// A bar that counts such as layers; only on a terminal, and on stderr.
pub(crate) fn progress(what: &str) -> anyhow::Result<ProgressBar> {
    let template = format!("{{bar:40}} {{pos}}/{{len}} {what} {{elapsed}} {{msg}}");
    Ok(ProgressBar::new(0).with_style(ProgressStyle::with_template(&template)?))
}
