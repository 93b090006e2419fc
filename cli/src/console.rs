//! The command line: one file per subcommand; what they share is in `setup`, `layers`, `engine`, `targets`, `place`,
//! `output` and `record`.

mod dump;
mod encoder;
mod engine;
mod explain;
mod geometry;
mod inspect;
mod interrupt;
mod layers;
mod live;
mod measured;
mod output;
mod path;
mod place;
mod pose;
mod record;
mod render;
mod report;
mod select;
mod setup;
mod stability;
mod sweep;
mod targets;
mod worker;
mod workers;

use std::fmt::Display;
use std::io::Write;
use std::ops::RangeInclusive;
use std::path::Path;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};

pub(crate) use dump::Arrays;
pub(crate) use geometry::percentile;
pub(crate) use render::SCORE_BORDER;

const EXAMPLES: &str = "\
Examples:
  What is in the folder, and what will be left out:
    liveview inspect scene
  A held-out photo, rendered from the others and scored:
    liveview render scene --target IMG_7.jpg -o new.png
  Every 8th photo from the rest, with a table of scores:
    liveview render scene --heldout 8
  A flight around the rig:
    liveview render scene --path spiral:90 -o flight.mp4
  A rig's video from a viewpoint of its own:
    liveview video rig --path circle:120 -o view.mp4
  Which planes a view needs:
    liveview select scene --target IMG_7.jpg -o planes.png";

/// A folder of posed photos becomes a new view.
#[derive(Debug, Parser)]
#[command(version, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print one JSON object on stdout, and nothing else there
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Render new views, and score them where the photo exists
    Render(render::RenderArgs),
    /// Turn the frames of a camera rig into the video of a moving viewpoint, live if asked
    Video(live::VideoArgs),
    /// Tell how a scene is understood, and what will be left out
    Inspect(inspect::InspectArgs),
    /// Show which planes, or which range per pixel, a view needs
    Select(select::SelectArgs),
    /// Write every stage of one render as arrays (.npz), to hold against the Python reference
    Dump(dump::DumpArgs),
    /// Measure error against run time: kinds and numbers of layers, and the Python reference beside them
    Sweep(sweep::SweepArgs),
    /// Hold stiff and extreme cases of a scene's rig against float64, and the Python reference beside them
    Stability(stability::StabilityArgs),
    /// One configuration of a sweep, driven over JSON lines
    #[command(hide = true)]
    Worker(worker::WorkerArgs),
}

/// What a command has to say on stdout.
struct Report {
    text: String,
    json: serde_json::Value,
}

pub(crate) fn run() -> ExitCode {
    let cli = Cli::parse();
    let report = match &cli.command {
        Command::Render(args) => render::run(args),
        Command::Video(args) => live::run(args),
        Command::Inspect(args) => inspect::run(args),
        Command::Select(args) => select::run(args),
        Command::Dump(args) => dump::run(args),
        Command::Sweep(args) => sweep::run(args),
        Command::Stability(args) => stability::run(args),
        Command::Worker(args) => {
            worker::run(args).map(|()| Report { text: String::new(), json: serde_json::Value::Null })
        }
    };
    match report {
        Ok(Report { text, json }) => {
            let told = if cli.json { format!("{json:#}") } else { text };
            let told = told.trim_end();
            let written = match &cli.command {
                // The video itself goes there.
                Command::Video(args) if args.takes_stdout() => writeln!(std::io::stderr(), "{told}"),
                _ => {
                    let mut out = std::io::stdout();
                    writeln!(out, "{told}").and_then(|()| out.flush())
                }
            };
            match written {
                // A reader that went away (`| head`) is no error of ours.
                Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
                    tell("error", format_args!("standard output: cannot be written: {error}"));
                    ExitCode::from(2)
                }
                _ => ExitCode::SUCCESS,
            }
        }
        Err(error) => {
            let told = in_full(&error);
            match &cli.command {
                // To the sweep that started it, which tells.
                Command::Worker(_) => drop(worker::say(&serde_json::json!({ "error": told }))),
                _ => tell("error", told),
            }
            ExitCode::from(if error.is::<interrupt::Interrupted>() { interrupt::EXIT_CODE } else { 2 })
        }
    }
}

/// An error with those of its causes that it does not tell itself.
fn in_full(error: &anyhow::Error) -> String {
    let causes = error.chain().map(ToString::to_string);
    let told = causes.reduce(|told, cause| if told.contains(&cause) { told } else { format!("{told}: {cause}") });
    told.unwrap_or_default()
}

/// A path as JSON can hold it: serialising one that is not UTF-8 would panic.
fn shown(path: &Path) -> String {
    path.display().to_string()
}

/// A line on stderr; `println` would panic where nobody listens.
fn tell(kind: &str, what: impl Display) {
    let _ = writeln!(std::io::stderr(), "{kind}: {what}");
}

/// Parses a number of things: at least one, and not so many that it must be a mistake.
fn count(text: &str) -> Result<usize, String> {
    whole(text, 1..=4096)
}

/// Parses a number that memory or the machine bounds.
fn few(text: &str) -> Result<usize, String> {
    whole(text, 1..=256)
}

/// Parses a number of planes that have a distance between them.
fn two_or_more(text: &str) -> Result<usize, String> {
    whole(text, 2..=4096)
}

fn whole(text: &str, range: RangeInclusive<usize>) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("expected a whole number from {} to {}", range.start(), range.end()))
}

/// A bar that counts such as layers; only on a terminal, and on stderr.
fn progress(what: &str) -> anyhow::Result<ProgressBar> {
    let template = format!("{{bar:40}} {{pos}}/{{len}} {what} {{elapsed}} {{msg}}");
    Ok(ProgressBar::new(0).with_style(ProgressStyle::with_template(&template)?))
}
