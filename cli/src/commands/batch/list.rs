//! Reads the list of commands.

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use clap::Parser;
use liveview::fs::bounded;

use crate::commands::render::RenderArgs;

/// A command of the list.
pub(super) struct ListedCommand {
    /// Line number, counted from 1.
    pub(super) line: usize,
    pub(super) words: Vec<String>,
    pub(super) render: RenderArgs,
}

/// The parser of a line.
#[derive(Debug, Parser)]
#[command(name = "render", no_binary_name = true, disable_help_flag = true)]
struct Line {
    #[command(flatten)]
    render: RenderArgs,
}

/// Reads all commands of a list.
pub(super) fn read(path: &Path) -> Result<Vec<ListedCommand>> {
    let at = path.display();
    let text = bounded::read_text(path, bounded::MAX_JSON_BYTES).with_context(|| format!("{at}: cannot be read"))?;
    let text = String::from_utf8(text).map_err(|error| anyhow!("{at}: {error}; expected UTF-8"))?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let commands = lines.map(|(index, line)| {
        let line_number = index + 1;
        let words: Vec<String> = serde_json::from_str(line).map_err(|error| {
            anyhow!(
                "{at}: line {line_number}: {error}; expected a list of words, such as [\"scene\", \"--heldout\", \"8\"]"
            )
        })?;
        let parsed = Line::try_parse_from(&words).map_err(|error| {
            let message = error.to_string();
            let message = message.trim_end().strip_prefix("error: ").unwrap_or(message.trim_end());
            let paragraphs = message.split("\n\n").take_while(|paragraph| !paragraph.starts_with("Usage"));
            let words: Vec<&str> = paragraphs.flat_map(str::split_whitespace).collect();
            anyhow!("{at}: line {line_number}: {}", words.join(" "))
        })?;
        Ok(ListedCommand { line: line_number, words, render: parsed.render })
    });
    let commands = commands.collect::<Result<Vec<_>>>()?;
    let Some(first) = commands.first() else { bail!("{at}: no command; expected one per line") };
    let threads = first.render.threads();
    match commands.iter().find(|command| command.render.threads() != threads) {
        Some(other) => bail!(
            "{at}: line {}: {} threads, but line {} has {threads}; expected the same --threads on every line",
            other.line,
            other.render.threads(),
            first.line
        ),
        None => Ok(commands),
    }
}
