//! `liveview manual`: manual pages and shell completions.

use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Command};
use clap_complete::Shell;
use clap_mangen::Man;
use liveview_common::args::output::write_atomically;
use liveview_common::console::Output;
use liveview_common::outputs::OutputPlan;
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
        command = command.disable_help_subcommand(true);
        command.build();
        let mut pages = Vec::new();
        add_pages(command, &mut pages)?;
        let mut output_plan = OutputPlan::default();
        let files: Vec<PathBuf> = pages.iter().map(|(name, _)| folder.join(name)).collect();
        files.iter().try_for_each(|file| output_plan.file("-o", file))?;
        output_plan.prepare()?;
        files.iter().zip(pages).try_for_each(|(file, (_, page))| write_atomically(file, &page))?;
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

/// Adds the names and texts of the manual pages of a command and its subcommands.
fn add_pages(command: Command, pages: &mut Vec<(String, Vec<u8>)>) -> Result<()> {
    for command in command.get_subcommands().filter(|command| !command.is_hide_set()) {
        add_pages(command.clone(), pages)?;
    }
    let (page, mut text) = (Man::new(command), Vec::new());
    page.render(&mut text)?;
    pages.push((page.get_filename(), text));
    Ok(())
}
