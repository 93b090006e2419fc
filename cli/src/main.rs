//! The `liveview` program; `liveview --help` lists its commands.

mod args;
mod commands;
mod console;
mod interrupt;
mod job;
mod ort_wheel;
mod outputs;

use std::io::Write;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

#[cfg(feature = "viewer")]
use commands::{bake, view};
use commands::{depth, inspect, poses, render, sweep, video};

const EXAMPLES: &str = "\
Examples:
  liveview poses photos -o scene                        a scene of photos without poses
  liveview inspect scene                                how a scene is read
  liveview render scene --target IMG_7.jpg -o new.png   a held-out photo, rendered and scored
  liveview render scene --heldout 8                     every 8th photo, with a table of scores
  liveview render scene --path spiral:90 -o path.mp4    a camera path around the scene
  liveview video rig --path circle:120 -o view.mp4      the video of a rig, from a moving viewpoint
  liveview view scene                                   look around in the browser";

/// Renders new views of a scene from photos with known camera poses.
#[derive(Debug, Parser)]
#[command(name = "liveview", version, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print one JSON object on stdout instead of text
    #[arg(long, global = true, display_order = 900)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make a scene of photos or a video without poses, by COLMAP
    Poses(poses::PosesArgs),
    /// Render new views, and score them if the photo exists
    Render(Box<render::RenderArgs>),
    /// Render the video of a moving viewpoint from the frames of a camera rig
    Video(Box<video::VideoArgs>),
    #[cfg(feature = "viewer")]
    /// Look around a scene in a browser
    View(view::ViewArgs),
    #[cfg(feature = "viewer")]
    /// Write a scene as one page that opens in any browser, without a server
    Bake(bake::BakeArgs),
    /// Show how a scene is read, which planes a view needs, or what a model is
    Inspect(Box<inspect::InspectArgs>),
    /// Write the depth of the photos
    Depth(depth::DepthArgs),
    /// Measure error against run time for kinds and numbers of layers
    Sweep(sweep::SweepArgs),
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        // The help or the version, or what is wrong with the arguments.
        Err(text) => {
            let printed = if text.use_stderr() {
                // The reason is the last line.
                let reason = text.render().to_string().replace("\n\nFor more information, try '--help'.", "");
                write!(std::io::stderr(), "{reason}")
            } else {
                text.print().and_then(|()| std::io::stdout().flush())
            };
            let code = ExitCode::from(u8::try_from(text.exit_code()).unwrap_or(2));
            return unprinted(printed).unwrap_or(code);
        }
    };
    let output = interrupt::start().and_then(|()| match &cli.command {
        Command::Poses(args) => poses::run(args),
        Command::Render(args) => render::run(args),
        Command::Video(args) => video::run(args),
        #[cfg(feature = "viewer")]
        Command::View(args) => view::run(args),
        #[cfg(feature = "viewer")]
        Command::Bake(args) => bake::run(args),
        Command::Inspect(args) => inspect::run(args),
        Command::Depth(args) => depth::run(args),
        Command::Sweep(args) => sweep::run(args),
    });
    let failed = match output {
        Ok(output) => return print(&cli, output).unwrap_or(ExitCode::SUCCESS),
        Err(error) => error,
    };
    let message = console::full_text(&failed);
    let is_interrupted = failed.is::<interrupt::Interrupted>() || failed.is::<interrupt::Shortened>();
    if let Ok(interrupt::Shortened { output, .. }) = failed.downcast() {
        let _ = print(&cli, output);
    }
    match &cli.command {
        // The sweep that started the worker prints it.
        Command::Sweep(args) if args.is_worker() => drop(sweep::send_line(&serde_json::json!({ "error": message }))),
        _ => console::print_message("error", message),
    }
    ExitCode::from(if is_interrupted { interrupt::EXIT_CODE } else { 2 })
}

/// Prints the result of a command; the exit code if it cannot be printed.
fn print(cli: &Cli, console::Output { text, json }: console::Output) -> Option<ExitCode> {
    let escaped = || text.split('\n').map(console::escaped).collect::<Vec<_>>().join("\n");
    let printed = if cli.json { format!("{json:#}") } else { escaped() };
    let printed = printed.trim_end();
    let written = match &cli.command {
        // The video itself goes to standard output.
        Command::Video(args) if args.takes_stdout() => writeln!(std::io::stderr(), "{printed}"),
        _ => {
            let mut out = std::io::stdout();
            writeln!(out, "{printed}").and_then(|()| out.flush())
        }
    };
    unprinted(written)
}

/// The exit code if standard output cannot be written. A closed pipe (`| head`) is not an error.
fn unprinted(written: std::io::Result<()>) -> Option<ExitCode> {
    let error = written.err().filter(|error| error.kind() != std::io::ErrorKind::BrokenPipe)?;
    console::print_message("error", format_args!("standard output: cannot be written: {error}"));
    Some(ExitCode::from(2))
}
