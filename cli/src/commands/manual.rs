//! `liveview manual`: manual pages and shell completions.

use std::path::PathBuf;

use anyhow::{Result, anyhow};
use clap::{Args, Command};
use clap_complete::Shell;
use liveview_common::console::Output;
use serde_json::json;

const EXAMPLES: &str = "\
Examples:
  liveview manual --shell bash > ~/.local/share/bash-completion/completions/liveview
  liveview manual -o ~/.local/share/man/man1";

/// Options of `liveview manual`; exactly one is given.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
#[group(required = true, multiple = false)]
pub(crate) struct ManualArgs {
    /// Write a manual page for each command to this folder
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Print the completion script for this shell
    #[arg(long, value_enum)]
    shell: Option<Shell>,
}

/// Writes the manual pages, or returns the completions, of `command` and its subcommands.
pub(crate) fn run(args: &ManualArgs, mut command: Command) -> Result<Output> {
    if let Some(folder) = &args.output {
        let failed = |error| anyhow!("-o {}: cannot be written: {error}", folder.display());
        std::fs::create_dir_all(folder).map_err(failed)?;
        clap_mangen::generate_to(command, folder).map_err(failed)?;
        let folder = folder.display();
        return Ok(Output {
            text: format!("wrote   {folder}: `man liveview`, `man liveview-render` and so on"),
            json: json!({ "output": folder.to_string() }),
        });
    }
    let mut script = Vec::new();
    if let Some(shell) = args.shell {
        clap_complete::generate(shell, &mut command, "liveview", &mut script);
    }
    let text = String::from_utf8(script)?;
    Ok(Output { json: json!({ "completions": text }), text })
}
