//! The `liveview` command; `liveview --help` says what it does.

mod commands;
mod shard;

use std::io::Write;
use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use commands::{batch, depth, inspect, join, manual, models, render, select};
#[cfg(feature = "bench")]
use liveview_bench::{dump, stability, sweep};
use liveview_common::{console, interrupt};
#[cfg(feature = "video")]
use liveview_live::video;
#[cfg(feature = "viewer")]
use liveview_viewer as view;

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
  Look around in a browser:
    liveview view scene
  How deep each photo is, and how much of that others confirm:
    liveview depth scene -o depth
  Which planes a view needs:
    liveview select scene --target IMG_7.jpg -o planes.png";

/// A folder of posed photos becomes a new view.
#[derive(Debug, Parser)]
#[command(name = "liveview", version, after_help = EXAMPLES)]
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
    /// Put together what `render --shard` has rendered, on however many machines: a video, or a table of scores
    Join(join::JoinArgs),
    /// Run many render commands in one process
    Batch(batch::BatchArgs),
    #[cfg(feature = "video")]
    /// Turn the frames of a camera rig into the video of a moving viewpoint, live if asked
    Video(video::VideoArgs),
    #[cfg(feature = "viewer")]
    /// Look around a scene in a browser: prints a link
    View(view::ViewArgs),
    /// Show how a scene is read, and what will be left out
    Inspect(inspect::InspectArgs),
    /// Show which planes, or which range per pixel, a view needs
    Select(select::SelectArgs),
    /// Write the depth of the photos themselves, and score it where the scene knows the truth
    Depth(depth::DepthArgs),
    #[cfg(feature = "bench")]
    /// Write every stage of one render as arrays (.npz), to compare with the Python reference
    Dump(dump::DumpArgs),
    #[cfg(feature = "bench")]
    /// Measure error against run time: kinds and numbers of layers, and the Python reference beside them
    Sweep(sweep::SweepArgs),
    #[cfg(feature = "bench")]
    /// Compare stiff and extreme cases of a scene's rig with float64, and the Python reference beside them
    Stability(stability::StabilityArgs),
    /// List the models that are installed, with their cards
    Models(models::ModelsArgs),
    /// Write the manual pages, or what a shell completes commands by
    Manual(manual::ManualArgs),
    /// One configuration of a sweep, driven over JSON lines
    #[cfg(feature = "bench")]
    #[command(hide = true)]
    Worker(sweep::WorkerArgs),
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let output = match &cli.command {
        Command::Render(args) => render::run(args),
        Command::Join(args) => join::run(args),
        Command::Models(args) => models::run(args),
        Command::Manual(args) => manual::run(args, Cli::command()),
        Command::Batch(args) => batch::run(args),
        #[cfg(feature = "video")]
        Command::Video(args) => video::run(args),
        #[cfg(feature = "viewer")]
        Command::View(args) => view::run(args),
        Command::Inspect(args) => inspect::run(args),
        Command::Select(args) => select::run(args),
        Command::Depth(args) => depth::run(args),
        #[cfg(feature = "bench")]
        Command::Dump(args) => dump::run(args),
        #[cfg(feature = "bench")]
        Command::Sweep(args) => sweep::run(args),
        #[cfg(feature = "bench")]
        Command::Stability(args) => stability::run(args),
        #[cfg(feature = "bench")]
        Command::Worker(args) => sweep::run_worker(args),
    };
    match output {
        Ok(console::Output { text, json }) => {
            let printed = match &cli.command {
                _ if cli.json => format!("{json:#}"),
                // For a shell: nothing in it comes from a file.
                Command::Manual(_) => text,
                _ => console::escaped_lines(&text),
            };
            let printed = printed.trim_end();
            let written = match &cli.command {
                // What there is to tell was printed as each command ended.
                Command::Batch(_) => Ok(()),
                #[cfg(feature = "video")]
                // The video itself goes to standard output.
                Command::Video(args) if args.takes_stdout() => writeln!(std::io::stderr(), "{printed}"),
                _ => {
                    let mut out = std::io::stdout();
                    writeln!(out, "{printed}").and_then(|()| out.flush())
                }
            };
            match written {
                // A reader that stops reading (`| head`) is not an error.
                Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
                    console::print_message("error", format_args!("standard output: cannot be written: {error}"));
                    ExitCode::from(2)
                }
                _ => ExitCode::SUCCESS,
            }
        }
        Err(error) => {
            let message = console::full_text(&error);
            match &cli.command {
                #[cfg(feature = "bench")]
                // To the sweep that started the worker, which prints it.
                Command::Worker(_) => drop(console::send_line(&serde_json::json!({ "error": message }))),
                _ => console::print_message("error", message),
            }
            ExitCode::from(if error.is::<interrupt::Interrupted>() { interrupt::EXIT_CODE } else { 2 })
        }
    }
}
