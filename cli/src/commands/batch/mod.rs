//! `liveview batch`: many renders in one process, which loads ONNX Runtime and each model once.

mod done;
mod list;

use std::collections::HashMap;
use std::io::ErrorKind;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Error, Result, bail};
use clap::Args;
use done::DoneFile;
use list::ListedCommand;
use liveview_common::console::{Output, full_text, print_message, send_line};
use liveview_common::interrupt::{self, Interrupted};
use liveview_common::model_pool::ModelPool;
use liveview_common::outputs::OutputPlan;
use serde_json::{Value, json};

use super::render::{self, Planned};

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
    let mut unplanned = plan_outputs(args, &commands)?;
    let mut done = args.done.as_deref().map(DoneFile::open).transpose()?;
    let mut models = ModelPool::default();
    let (mut failed, total, mut is_closed) = (Vec::new(), commands.len(), false);
    for command in &commands {
        if interrupt::requested() {
            return Err(Interrupted.into());
        }
        let mut line = json!({ "line": command.line, "command": command.words });
        if done.as_ref().is_some_and(|done| done.lists(&command.words)) {
            line["kept"] = json!(true);
            print(&line, &mut is_closed)?;
            continue;
        }
        let started = Instant::now();
        let rendered = match unplanned.remove(&command.line) {
            Some(error) => Err(error),
            None => render::run_with(&command.render, &mut models),
        };
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
        // First the file, which says what need not be rendered again.
        done.as_mut().map_or(Ok(()), |done| done.add(&line))?;
        print(&line, &mut is_closed)?;
    }
    match failed.first() {
        Some(first) => bail!("{} of {total} commands failed, the first in line {first}", failed.len()),
        None => Ok(Output { text: String::new(), json: Value::Null }),
    }
}

/// Checks that no output of a command is that of another, the list, the file of `--done` or an
/// input of any command. The errors of the commands whose outputs are unknown, by line: of a scene
/// that cannot be opened, or a target that it does not have.
fn plan_outputs(args: &BatchArgs, commands: &[ListedCommand]) -> Result<HashMap<usize, Error>> {
    let (mut output_plan, mut planned, mut unplanned) = (OutputPlan::default(), Vec::new(), HashMap::new());
    output_plan.protect("the list of commands,", Some(&args.list));
    for command in commands {
        match Planned::new(&command.render, &mut output_plan) {
            Ok(outputs) => planned.push((command.line, outputs)),
            Err(error) => drop(unplanned.insert(command.line, error)),
        }
    }
    args.done.iter().try_for_each(|done| output_plan.extended("--done", done))?;
    for (line, outputs) in &mut planned {
        output_plan.set_prefix(format!("line {line}: "));
        outputs.add_outputs(&mut output_plan)?;
    }
    Ok(unplanned)
}

/// Prints a line, unless the reader of standard output has closed it (`| head`): the commands run
/// all the same.
fn print(line: &Value, is_closed: &mut bool) -> Result<()> {
    if *is_closed {
        return Ok(());
    }
    let printed = send_line(line);
    let kind = |error: &Error| error.downcast_ref::<std::io::Error>().map(std::io::Error::kind);
    *is_closed = printed.as_ref().is_err_and(|error| kind(error) == Some(ErrorKind::BrokenPipe));
    if *is_closed { Ok(()) } else { printed }
}
