//! `liveview batch`: many renders in one process, which loads ONNX Runtime and each model once.

mod done;
mod list;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use clap::Args;
use done::DoneFile;
use liveview_common::console::{Output, full_text, print_message, send_line};
use liveview_common::interrupt::{self, Interrupted};
use liveview_common::model_pool::ModelPool;
use serde_json::{Value, json};

use super::render;

const EXAMPLES: &str = "\
Examples:
  liveview batch list.jsonl > results.jsonl
  liveview batch list.jsonl --done done.jsonl

A list, with the arguments of `liveview render` on each line:
  [\"scene_1\", \"--heldout\", \"8\", \"-o\", \"out/1\"]
  [\"scene_2\", \"--path\", \"spiral:900\", \"-o\", \"out/2\", \"--resume\"]";

/// Options of `liveview batch`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct BatchArgs {
    /// File of render commands: on each line a JSON list of the arguments of `liveview render`
    list: PathBuf,
    /// Append the results to this file, and skip the commands that it lists as rendered
    ///
    /// A command is rendered again if one of its files no longer exists. To continue an interrupted
    /// command, give it --resume in the list.
    #[arg(long, value_name = "FILE")]
    done: Option<PathBuf>,
}

/// Runs the commands, after checking all of them; prints a line of JSON when each ends.
pub(crate) fn run(args: &BatchArgs) -> Result<Output> {
    let commands = list::read(&args.list)?;
    let mut done = args.done.as_deref().map(|path| DoneFile::open(path, &args.list)).transpose()?;
    let mut models = ModelPool::default();
    let (mut failed, total) = (Vec::new(), commands.len());
    for command in commands {
        if interrupt::requested() {
            return Err(Interrupted.into());
        }
        let mut line = json!({ "line": command.line, "command": command.words });
        if done.as_ref().is_some_and(|done| done.lists(&command.words)) {
            line["kept"] = json!(true);
            send_line(&line)?;
            continue;
        }
        let started = Instant::now();
        let rendered = render::run_with(&command.render, &mut models);
        line["seconds"] = json!(started.elapsed().as_secs_f64());
        match rendered {
            Ok(output) => line["result"] = output.json,
            Err(error) if error.is::<Interrupted>() => return Err(error),
            Err(error) => {
                let error = full_text(&error);
                print_message("error", format_args!("line {}: {error}", command.line));
                line["error"] = json!(error);
                failed.push(command.line);
            }
        }
        send_line(&line)?;
        done.as_mut().map_or(Ok(()), |done| done.add(&line))?;
    }
    match failed.first() {
        Some(first) => bail!("{} of {total} commands failed, the first in line {first}", failed.len()),
        None => Ok(Output { text: String::new(), json: Value::Null }),
    }
}
