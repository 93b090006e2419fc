//! The list of commands.

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use clap::Parser;
use liveview::fs::bounded;

use crate::commands::render::RenderArgs;

/// A command of the list.
pub(super) struct Listed {
    /// Its line, counted from 1.
    pub(super) line: usize,
    pub(super) words: Vec<String>,
    pub(super) render: RenderArgs,
}

/// What stands on a line.
#[derive(Debug, Parser)]
#[command(name = "render", no_binary_name = true, disable_help_flag = true)]
struct Line {
    #[command(flatten)]
    render: RenderArgs,
}

/// Reads all commands of a list.
pub(super) fn read(path: &Path) -> Result<Vec<Listed>> {
    let at = path.display();
    let text = bounded::read(path, bounded::MAX_JSON_BYTES).with_context(|| format!("{at}: cannot be read"))?;
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
            let told = error.to_string();
            let told = told.trim_end().strip_prefix("error: ").unwrap_or(told.trim_end());
            // What is wrong, without the usage of another command.
            anyhow!("{at}: line {line_number}: {}", told.split("\n\n").next().unwrap_or(told))
        })?;
        Ok(Listed { line: line_number, words, render: parsed.render })
    });
    let commands = commands.collect::<Result<Vec<_>>>()?;
    let Some(first) = commands.first() else { bail!("{at}: no command; expected one a line") };
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
